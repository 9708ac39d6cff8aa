"""Records that leave a part of the model undetermined."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.estimation.pem.covariance import pseudo_inverse_factor
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import describe
from evopem.models.orders import armax_orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.response_tables import response_interval
from evopem.signals.recording import Segment

A, B, C = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -0.6]
RATE = 100.0
SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=8, nu=4, evaluations=2000)


def record(u, noise, seed=1):
    e = noise * np.random.default_rng(seed).standard_normal(len(u))
    y = lfilter(B, A, u) + lfilter(C, A, e)
    return u[500:], y[500:]


def two_sines(samples):
    t = np.arange(samples)
    return np.sin(2 * np.pi * 0.05 * t) + np.sin(2 * np.pi * 0.13 * t)


def ten_lines(samples):
    t = np.arange(samples)
    return sum(np.cos(2 * np.pi * 0.04 * k * t + k * k) for k in range(1, 11))


def gain(frequencies):
    w = np.exp(-2j * np.pi * np.asarray(frequencies) / RATE)
    return np.abs(np.polyval(B[::-1], w) / np.polyval(A[::-1], w))


CASES = [
    (two_sines, (2, 6, 1, 1), [5.0, 13.0], [0.1, 9.0, 30.0]),
    (ten_lines, (2, 26, 1, 1), [4.0, 12.0, 32.0], [2.0, 10.0, 27.0]),
]


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize(("signal", "orders", "excited", "between"), CASES)
def test_lines_determine_the_gain_at_the_lines_only(signal, orders, excited, between, objective):
    u, y = record(signal(2500), 0.1)
    model = estimate(u, y, orders, RATE, settings=replace(SEARCH, objective=objective)).model
    errors = model.covariance.standard_errors(np.eye(model.orders.parameters))
    of_b = slice(orders[0], orders[0] + orders[1])
    assert np.isinf(errors[of_b]).all()
    assert np.isfinite(np.delete(errors, np.r_[of_b])).all()
    assert np.abs(model.B[0]).max() < 2.0
    lower, upper = (each[:, 0, 0] for each in response_interval(model, excited)[:2])
    # Four standard errors instead of two: several lines, one record each.
    middle = np.sqrt(lower * upper)
    assert np.all(np.abs(np.log(gain(excited) / middle)) < 2 * np.log(upper / middle))
    assert np.all(upper / lower < 1.1)
    assert np.isnan(response_interval(model, between)).all()


@pytest.mark.filterwarnings("ignore:the mean of the output")
def test_a_constant_input_determines_the_sum_of_b_only():
    u, y = record(np.full(2500, 5.0), 0.1)
    model = estimate(u, y, (2, 3, 1, 1), settings=SEARCH).model
    assert model.B[0] == pytest.approx(np.full(3, model.B[0].mean()))
    total = np.array([[0, 0, 1, 1, 1, 0], [0, 0, 1, 0, 0, 0]])
    errors = model.covariance.standard_errors(total)
    assert np.isfinite(errors[0])
    assert errors[1] == np.inf
    assert abs(model.B[0].sum() - 1.5) < 4 * errors[0]


def test_a_record_without_noise_determines_the_true_mode_only():
    u, y = record(np.random.default_rng(3).standard_normal(1500), 0.0)
    model = estimate(u, y, (6, 6, 2, 1), RATE, settings=SEARCH).model
    true = np.roots(A)[0]
    for mode in model.modes():
        at_truth = abs(mode.pole - true) < 1e-6
        assert np.isfinite(mode.frequency_se_hz) == at_truth
    assert any(abs(mode.pole - true) < 1e-6 for mode in model.modes())
    errors = model.covariance.standard_errors(np.eye(14))
    assert np.isinf(errors[12:]).all()


def test_the_shortest_b_leaves_the_residuals_as_they_are():
    """From a point far along the null space."""
    u, y = record(two_sines(2500), 0.1)
    orders = armax_orders(2, 6, 1, 1)
    found = estimate(u, y, orders, settings=SEARCH)
    errors = PolynomialErrors(
        [Segment(u, y)], orders, "quadratic", 0.9999, 0.9999, False, found.window
    )
    past = np.lib.stride_tricks.sliding_window_view(u, 6)[:, ::-1]
    null = np.linalg.svd(past)[2][-1]
    point = np.concatenate([found.model.parameters, found.noise_state])
    point[2:8] += 1e3 * null
    moved = describe(errors, replace(found.search, point=point), 1.0, shortest=True)
    assert np.abs(errors.residuals(point) - found.residuals[found.window.loss_start :]).max() < 1e-8
    assert np.abs(moved.model.B[0] - found.model.B[0]).max() < 1e-4
    assert np.linalg.norm(moved.model.B[0]) < 2.0


def test_what_rounding_turns_the_null_space_by_leaves_errors_known():
    """Rounding mixes 2e-6 of each direction that is just told into those that are not."""
    covariance = ParameterCovariance(np.array([[2.0], [0.0]]), np.array([[1.0], [1.0]]))
    gradients = np.array([[1.0, -1.0 + 1e-5], [1.0, -1.0 + 1e-3]])
    np.testing.assert_array_equal(covariance.standard_errors(gradients), [2.0, np.inf])


def test_pseudo_inverse_factor_of_a_singular_matrix():
    generator = np.random.default_rng(5)
    full = generator.standard_normal((20, 5)) * [1.0, 1e6, 1e-6, 1.0, 1.0]
    full[:, 3] = 2.0 * full[:, 0] - 3e-6 * full[:, 1]
    factor, null_space = pseudo_inverse_factor(np.linalg.qr(full, mode="r"))
    assert factor.shape == (5, 4)
    assert null_space[:, 0] / null_space[3, 0] == pytest.approx([-2.0, 3e-6, 0.0, 1.0, 0.0])
    # What the data determine has the variance of the regression on independent columns.
    estimable = np.array([1.0, 0.0, 0.0, 2.0, 0.0])
    reduced = full[:, [0, 1, 2, 4]]
    gradient = np.array([1.0, 0.0, 0.0, 0.0])
    expected = gradient @ np.linalg.inv(reduced.T @ reduced) @ gradient
    assert np.sum((estimable @ factor) ** 2) == pytest.approx(expected, rel=1e-6)
