"""Growing models by pairs of roots: nothing may change but the orders."""

import numpy as np
import pytest

from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.search.armax_problem import ArmaxProblem
from evopem.estimation.search.incremental_order import random_pairs, smaller_orders, with_factor
from evopem.estimation.search.memetic import SearchSettings, hybrid_search
from evopem.models.armax import Orders
from evopem.synthesis.armax import armax


def problem(orders, samples=800):
    record = armax(seed=4, samples=samples)[0]
    return PredictionErrorProblem(record.input, record.output, orders, "quadratic", 20, 45, 0.9999)


@pytest.mark.parametrize("orders", [Orders(2, 3, 1, 0), Orders(5, 4, 6, 3), Orders(1, 1, 3, 2)])
def test_a_common_factor_leaves_every_residual_as_it_was(orders):
    errors = problem(orders)
    generator = np.random.default_rng(1)
    (point,), _ = ArmaxProblem(errors).draw(1, generator)
    point[orders.parameters :] = generator.standard_normal(orders.nc)
    larger = errors.of_orders(Orders(orders.na + 2, orders.nb + 2, orders.nc + 2, orders.nk))
    before = errors.residuals(point)
    for grown in with_factor(errors, point, random_pairs(5, generator)):
        np.testing.assert_allclose(
            larger.residuals(grown), before, rtol=0, atol=1e-7 * np.abs(before).max()
        )


def test_the_orders_on_the_way_come_in_steps_of_a_pair():
    assert smaller_orders(Orders(7, 6, 7, 3)) == [Orders(3, 2, 3, 3), Orders(5, 4, 5, 3)]
    assert smaller_orders(Orders(4, 2, 4, 1)) == []


def test_pairs_lie_inside_the_unit_circle_at_all_frequencies():
    pairs = random_pairs(64, np.random.default_rng(2))
    assert np.all((np.abs(pairs) > 0.59) & (np.abs(pairs) < 0.998))
    assert np.all(np.diff(np.angle(pairs)) > 0)
    assert np.angle(pairs[0]) < 0.1
    assert np.angle(pairs[-1]) > 3.0


def test_a_grown_individual_is_no_worse_than_the_model_it_grew_from():
    orders = Orders(6, 6, 6, 3)
    large, small = problem(orders), problem(Orders(4, 4, 4, 3))
    settings = SearchSettings(evaluations=4000)
    best_small = hybrid_search(ArmaxProblem(small), settings, np.random.default_rng(1)).value
    grown, evaluations = ArmaxProblem(large, "grown").draw(6, np.random.default_rng(1))
    assert evaluations > 0
    assert large.values(grown).min() <= best_small * (1 + 1e-6)
