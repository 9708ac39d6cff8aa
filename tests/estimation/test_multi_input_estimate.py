"""Polynomial models with several inputs: derivatives, optima, orders, intervals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from evopem.estimation.multi_input.descent import descend
from evopem.estimation.multi_input.errors import MultiInputErrors, multi_input_record
from evopem.estimation.multi_input.estimate import (
    estimate_multi_input,
    multi_input_estimates,
    parameter_covariance,
)
from evopem.estimation.multi_input.order_limits import joint_orders
from evopem.estimation.multi_input.order_reduction import reduced_orders
from evopem.estimation.multi_input.search import SETTINGS
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders

ONE = np.ones(1)
A = np.convolve([1.0, -1.5, 0.8], [1.0, -0.6, 0.5])
B = (np.array([1.0, 0.5]), np.array([-0.7, 0.3, 0.2]))
F = (np.array([1.0, -1.5, 0.8]), np.array([1.0, -0.9]))
SHORT = replace(SETTINGS, evaluations=200)
TRUTHS = {
    "armax": (A, B, np.array([1.0, -0.6, 0.3]), ONE, (ONE, ONE)),
    "oe": (ONE, (B[0], B[1][:2]), ONE, ONE, F),
    "bj": (
        ONE,
        (B[0], B[1][:2]),
        np.array([1.0, 0.4]),
        np.array([1.0, -0.9]),
        (F[0], np.array([1.0, 0.2, 0.7])),
    ),
}


def record_of(structure, samples, seed, noise=0.1):
    """Inputs, output and the model with the variance of its noise; coloured inputs, delays 1, 3."""
    model = PolynomialModel(*TRUTHS[structure], nk=(1, 3), structure=structure)
    generator = np.random.default_rng(seed)
    u = lfilter([1.0], [1.0, -0.5], generator.standard_normal((samples + 500, 2)), axis=0)
    e = generator.standard_normal(samples + 500)
    y, v = model.simulate(u), lfilter(model.C, np.convolve(model.A, model.D), e)
    scale = noise * y.std() / v.std()
    return u[500:], (y + scale * v)[500:] + 3.0, model, scale**2


CASES = [
    Orders("fir", nb=(2, 4), nf=(0, 0), nk=(0, 3)),
    Orders("arx", nb=(2, 4), nf=(0, 0), nk=(0, 3), na=3),
    Orders("armax", nb=(2, 4), nf=(0, 0), nk=(0, 3), na=2, nc=3),
    Orders("ararmax", nb=(2, 4), nf=(0, 0), nk=(0, 3), na=2, nc=1, nd=2),
    Orders("oe", nb=(2, 4), nf=(2, 1), nk=(0, 3)),
    Orders("bj", nb=(2, 4), nf=(2, 3), nk=(0, 3), nc=2, nd=1),
    Orders("general", nb=(2, 4), nf=(1, 2), nk=(0, 3), na=1, nc=2, nd=1),
]


@pytest.mark.parametrize("orders", CASES, ids=str)
def test_the_jacobian_is_the_derivative_of_the_residuals(orders):
    generator = np.random.default_rng(3)
    inputs = [generator.standard_normal((n, 2)) * [1.0, 50.0] for n in (90, 60)]
    outputs = [5.0 + 7.0 * generator.standard_normal(n) for n in (90, 60)]
    record = multi_input_record(inputs, outputs, orders.first_residual + 2)
    errors = MultiInputErrors(record, orders, 0.999)
    point = errors.repaired(0.4 * generator.standard_normal(errors.dimension))
    steps = 1e-6 * np.eye(errors.dimension)
    slopes = np.array(
        [(errors.residuals(point + h) - errors.residuals(point - h)) / 2e-6 for h in steps]
    ).T
    found = errors.jacobian(point)
    assert np.abs(found - slopes).max() < 1e-8 * np.abs(found).max()


def test_residuals_are_those_of_filters():
    orders = CASES[-1]
    generator = np.random.default_rng(4)
    u, y = generator.standard_normal((200, 2)), generator.standard_normal(200)
    start = orders.first_residual
    y[:start] = u[:start] = 0.0  # a past that is known to be at rest
    record = multi_input_record([u], [y], start)
    errors = MultiInputErrors(record, orders, 0.999)
    point = errors.repaired(0.3 * generator.standard_normal(errors.dimension))
    point[orders.parameters + 1 :] = 0.0
    model = errors.model(point, 1.0, 1.0)
    shifted = y - record.offset
    expected = lfilter(model.A, [1.0], shifted) - (model.level - record.offset * model.A.sum())
    for i in (0, 1):
        b = np.concatenate([np.zeros(model.nk[i]), model.B[i]])
        expected -= lfilter(b, model.F[i], u[:, i])
    expected[:start] = 0.0
    expected = lfilter(model.D, model.C, expected)[start:]
    assert np.allclose(errors.residuals(point) * record.output_scale, expected, atol=1e-10)


def test_arx_is_ordinary_least_squares():
    u, y, _, _ = record_of("armax", 800, 1)
    found = estimate_multi_input(u, y, {"na": 4, "nb": [2, 3], "nk": [1, 3]}, "arx")
    t = np.arange(5, 800)
    columns = [-y[t - k] for k in range(1, 5)] + [u[t - k, 0] for k in (1, 2)]
    columns += [u[t - k, 1] for k in (3, 4, 5)] + [np.ones(len(t))]
    expected = np.linalg.lstsq(np.column_stack(columns), y[t], rcond=None)[0]
    assert np.allclose([*found.model.parameters, found.model.level], expected, rtol=1e-5)
    errors = y[t] - np.column_stack(columns) @ expected
    variance = errors @ errors / (len(t) - 10)
    assert found.model.noise_variance == pytest.approx(variance, rel=1e-8)
    gram = np.linalg.inv(np.column_stack(columns).T @ np.column_stack(columns))
    own = found.model.covariance.standard_errors(np.eye(10))
    assert np.allclose(own, np.sqrt(variance * np.diag(gram)), rtol=1e-6)


ORDERS = {
    "armax": {"na": 4, "nb": [2, 3], "nc": 2, "nk": [1, 3]},
    "oe": {"nb": 2, "nf": [2, 1], "nk": [1, 3]},
    "bj": {"nb": 2, "nf": 2, "nc": 1, "nd": 1, "nk": [1, 3]},
}


@pytest.mark.parametrize("structure", TRUTHS)
def test_the_optimum_is_that_of_an_independent_solution_and_near_the_truth(structure):
    u, y, truth, variance = record_of(structure, 1500, 5)
    found = estimate_multi_input(u, y, ORDERS[structure], structure, 50.0, settings=SHORT)
    model = found.model
    deviation = model.parameters - truth.parameters
    errors = model.parameter_standard_errors()
    assert np.abs(deviation / errors).max() < 4.0
    assert 0.9 < model.noise_variance / variance < 1.1
    assert not found.at_stability_bound

    # Levenberg-Marquardt of MINPACK, by finite differences and from the truth.
    record = multi_input_record([u], [y], model.orders.first_residual)
    problem = MultiInputErrors(record, model.orders, 0.9999)
    start = problem.point_of(truth)
    peer = least_squares(problem.residuals, start, method="lm", xtol=1e-13, ftol=1e-13)
    lowest = problem.percent(peer.fun)
    assert found.objective <= lowest * (1.0 + 1e-7)


@pytest.mark.parametrize("structure", TRUTHS)
def test_records_have_levels_and_states_of_their_own(structure):
    u, y, truth, _ = record_of(structure, 900, 5)
    us, ys = [u[:500], u[500:]], [y[:500], y[500:] + 7.0]
    found = estimate_multi_input(us, ys, ORDERS[structure], structure, 50.0, settings=SHORT)
    record = multi_input_record(us, ys, found.model.orders.first_residual)
    problem = MultiInputErrors(record, found.model.orders, 0.9999)
    start = problem.point_of(truth)
    peer = least_squares(problem.residuals, start, method="lm", xtol=1e-13, ftol=1e-13)
    assert found.objective <= problem.percent(peer.fun) * (1.0 + 1e-7)
    # No residual of a record depends on level and states of the other one.
    own = (problem.dimension - problem.orders.parameters) // 2
    columns, first = problem.jacobian(peer.x), record.bounds[1]
    assert not columns[:first, -own:].any()
    assert not columns[first:, -2 * own : -own].any()
    start = found.window.residual_start
    assert len(found.residuals) == 900
    missing = np.flatnonzero(np.isnan(found.residuals))
    assert missing.tolist() == [*range(start), *range(500, 500 + start)]
    assert found.levels[1] - found.levels[0] == pytest.approx(7.0 * found.model.A.sum(), rel=0.3)


SIMPLE = {"na": 2, "nb": 1, "nc": 1, "nk": [1, 3]}


def test_same_bits_twice():
    u, y, _, _ = record_of("armax", 300, 6)
    one, other = (estimate_multi_input(u, y, SIMPLE, "armax", settings=SHORT) for _ in range(2))
    assert np.array_equal(one.model.parameters, other.model.parameters)


def test_orders_and_delays_of_each_input_are_found():
    u, y, truth, _ = record_of("armax", 1000, 7)
    orders = {k: joint_orders("armax", k, (1, 2)) for k in range(1, 6)}
    scores = dict(multi_input_estimates(u, y, orders))
    best = min(scores, key=lambda order: scores[order].bic)
    assert best == 4
    assert reduced_orders(u, y, orders[best]).orders == truth.orders


def test_coloured_noise_does_not_deceive_the_intervals_of_an_output_error_model():
    """95 % intervals of the static gains cover the truth; white noise assumed, they do not."""
    covered = []
    for seed in range(30):
        generator = np.random.default_rng(seed)
        u = lfilter([1.0], [1.0, -0.8], generator.standard_normal((600, 2)), axis=0)
        truth = PolynomialModel(*TRUTHS["oe"], nk=(1, 3), structure="oe")
        noise = lfilter([1.0], [1.0, -0.95], generator.standard_normal(600))
        y = truth.simulate(u) + noise * 0.2 * truth.simulate(u).std() / noise.std()
        problem = MultiInputErrors(multi_input_record([u], [y], 4), truth.orders, 0.9999)
        optimum = descend(problem, problem.point_of(truth), 100, 1e-9)
        model = problem.model(optimum.point, 1.0, 1.0)
        covariance = parameter_covariance(problem, optimum.point, problem.residuals(optimum.point))

        def gains(parameters, model=model):
            return model.with_parameters(parameters).frequency_response(0.0).real.ravel()

        steps = 1e-6 * np.eye(len(model.parameters))
        slopes = np.array(
            [(gains(model.parameters + h) - gains(model.parameters - h)) / 2e-6 for h in steps]
        ).T
        errors = covariance.standard_errors(slopes)
        deviation = gains(model.parameters) - gains(truth.parameters)
        covered += list(np.abs(deviation) < 1.96 * errors)
    assert np.mean(covered) >= 0.86  # 95 % less three standard errors of 60 trials


@pytest.mark.parametrize(
    ("u", "y", "orders", "says"),
    [
        (np.ones((30, 2)), np.arange(30.0), {"nb": 9, "nf": 9}, "needs more than"),
        (np.ones((300, 2)), np.ones(300), {"nb": 1, "nf": 1}, "the output is constant"),
        (np.ones((300, 2)), np.ones(299), {"nb": 1, "nf": 1}, "inputs must be"),
        (np.full((300, 2), np.nan), np.ones(300), {"nb": 1, "nf": 1}, "must be finite"),
    ],
)
def test_unusable_records_are_refused(u, y, orders, says):
    with pytest.raises(ValueError, match=says):
        estimate_multi_input(u, y, orders, "oe")
