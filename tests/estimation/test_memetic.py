"""The memetic search on a multimodal function whose minimum is known."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.config.settings import SearchSettings
from evopem.estimation.pem.kernels.bfgs import descend
from evopem.estimation.search.certificate import has_agreed, is_certified
from evopem.estimation.search.memetic import (
    FIRST_BATCH,
    HOPELESS_PROBABILITY,
    REFINE,
    SUFFICIENT_PROBABILITY,
    discrete_recombination,
    memetic_search,
)
from evopem.estimation.search.problem import (
    SearchDiagnostics,
    SearchResult,
    descended,
    pooled,
)


class Rastrigin:
    """Rastrigin's function about 1.234, weighted so that no two of its many minima are equal."""

    def __init__(self, dimension=3):
        self.dimension = dimension
        self.weights = np.sqrt(np.arange(1.0, dimension + 1))

    def draw(self, count, generator):
        return self.random(count, generator), 0

    def random(self, count, generator):
        return generator.uniform(-5, 5, (count, self.dimension))

    def recombine(self, parents, count, generator):
        return discrete_recombination(parents, count, generator)

    def repair(self, points):
        return points

    def values(self, points):
        z = points - 1.234
        return 1.0 + np.sum(self.weights * (z**2 + 10 * (1 - np.cos(2 * np.pi * z))), axis=1)

    def gradients(self, points):
        z = points - 1.234
        return self.weights * (2 * z + 20 * np.pi * np.sin(2 * np.pi * z))

    def descend(self, points):
        result = descend(
            lambda trial, _: (self.values(trial), self.gradients(trial)),
            points,
            lambda starts, _: np.tile(0.002 * np.eye(self.dimension), (len(starts), 1, 1)),
            100,
            1e-12,
        )
        return replace(result, evaluations=2 * result.evaluations)

    def polish(self, points):
        return self.descend(points)


def search(problem, settings=None, seed=1, **options):
    settings = settings or SearchSettings()
    return memetic_search(problem, settings, np.random.default_rng(seed), **options)


@pytest.mark.parametrize("refine", REFINE)
def test_it_finds_the_lowest_of_many_minima(refine):
    settings = SearchSettings(refine=refine, evaluations=60000)
    results = [search(Rastrigin(), settings, seed) for seed in range(5)]
    found = [np.allclose(result.point, 1.234, atol=1e-4) for result in results]
    # The chapter's choice finds it every time; of the three it rejected, most times is enough.
    assert sum(found) >= (5 if refine == "worst" else 3)
    assert all(result.value >= 1.0 for result in results)


class Confined(Rastrigin):
    """First individuals that all lie about a minimum that is not the lowest."""

    def draw(self, count, generator):
        return 3.234 + generator.uniform(-0.2, 0.2, (count, self.dimension)), 0


def test_a_multistart_check_refutes_what_the_restarts_agree_on():
    result = search(Confined(1), SearchSettings(evaluations=3000))
    minima = result.diagnostics.restart_minima
    assert minima[0] == pytest.approx(minima[1], rel=1e-9)
    assert result.value == pytest.approx(1.0)
    assert result.value == minima[2] < minima[1]
    assert result.diagnostics.n_confirming == 0


def test_the_check_ends_when_a_further_optimum_is_improbable():
    checked = search(Rastrigin(1)).diagnostics
    assert checked.n_local_optima > 5
    assert 0.0 < checked.undiscovered_probability <= SUFFICIENT_PROBABILITY
    # With a twentieth of the evaluations it ends sooner, and its probability says so.
    shorter = search(Rastrigin(1), SearchSettings(evaluations=1000)).diagnostics
    assert shorter.n_multistart < checked.n_multistart
    assert shorter.undiscovered_probability > SUFFICIENT_PROBABILITY
    hopeless = search(Rastrigin(6), agreeing_restarts=1).diagnostics
    assert hopeless.n_multistart == FIRST_BATCH
    assert hopeless.undiscovered_probability > HOPELESS_PROBABILITY


def test_the_diagnostics_of_a_search_are_consistent():
    result = search(Rastrigin(2), seed=3)
    diagnostics = result.diagnostics
    counts, values = zip(*diagnostics.convergence, strict=True)
    assert list(counts) == sorted(counts)
    assert list(values) == sorted(values, reverse=True)
    assert counts[-1] == diagnostics.evaluations
    assert values[-1] == result.value
    assert diagnostics.n_restarts == len(diagnostics.restart_minima) >= 2
    assert 1 <= diagnostics.n_confirming < diagnostics.n_restarts
    assert min(diagnostics.restart_minima) == result.value
    assert diagnostics.n_local_optima > 1
    assert result.value == Rastrigin(2).values(result.point[None, :])[0]


def test_the_same_seed_gives_the_same_bits():
    one, two = (search(Rastrigin(), seed=11) for _ in range(2))
    np.testing.assert_array_equal(one.point, two.point)
    assert one.diagnostics == two.diagnostics


def test_a_single_restart_is_not_confirmed():
    diagnostics = search(Rastrigin(), SearchSettings(evaluations=1)).diagnostics
    assert (diagnostics.n_restarts, diagnostics.n_confirming) == (1, 0)
    assert (diagnostics.n_multistart, diagnostics.undiscovered_probability) == (0, 1.0)


def test_it_stops_soon_after_its_evaluations_are_spent():
    diagnostics = search(Rastrigin(), SearchSettings(evaluations=500)).diagnostics
    one_generation = 115 + 10 * 2 * 200
    assert diagnostics.evaluations < 500 + one_generation


def result_of(value, minima, evaluations, convergence, **more):
    settings = {
        "generations": 2,
        "n_confirming": 0,
        "n_local_optima": 3,
        "n_multistart": 0,
        "undiscovered_probability": 1.0,
    } | more
    diagnostics = SearchDiagnostics(
        evaluations=evaluations, restart_minima=minima, convergence=convergence, **settings
    )
    return SearchResult(np.array([value]), value, diagnostics)


@pytest.mark.parametrize("better", [2.0, 4.0])
def test_two_searches_of_one_problem_are_pooled(better):
    first = result_of(3.0, (3.0, 3.0 + 1e-9), 100, ((50, 5.0), (100, 3.0)), n_confirming=1)
    second = result_of(
        better,
        (better,),
        40,
        ((20, 6.0), (40, better)),
        n_local_optima=5,
        n_multistart=32,
        undiscovered_probability=0.1,
    )
    found = pooled(first, second)
    best = min(3.0, better)
    assert (found.value, found.point[0]) == (best, best)
    assert found.diagnostics == SearchDiagnostics(
        evaluations=140,
        generations=4,
        restart_minima=(3.0, 3.0 + 1e-9, better),
        n_confirming=0 if better < 3.0 else 1,
        n_local_optima=5,
        n_multistart=32,
        undiscovered_probability=0.1,
        convergence=((50, 5.0), (100, 3.0), (120, 3.0), (140, best)),
        supported=False,
    )


def test_searches_that_nothing_has_contested_are_no_certificate_together():
    one = {"n_multistart": 17, "undiscovered_probability": 0.005}
    searches = [result_of(3.0, (3.0,), 100, ((100, 3.0),), **one) for _ in range(2)]
    both = pooled(*searches).diagnostics
    assert has_agreed(both)
    assert not is_certified(both)
    found = pooled(searches[0], result_of(3.0, (3.0,), 100, ((100, 3.0),), withstood=True, **one))
    assert is_certified(found.diagnostics)


def test_a_descent_from_a_known_point_confirms_nothing():
    problem = Rastrigin()
    ended = descended(problem, np.zeros(3))
    assert (ended.diagnostics.n_restarts, ended.diagnostics.descents) == (0, 1)
    both = pooled(ended, result_of(ended.value, (ended.value,), 100, ((100, ended.value),)))
    assert (both.diagnostics.n_restarts, both.diagnostics.n_confirming) == (1, 0)
    assert not has_agreed(both.diagnostics)
