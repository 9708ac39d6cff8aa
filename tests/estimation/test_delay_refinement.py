"""Delay and last lag of B after the order search."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.config.settings import ScoringWindow
from evopem.estimation.order_selection import (
    Fit,
    delay_alternatives,
    refine_delay,
    t_ratios_of_ends,
)
from evopem.models.orders import armax_orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel

SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=4, nu=4, evaluations=1)


def model(b, errors, nk=3):
    covariance = ParameterCovariance(np.diag(np.r_[0.1, errors, 0.1]), np.zeros((len(b) + 2, 0)))
    return PolynomialModel(
        np.array([1.0, 0.5]), np.array(b), np.array([1.0, 0.2]), nk=nk, covariance=covariance
    )


def test_ends_that_are_not_clearly_significant_are_compared():
    insignificant = model([0.1, 1.0, -0.2], [0.1, 0.1, 0.1])
    assert t_ratios_of_ends(insignificant) == pytest.approx((1.0, 2.0))
    assert delay_alternatives(insignificant, 1000, 0) == [
        armax_orders(1, 2, 1, 4),
        armax_orders(1, 2, 1, 3),
        armax_orders(1, 4, 1, 2),
    ]
    significant = model([1.0, 1.0, -2.0], [0.1, 0.1, 0.1])
    assert delay_alternatives(significant, 1000, 3) == []
    assert delay_alternatives(model([0.1], [0.1]), 1000, 3) == []


def test_ends_that_are_not_known_are_compared():
    unknown = PolynomialModel(np.array([1.0, 0.5]), np.ones(2), np.ones(1), nk=1)
    assert len(delay_alternatives(unknown, 1000, 1)) == 2
    infinite = ParameterCovariance(0.01 * np.eye(4), np.eye(4)[:, 1:2])
    unidentified = PolynomialModel(
        np.array([1.0, 0.5]), np.ones(2), np.ones(2), nk=1, covariance=infinite
    )
    assert t_ratios_of_ends(unidentified) == pytest.approx((0.0, 100.0))
    assert delay_alternatives(unidentified, 1000, 1) == [armax_orders(1, 1, 1, 2)]


def from_criteria(criteria):
    """A fit of every order from a table of BIC; asks for nothing else."""
    asked = []

    def fit(orders):
        asked.append(orders)
        found = model([0.1] * orders.single.nb, [0.1] * orders.single.nb, orders.single.nk)
        return Fit(found, criteria[orders.single.nk, orders.single.nb])

    return fit, asked


def test_the_smallest_criterion_is_followed_and_nothing_estimated_twice():
    criteria = {(3, 3): 0.0, (4, 2): -2.0, (3, 2): -1.0, (2, 4): 1.0, (5, 1): -1.0, (4, 1): 0.0}
    fit, asked = from_criteria(criteria)
    found = refine_delay(fit(armax_orders(1, 3, 1, 3)), 1000, 2, fit)
    assert found.model.orders == armax_orders(1, 2, 1, 4)
    assert len(asked) == 6
    assert set(asked) == {armax_orders(1, nb, 1, nk) for nk, nb in criteria}


def test_without_a_better_neighbour_the_model_stays():
    fit, _ = from_criteria({(3, 2): 0.0, (4, 1): 0.0, (3, 1): 1.0, (2, 3): 2.0})
    start = fit(armax_orders(1, 2, 1, 3))
    assert refine_delay(start, 1000, 2, fit) is start


@pytest.mark.parametrize(
    "start", [armax_orders(2, 3, 1, 1), armax_orders(2, 3, 1, 2), armax_orders(2, 1, 1, 3)]
)
def test_the_true_delay_is_found_from_either_side(start):
    """b has two coefficients from lag 2 on."""
    for seed in range(4):
        u, e = np.random.default_rng([1, seed]).standard_normal((2, 1500))
        y = lfilter([0.0, 0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
        y += 0.5 * lfilter([1.0, -0.6], [1.0, -1.5, 0.7], e)

        def fit(orders, u=u, y=y):
            found = estimate(
                u,
                y,
                orders,
                settings=SEARCH,
                window=ScoringWindow(10, 30),
            )
            return Fit(found.model, found.criteria.bic)

        assert refine_delay(fit(start), 1470, 0, fit).model.orders == armax_orders(2, 2, 1, 2)
