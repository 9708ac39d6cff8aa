"""Models extended by pairs of roots: nothing changes but the orders."""

import numpy as np
import pytest

from evopem.config.settings import SearchSettings
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.armax_problem import ArmaxProblem
from evopem.estimation.search.incremental_order import (
    padded,
    random_pairs,
    smaller_orders,
    with_factor,
)
from evopem.estimation.search.memetic import memetic_search
from evopem.models.structures import armax_orders
from evopem.synthesis.armax import armax


def problem(orders, samples=800):
    record = armax(seed=4, samples=samples)[0]
    return PolynomialErrors(
        record.input, record.output, orders, "quadratic", 20, 45, 0.9999, 0.9999
    )


@pytest.mark.parametrize(
    "orders", [armax_orders(2, 3, 1, 0), armax_orders(5, 4, 6, 3), armax_orders(1, 1, 3, 2)]
)
def test_a_common_factor_leaves_every_residual_as_it_was(orders):
    errors = problem(orders)
    generator = np.random.default_rng(1)
    (point,), _ = ArmaxProblem(errors).draw(1, generator)
    point[orders.parameters :] = generator.standard_normal(orders.nc)
    larger = errors.of_orders(
        armax_orders(orders.na + 2, orders.single.nb + 2, orders.nc + 2, orders.single.nk)
    )
    before = errors.residuals(point)
    for extended in with_factor(errors, point, random_pairs(5, generator)):
        np.testing.assert_allclose(
            larger.residuals(extended), before, rtol=0, atol=1e-7 * np.abs(before).max()
        )


@pytest.mark.parametrize(
    ("small", "large"),
    [
        (armax_orders(2, 3, 1, 2), armax_orders(4, 6, 3, 1)),
        (armax_orders(3, 2, 2, 3), armax_orders(3, 4, 2, 2)),
        (armax_orders(2, 2, 2, 1), armax_orders(2, 2, 5, 1)),
    ],
)
def test_zeros_added_to_a_nested_model_leave_every_residual_as_it_was(small, large):
    assert large.contains(small)
    errors, larger = problem(small), problem(large)
    generator = np.random.default_rng(3)
    (point,), _ = ArmaxProblem(errors).draw(1, generator)
    point[small.parameters :] = generator.standard_normal(small.nc)
    before = errors.residuals(point)
    after = larger.residuals(padded(point, small, large))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * np.abs(before).max())


def test_the_orders_on_the_way_come_in_steps_of_a_pair():
    assert smaller_orders(armax_orders(7, 6, 7, 3)) == [
        armax_orders(3, 2, 3, 3),
        armax_orders(5, 4, 5, 3),
    ]
    assert smaller_orders(armax_orders(4, 2, 4, 1)) == []


def test_pairs_lie_inside_the_unit_circle_at_all_frequencies():
    pairs = random_pairs(64, np.random.default_rng(2))
    assert np.all((np.abs(pairs) > 0.59) & (np.abs(pairs) < 0.998))
    assert np.all(np.diff(np.angle(pairs)) > 0)
    assert np.angle(pairs[0]) < 0.1
    assert np.angle(pairs[-1]) > 3.0


def test_an_extended_individual_is_no_worse_than_the_smaller_model():
    orders = armax_orders(6, 6, 6, 3)
    large, small = problem(orders), problem(armax_orders(4, 4, 4, 3))
    settings = SearchSettings(evaluations=4000)
    smaller = memetic_search(ArmaxProblem(small), settings, np.random.default_rng(1)).value
    drawn = ArmaxProblem(large, "incremental_order").draw(6, np.random.default_rng(1))
    extended, evaluations = drawn
    assert evaluations > 0
    assert large.values(extended).min() <= smaller * (1 + 1e-6)
