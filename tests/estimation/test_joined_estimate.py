"""One model from several recordings with initial states and levels of their own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.order_selection import OrderSearch, estimate_candidates, reoptimize_from
from evopem.estimation.polynomial_estimate import describe
from evopem.estimation.prediction_errors import prediction_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import descended
from evopem.models.orders import Orders, armax_orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment

QUICK = SearchSettings(objective="quadratic", evaluations=300)
A, B, C = [1.0, -1.5, 0.8], [0.0, 1.0, 0.5], [1.0, -0.5, 0.2]


def recorded(seed, samples, level, noise=0.5, c=C):
    """A response that has begun before the recording, for some seeds."""
    before = 40 * (seed % 2)
    u, e = np.random.default_rng(seed).standard_normal((2, samples + before))
    y = lfilter(B, A, u) + noise * lfilter(c, A, e)
    return Segment(u[before:], y[before:] + level, seed)


def joined(stretches):
    first = stretches[0]
    return Recording(first.input, first.output, 1.0).with_segments(stretches)


def estimate_joined(stretches, orders, window):
    return estimate_polynomial(joined(stretches), orders, settings=QUICK, window=window, level=True)


def test_an_arx_model_is_the_regression_with_a_constant_for_each_recording():
    stretches = [recorded(0, 80, 5.0, c=[1.0]), recorded(1, 120, -3.0, c=[1.0])]
    orders = Orders(na=2, nb=2, nk=1, structure="arx")
    window = ScoringWindow(2, 2)
    found = estimate_joined(stretches, orders, window)
    rows, target = [], []
    for number, each in enumerate(stretches):
        for t in range(2, each.samples):
            past = [-each.output[t - 1], -each.output[t - 2], each.input[t - 1], each.input[t - 2]]
            rows.append([*past, float(number == 0), float(number == 1)])
            target.append(each.output[t])
    matrix, y = np.array(rows), np.array(target)
    truth, rest, *_ = np.linalg.lstsq(matrix, y, rcond=None)
    variance = rest[0] / (len(y) - 6)
    errors = np.sqrt(np.diag(variance * np.linalg.inv(matrix.T @ matrix)))
    assert found.model.parameters == pytest.approx(truth[:4], rel=1e-6)
    assert found.levels == pytest.approx(truth[4:], rel=1e-6)
    assert found.model.parameter_standard_errors() == pytest.approx(errors[:4], rel=1e-6)


def test_neither_the_order_of_recordings_nor_their_levels_change_the_model():
    stretches = [recorded(0, 150, 5.0), recorded(1, 100, -3.0), recorded(2, 120, 0.0)]
    others = [replace(each, outputs=each.output + 7.0 * each.recording) for each in stretches[::-1]]
    orders, window = armax_orders(2, 2, 2, 1), ScoringWindow(2, 12)
    found = estimate_joined(stretches, orders, window)
    other = estimate_joined(others, orders, window)
    assert other.model.parameters == pytest.approx(found.model.parameters, rel=1e-5)
    shifts = np.array([0.0, 7.0, 14.0]) * found.model.A.sum()
    assert other.levels[::-1] == pytest.approx(found.levels + shifts, rel=1e-4)


def local_fit(stretches):
    """The optimum next to the truth, with its standard errors."""
    orders = armax_orders(2, 2, 2, 1)
    window = ScoringWindow(orders.first_residual, orders.first_residual)
    errors = prediction_errors(joined(stretches), orders, QUICK, window, True)
    truth = PolynomialModel(np.array(A), np.array(B[1:]), np.array(C), nk=1, structure="armax")
    problem = PolynomialProblem(errors, [truth], own_starts=False)
    return describe(errors, descended(problem, problem.starts()[0]), 1.0).model


def test_intervals_of_pooled_recordings_cover_the_truth():
    """Of 6 parameters in 40 data sets of 4 short recordings, about 95 % lie inside."""
    truth = np.array([*A[1:], *B[1:], *C[1:]])
    inside, squares = [], []
    for number in range(40):
        seeds = range(4 * number + 100, 4 * number + 104)
        model = local_fit([recorded(seed, 120, 10.0 * (seed % 3)) for seed in seeds])
        deviations = (model.parameters - truth) / model.parameter_standard_errors()
        inside.append(np.abs(deviations) < 1.96)
        squares.append(deviations**2)
    assert 0.90 <= np.mean(inside) <= 0.98
    assert np.mean(squares) == pytest.approx(1.0, abs=0.35)


def test_the_order_search_estimates_joined_recordings_from_a_nested_optimum():
    stretches = [recorded(0, 150, 0.0), recorded(1, 150, 0.0)]
    data = Recording(stretches[0].input, stretches[0].output, 10.0).with_segments(stretches)
    window = ScoringWindow(3, 13)
    small, large = estimate_candidates(
        OrderSearch(data, QUICK, window),
        [armax_orders(2, 2, 2, 1), armax_orders(3, 3, 3, 1)],
        "plant",
    )
    assert small.search.value == pytest.approx(small.minimum)
    assert len(small.noise_state) == 4
    worse = replace(large, minimum=2.0 * small.minimum)
    again = reoptimize_from(OrderSearch(data, QUICK, window), small, worse)
    assert again.minimum <= small.minimum * (1.0 + 1e-9)
