"""Every evaluation is counted once, and none is made beyond the budget."""

import numpy as np
import pytest

from evopem.config.settings import SearchSettings
from evopem.estimation.search.memetic import memetic_search
from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.function import instance
from fletcher_powell.objective import TARGET, Objective, RunOver, Success
from fletcher_powell.problem import FletcherPowellProblem, descend_in_turn


class Watched:
    """An instance that counts its evaluations independently."""

    def __init__(self, dimension=4):
        self.inner = instance("seed-1", dimension)
        self.dimension = dimension
        self.values_asked = self.gradients_asked = 0

    def values(self, points):
        self.values_asked += len(points)
        return self.inner.values(points)

    def values_and_gradients(self, points):
        self.values_asked += len(points)
        self.gradients_asked += len(points)
        return self.inner.values_and_gradients(points)

    values_and_differences = values_and_gradients

    def residuals(self, point):
        self.values_asked += 1
        return self.inner.residuals(point)

    def jacobian(self, point):
        self.gradients_asked += 1
        return self.inner.jacobian(point)

    jacobian_by_differences = jacobian


@pytest.mark.parametrize(("gradient", "cost"), [("analytic", 1), ("differences", 4)])
def test_the_hybrids_evaluations_are_all_counted(gradient, cost):
    watched = Watched()
    objective = Objective(watched, gradient, 10**6, until=-1.0)
    result = memetic_search(
        FletcherPowellProblem(objective),
        SearchSettings(evaluations=2000),
        np.random.default_rng(1),
        agreeing_restarts=10**9,
    )
    spent = watched.values_asked + cost * watched.gradients_asked
    assert objective.evaluations == result.diagnostics.evaluations == spent >= 2000
    assert objective.value_count == watched.values_asked
    assert objective.gradient_count == watched.gradients_asked


@pytest.mark.parametrize(("gradient", "cost"), [("analytic", 1), ("differences", 4)])
def test_the_default_searchs_evaluations_are_all_counted(gradient, cost):
    watched = Watched()
    objective = Objective(watched, gradient, 3000, until=-1.0)
    with pytest.raises(RunOver):
        ALGORITHMS["default"].search(objective, np.random.default_rng(1))
    assert objective.value_count == watched.values_asked
    # The gradient that the budget cuts off is counted and not made.
    assert objective.gradient_count - watched.gradients_asked in (0, 1)
    spent = objective.value_count + cost * objective.gradient_count
    assert objective.evaluations == 3000 <= spent < 3000 + cost
    assert objective.best < TARGET


def test_a_budget_is_kept_to_the_evaluation():
    watched = Watched()
    objective = Objective(watched, "analytic", 25)
    points = np.random.default_rng(0).uniform(-3, 3, (10, 4))
    objective.values(points)
    objective.values(points)
    with pytest.raises(RunOver):
        objective.values(points)
    assert objective.evaluations == watched.values_asked == 25
    assert objective.best == watched.inner.values(points).min()


def test_a_value_beyond_the_budget_does_not_count():
    objective = Objective(Watched(), "differences", 12)
    values = np.array([9.0, 8.0, 7.0, 0.0])
    # Of (1 + 4) each, the third value is the eleventh evaluation and the fourth the sixteenth.
    with pytest.raises(RunOver):
        objective.record(values, gradients=True)
    assert objective.best == 7.0
    assert objective.evaluations == 12
    assert objective.success is None


def test_the_first_value_below_the_target_is_the_success():
    objective = Objective(Watched(), "differences", 1000)
    objective.record(np.array([5.0, 4.0]), gradients=False)
    objective.record(np.array([3.0, 0.5 * TARGET, 0.1 * TARGET]), gradients=True)
    assert objective.success == Success(evaluations=2 + 5 + 1, values=4, gradients=1)
    assert objective.improvements == [
        (1, 5.0),
        (2, 4.0),
        (3, 3.0),
        (8, 0.5 * TARGET),
        (13, 0.1 * TARGET),
    ]


def test_a_run_is_over_when_the_wanted_value_is_reached():
    objective = Objective(Watched(), "analytic", 1000, until=2.0)
    objective.record(np.array([3.0]), gradients=False)
    with pytest.raises(RunOver):
        objective.record(np.array([2.0]), gradients=False)


def test_descents_side_by_side_count_as_one_after_another():
    starts = np.random.default_rng(2).uniform(-3, 3, (6, 4))
    together = Objective(instance("seed-1", 4), "analytic", 10**6, until=-1.0)
    values = descend_in_turn(together, starts).values
    apart = Objective(instance("seed-1", 4), "analytic", 10**6, until=-1.0)
    single = [descend_in_turn(apart, start[None]) for start in starts]
    # One row or several: the last digits of the sums differ, the minima do not.
    assert values == pytest.approx(np.concatenate([descent.values for descent in single]), abs=1e-6)
    assert together.evaluations == pytest.approx(apart.evaluations, rel=0.05)
    assert together.evaluations == 2 * together.value_count


def test_a_gradient_of_another_kind_is_refused():
    with pytest.raises(ValueError, match="gradient must be one of"):
        Objective(instance("seed-1", 2), "numeric", 10)
