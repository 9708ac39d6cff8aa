"""Polynomial models with several inputs: derivatives, optima, orders, intervals."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.automatic.chosen_model import refitted_estimate
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import describe
from evopem.estimation.prediction_errors import scaled_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment, concatenated

ONE = np.ones(1)
A = np.convolve([1.0, -1.5, 0.8], [1.0, -0.6, 0.5])
B = (np.array([1.0, 0.5]), np.array([-0.7, 0.3, 0.2]))
F = (np.array([1.0, -1.5, 0.8]), np.array([1.0, -0.9]))
SHORT = SearchSettings(objective="quadratic", evaluations=200)
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


def errors_of(segments, orders, radius=0.9999):
    return PolynomialErrors(segments, orders, "quadratic", radius, radius, True)


@pytest.mark.parametrize("orders", CASES, ids=str)
def test_the_jacobian_is_the_derivative_of_the_residuals(orders):
    generator = np.random.default_rng(3)
    segments = [
        Segment(
            generator.standard_normal((n, 2)) * [1.0, 5.0],
            5.0 + 7.0 * generator.standard_normal(n),
            number,
        )
        for number, n in enumerate((90, 60))
    ]
    errors = errors_of(segments, orders, 0.999)
    point = errors.repair(0.4 * generator.standard_normal((1, errors.dimension)))[0]
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
    errors = errors_of([Segment(u, y, 0)], orders, 0.999)
    point = errors.repair(0.3 * generator.standard_normal((1, errors.dimension)))[0]
    point[orders.parameters + 1 :] = 0.0
    result = SearchResult(point, 0.0, SearchDiagnostics.none())
    model = describe(errors, result, 1.0).model
    expected = lfilter(model.A, [1.0], y) - model.level
    for i in (0, 1):
        b = np.concatenate([np.zeros(model.nk[i]), model.B[i]])
        expected -= lfilter(b, model.F[i], u[:, i])
    expected[:start] = 0.0
    expected = lfilter(model.D, model.C, expected)[start:]
    assert np.allclose(errors.residuals(point), expected, atol=1e-10)


def test_arx_is_ordinary_least_squares():
    u, y, _, _ = record_of("armax", 800, 1)
    orders = {"na": 4, "nb": [2, 3], "nk": [1, 3]}
    found = estimate(u, y, orders, structure="arx", settings=SHORT, level=True)
    t = np.arange(5, 800)
    columns = [-y[t - k] for k in range(1, 5)] + [u[t - k, 0] for k in (1, 2)]
    columns += [u[t - k, 1] for k in (3, 4, 5)] + [np.ones(len(t))]
    expected = np.linalg.lstsq(np.column_stack(columns), y[t], rcond=None)[0]
    assert np.allclose([*found.model.parameters, found.model.level], expected, rtol=1e-5)
    errors = y[t] - np.column_stack(columns) @ expected
    variance = errors @ errors / (len(t) - 10)
    assert found.model.noise_variance == pytest.approx(variance, rel=1e-8)
    gram = np.linalg.inv(np.column_stack(columns).T @ np.column_stack(columns))
    own = found.model.covariance.standard_errors(np.eye(9))
    assert np.allclose(own, np.sqrt(variance * np.diag(gram))[:9], rtol=1e-6)


ORDERS = {
    "armax": {"na": 4, "nb": [2, 3], "nc": 2, "nk": [1, 3]},
    "oe": {"nb": 2, "nf": [2, 1], "nk": [1, 3]},
    "bj": {"nb": 2, "nf": 2, "nc": 1, "nd": 1, "nk": [1, 3]},
}


def found_in(data, structure, settings=SHORT):
    return estimate(
        data, orders=ORDERS[structure], structure=structure, settings=settings, level=True
    )


def independent_optimum(segments, truth):
    """Residuals by Levenberg-Marquardt of MINPACK, by finite differences and from the truth."""
    problem = errors_of(segments, truth.orders)
    start = problem.completed_by_states(truth.parameters)
    peer = least_squares(problem.residuals, start, method="lm", xtol=1e-13, ftol=1e-13)
    return problem, peer


# States carry the weak prior of the objective, which the other method does not know.
PRIOR = 3e-5


@pytest.mark.parametrize("structure", TRUTHS)
def test_the_optimum_is_that_of_an_independent_solution_and_near_the_truth(structure):
    u, y, truth, variance = record_of(structure, 1500, 5)
    found = found_in(Recording(u, y, 50.0), structure)
    model = found.model
    deviation = model.parameters - truth.parameters
    errors = model.parameter_standard_errors()
    assert np.abs(deviation / errors).max() < 4.0
    assert 0.9 < model.noise_variance / variance < 1.1
    assert not found.at_stability_bound
    _, peer = independent_optimum([Segment(u, y, 0)], truth)
    residuals = found.residuals[np.isfinite(found.residuals)]
    assert residuals @ residuals <= peer.fun @ peer.fun * (1.0 + PRIOR)


@pytest.mark.parametrize("structure", TRUTHS)
def test_recordings_have_levels_and_states_of_their_own(structure):
    u, y, truth, _ = record_of(structure, 900, 5)
    y[500:] += 7.0
    data = concatenated([Recording(u[:500], y[:500], 50.0), Recording(u[500:], y[500:], 50.0)])
    found = found_in(data, structure)
    problem, peer = independent_optimum(data.segments, truth)
    residuals = found.residuals[np.isfinite(found.residuals)]
    assert residuals @ residuals <= peer.fun @ peer.fun * (1.0 + PRIOR)
    # No residual of a recording depends on level and states of the other one.
    one, other = (at for _, at in problem.places)
    columns, first = problem.jacobian(peer.x), problem.residual_counts()[0]
    assert not columns[:first, np.setdiff1d(other, one)].any()
    assert not columns[first:, np.setdiff1d(one, other)].any()
    start = found.window.residual_start
    assert len(found.residuals) == 900
    missing = np.flatnonzero(np.isnan(found.residuals))
    assert missing.tolist() == [*range(start), *range(500, 500 + start)]
    assert found.levels[1] - found.levels[0] == pytest.approx(7.0 * found.model.A.sum(), rel=0.3)


def test_same_bits_twice():
    u, y, _, _ = record_of("armax", 300, 6)
    orders = {"na": 2, "nb": 1, "nc": 1, "nk": [1, 3]}
    one, other = (estimate(u, y, orders, settings=SHORT, level=True) for _ in range(2))
    assert np.array_equal(one.model.parameters, other.model.parameters)


def test_a_fit_to_another_recording_is_its_optimum():
    u, y, truth, _ = record_of("armax", 1000, 7)
    data = Recording(u, y, 1.0)
    again = refitted_estimate(truth, data, SHORT).model
    found = estimate(data, orders=truth.orders, settings=SHORT, level=True).model
    assert np.allclose(again.parameters, found.parameters, atol=1e-4)


def test_coloured_noise_does_not_deceive_the_intervals_of_an_output_error_model():
    """95 % intervals of the static gains cover the truth; white noise assumed, they do not."""
    covered = []
    for seed in range(30):
        generator = np.random.default_rng(seed)
        u = lfilter([1.0], [1.0, -0.8], generator.standard_normal((600, 2)), axis=0)
        truth = PolynomialModel(*TRUTHS["oe"], nk=(1, 3), structure="oe")
        noise = lfilter([1.0], [1.0, -0.95], generator.standard_normal(600))
        y = truth.simulate(u) + noise * 0.2 * truth.simulate(u).std() / noise.std()
        errors, units = scaled_errors(errors_of([Segment(u, y, 0)], truth.orders))
        problem = PolynomialProblem(errors, [truth], own_starts=False)
        point = problem.descend(problem.starts()[:1]).points[0]
        result = SearchResult(units.restored(point), 0.0, SearchDiagnostics.none())
        model = describe(errors_of([Segment(u, y, 0)], truth.orders), result, 1.0).model

        def gains(parameters, model=model):
            return model.with_parameters(parameters).frequency_response(0.0).real.ravel()

        steps = 1e-6 * np.eye(len(model.parameters))
        slopes = np.array(
            [(gains(model.parameters + h) - gains(model.parameters - h)) / 2e-6 for h in steps]
        ).T
        errors = model.covariance.standard_errors(slopes)
        deviation = gains(model.parameters) - gains(truth.parameters)
        covered += list(np.abs(deviation) < 1.96 * errors)
    assert np.mean(covered) >= 0.86  # 95 % less three standard errors of 60 trials


@pytest.mark.parametrize(
    ("u", "y", "orders", "says"),
    [
        (np.ones((30, 2)), np.arange(30.0), {"nb": 9, "nf": 9}, "needs more than"),
        (np.ones((300, 2)), np.zeros(300), {"nb": 1, "nf": 1}, "the output is zero"),
        (np.ones((300, 2)), np.ones(299), {"nb": 1, "nf": 1}, "of one length"),
        (np.full((300, 2), np.nan), np.ones(300), {"nb": 1, "nf": 1}, "finite"),
    ],
)
def test_unusable_records_are_refused(u, y, orders, says):
    with pytest.raises(ValueError, match=says):
        estimate(u, y, orders, structure="oe", level=True)


@pytest.mark.parametrize("structure", ["armax", "arx"])
def test_simulation_errors_of_shared_poles_have_the_optimum_of_another_method(structure):
    u, y, _, _ = record_of("oe", 400, 8, noise=0.3)
    orders = {"na": 2, "nb": 1, "nk": [1, 3]} | ({"nc": 1} if structure == "armax" else {})
    found = estimate(
        *(u, y, orders), structure=structure, settings=SHORT, level=True, focus="simulation"
    )
    start = found.window.residual_start

    def errors(parameters):
        a, b, level, state = np.split(parameters, [2, 4, 5])
        driven = b[0] * u[start - 1 : -1, 0] + b[1] * u[start - 3 : -3, 1]
        driven[:2] += state
        return y[start:] - level - lfilter([1.0], [1.0, *a], driven)

    model = found.model
    begin = [*model.A[1:], model.B[0][0], model.B[1][0], model.output_level, 0.0, 0.0]
    other = least_squares(errors, begin, method="lm", xtol=1e-13, ftol=1e-13)
    lowest = 100.0 * (other.fun @ other.fun) / (y[start:] @ y[start:])
    assert found.focus_objective <= lowest * (1.0 + PRIOR)
    assert np.isfinite(model.parameter_standard_errors()).all()
