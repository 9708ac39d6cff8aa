"""State-space estimates against finite differences, closed forms and another optimiser."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import least_squares
from scipy.signal import lfilter

from evopem.config.settings import SearchSettings
from evopem.estimation.criteria import _recursion, autoregression_of
from evopem.estimation.damped_descent import descend
from evopem.estimation.delays import estimate_delays
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.estimate import estimate_state_space, estimates_of_orders
from evopem.estimation.state_space.local_estimates import (
    WEIGHTINGS,
    StateSpaceTask,
    descend_from,
)
from evopem.estimation.state_space.point_model import (
    PointModel,
    _basis_of,
    parameter_covariance,
    weighed_jacobians,
)
from evopem.estimation.state_space.problem import StateSpaceProblem
from evopem.estimation.state_space.scaled_recording import scaled_recording
from evopem.estimation.state_space.search import Rung, converted, descended, reductions
from evopem.estimation.state_space.sections import (
    Layout,
    SectionSignals,
    input_matrix,
    inside,
    largest_radius,
    moved,
    normalised,
    sections_of,
    state_matrix,
)
from evopem.estimation.state_space.starting_models import StartingModels
from evopem.estimation.state_space.starting_points import (
    extended,
    from_poles,
    point_of,
    point_of_model,
    poles_only,
    random_poles,
)
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, concatenated

RATE = 100.0
FAST = SearchSettings(objective="quadratic", evaluations=0)


def system(seed=0, modes=2, nu=2, ny=3, damping=0.03, structure="ss"):
    """A model with lightly damped modes, in states without special structure."""
    generator = np.random.default_rng(seed)
    n = 2 * modes
    A = np.zeros((n, n))
    for k in range(modes):
        angle = np.pi * (0.1 + 0.5 * (k + 0.5 * generator.random()) / modes)
        pole = np.exp((-damping + 1j) * angle)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    T = generator.standard_normal((n, n))
    dynamics = T @ A @ np.linalg.inv(T)
    C = generator.standard_normal((ny, n)) @ np.linalg.inv(T)
    K = np.zeros((n, ny))
    if structure == "ss":
        # The gain of a Kalman filter: it keeps the predictor stable.
        process = 0.1 * T @ T.T
        P = solve_discrete_are(dynamics.T, C.T, process, np.eye(ny))
        K = dynamics @ P @ C.T @ np.linalg.inv(C @ P @ C.T + np.eye(ny))
    model = StateSpaceModel(
        A=dynamics,
        B=T @ generator.standard_normal((n, nu)),
        C=C,
        D=np.zeros((ny, nu)),
        K=K,
        sampling_rate=RATE,
        level=generator.standard_normal(ny),
        noise_covariance=np.eye(ny),
        structure=structure,
    )
    assert np.abs(model.noise_zeros()).max() < 1.0
    return model


def record_of(u, y):
    """A recording of arrays, or of lists of them."""
    if isinstance(y, np.ndarray):
        return Recording(np.empty((len(y), 0)) if u is None else u, y, RATE)
    return concatenated([record_of(*each) for each in zip(u, y, strict=True)])


def recorded(model, samples, noise, seed):
    """Inputs, outputs and initial state of a record with white inputs."""
    generator = np.random.default_rng([seed, samples])
    u = generator.standard_normal((samples, model.inputs))
    e = noise * generator.standard_normal((samples, model.outputs))
    x = x0 = generator.standard_normal(model.order)
    y = np.empty_like(e)
    for t in range(samples):
        y[t] = model.level + model.C @ x + model.D @ u[t] + e[t]
        x = model.A @ x + model.B @ u[t] + model.K @ e[t]
    return u, y, x0


def problem(structure, order, weighting="determinant", samples=200):
    u, y, _ = recorded(system(), samples, 0.3, 1)
    half = samples // 2
    record = scaled_recording(record_of([u[:half], u[half:]], [y[:half], y[half:]]), [0, 1], True)
    errors = StateSpaceErrors(record, order, structure, weighting)
    point = poles_only(errors.layout, random_poles(order, np.random.default_rng(order)))
    rows = errors.layout.rows(point)
    generator = np.random.default_rng(9)
    rows[:, 2:] = generator.standard_normal(rows[:, 2:].shape)
    rows[~errors.layout.free()] = 0.0
    return errors, normalised(errors.layout, inside(errors.layout, point, 0.9))


@pytest.mark.parametrize("structure", ["ss", "ss_oe"])
@pytest.mark.parametrize("order", [1, 4, 5])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_the_gradient_agrees_with_finite_differences(structure, order, weighting):
    errors, point = problem(structure, order, weighting)
    gradient = errors.normal_equations(errors.projection(point))[0]
    step, numeric = 1e-6, np.empty(errors.layout.dimension)
    for k, unit in enumerate(np.eye(errors.layout.dimension)):
        values = [
            errors.criterion(
                errors.projection(moved(errors.layout, point, sign * step * unit)).covariance
            )
            for sign in (1, -1)
        ]
        numeric[k] = (values[0] - values[1]) / (2.0 * step)
    np.testing.assert_allclose(gradient, numeric, atol=2e-6 * np.abs(numeric).max())


def test_a_state_that_no_output_sees_is_kept():
    """As of y = 2 u, whose states all come from rounding."""
    unseen = np.array([[1.0, 0.0]])
    np.testing.assert_array_equal(_basis_of(np.diag([0.5, 0.2]), unseen), np.eye(2))


@pytest.mark.parametrize("structure", ["ss", "ss_oe"])
def test_the_model_of_a_point_has_the_errors_of_the_point(structure):
    errors, point = problem(structure, 5)
    record = errors.data
    found = errors.projection(point)
    model = PointModel(errors, found).model()
    y = record.outputs * record.output_scales + record.output_offsets
    u = record.inputs * record.input_scales
    point_model = PointModel(errors, found)
    states, levels = point_model.initial_states(), point_model.levels()
    for k, (first, stop) in enumerate(zip(record.bounds[:-1], record.bounds[1:], strict=True)):
        part = slice(first, stop)
        own = model.with_parameters(np.concatenate([model.parameters[: -model.outputs], levels[k]]))
        residuals = own.residuals(u[part], y[part], states[k])
        expected = found.errors[part] * record.output_scales
        np.testing.assert_allclose(residuals, expected, atol=1e-9)


@pytest.mark.parametrize("apart", [0.3, 1e-4, 1e-7])  # from products, near their bound, without
def test_errors_are_those_of_least_squares(apart):
    errors, _ = problem("ss_oe", 6)
    point = from_poles(errors, 0.9 - 0.3 * np.arange(6) + 0j)
    rows = errors.layout.rows(point)
    rows[1] = rows[0]
    rows[1, 0] -= apart
    found = errors.projection(point)
    assert (found.factor is None) == (apart == 1e-7)
    scaled = found.regressors / np.linalg.norm(found.regressors, axis=0)
    basis, y = np.linalg.qr(scaled)[0], errors.data.outputs
    np.testing.assert_allclose(found.errors, y - basis @ (basis.T @ y), atol=1e-9)
    # Corrected seminormal equations leave the rounding of what they multiply (Björck 1987).
    assert np.abs(found.basis.T @ found.errors).max() < 1e-15 * (100.0 + np.linalg.cond(scaled))
    unity = np.eye(found.basis.shape[1])
    np.testing.assert_allclose(found.basis.T @ found.basis, unity, atol=1e-13)


@pytest.mark.parametrize("order", [3, 6])
def test_a_change_of_basis_leaves_the_point_equivalent(order):
    errors, point = problem("ss_oe", order)
    found = errors.projection(point)
    T = np.random.default_rng(1).standard_normal((order, order))
    A = state_matrix(sections_of(errors.layout, point), errors.layout)
    other = point_of(
        errors.layout, T @ A @ np.linalg.inv(T), T @ input_matrix(found.sections, errors.layout)
    )
    np.testing.assert_allclose(errors.projection(other).errors, found.errors, atol=1e-7)


def test_poles_pass_smoothly_from_complex_to_real():
    """A pair of real poles is found from a start with complex ones."""
    truth = StateSpaceModel(
        A=np.diag([0.9, 0.6]), B=np.ones((2, 1)), C=np.array([[1.0, -0.5], [0.3, 1.0]]),
        D=np.zeros((2, 1)), K=np.zeros((2, 2)), sampling_rate=1.0, level=np.zeros(2),
        noise_covariance=np.eye(2), structure="ss_oe",
    )  # fmt: skip
    u = np.random.default_rng(0).standard_normal((300, 1))
    record = scaled_recording(record_of([u], [truth.simulate(u)]), [1], False)
    errors = StateSpaceErrors(record, 2, "ss_oe")
    found = descend(errors, from_poles(errors, np.array([0.7 + 0.3j, 0.7 - 0.3j])), 200, 1e-12)
    model = PointModel(errors, errors.projection(found.point)).model()
    np.testing.assert_allclose(np.sort(model.poles().real), [0.6, 0.9], atol=1e-6)


def test_poles_beyond_the_radius_are_moved_to_it():
    errors, _ = problem("ss_oe", 5)
    poles = np.array([1.2 * np.exp(0.5j), 1.2 * np.exp(-0.5j), 1.1, -0.2, 0.4])
    point = inside(errors.layout, poles_only(errors.layout, poles), 0.95)
    assert largest_radius(errors.layout, point) == pytest.approx(0.95)
    A = state_matrix(sections_of(errors.layout, point), errors.layout)
    angle = np.angle(np.linalg.eigvals(A))
    assert np.min(np.abs(angle - 0.5)) < 1e-12


def test_a_truth_without_noise_is_found_exactly():
    truth = system(structure="ss_oe")
    u, y, _ = recorded(truth, 300, 0.0, 1)
    found = estimate_state_space(record_of(u, y), 4, structure="ss_oe", settings=FAST)
    f = np.array([1.0, 10.0, 30.0])
    np.testing.assert_allclose(
        found.model.frequency_response(f), truth.frequency_response(f), rtol=1e-5
    )
    np.testing.assert_allclose(found.model.level, truth.level, atol=1e-6)


def full_model_errors(p, u, y, n, scale):
    """Residuals of innovations form with all entries free: an independent parametrisation."""
    nu, ny = u.shape[1], y.shape[1]
    ends = np.cumsum([n * n, n * nu, ny * n, n * ny, ny])
    A, B, C, K, level, x = np.split(p, ends)
    A, B, C, K = A.reshape(n, n), B.reshape(n, nu), C.reshape(ny, n), K.reshape(n, ny)
    e = np.empty_like(y)
    for t in range(len(y)):
        e[t] = y[t] - level - C @ x
        x = A @ x + B @ u[t] + K @ e[t]
    return np.nan_to_num((e / scale).ravel(), nan=1e3, posinf=1e3, neginf=-1e3).clip(-1e3, 1e3)


def test_the_optimum_is_one_for_another_optimiser():
    truth = system(modes=1, ny=2)
    u, y, x0 = recorded(truth, 150, 0.3, 2)
    settings = replace(FAST, evaluations=300)
    found = estimate_state_space(record_of(u, y), 2, weighting="power", settings=settings)
    scale = y.std(axis=0)
    m = found.model
    start = np.concatenate(
        [part.ravel() for part in (truth.A, truth.B, truth.C, truth.K, truth.level, x0)]
    )
    peer = least_squares(full_model_errors, start, args=(u, y, 2, scale), xtol=1e-14, ftol=1e-14)
    percent = 100.0 * 2.0 * peer.cost / y.size
    assert percent * (1.0 - 1e-4) < found.objective < percent * (1.0 + 1e-6)
    own = np.concatenate(
        [part.ravel() for part in (m.A, m.B, m.C, m.K, m.level, found.initial_states[0])]
    )
    errors = full_model_errors(own, u, y, 2, scale)
    assert 100.0 * errors @ errors / y.size == pytest.approx(found.objective, rel=1e-9)


@pytest.mark.parametrize("structure", ["ss", "ss_oe"])
def test_the_covariance_is_that_of_a_numerical_jacobian(structure):
    """Standard errors of the frequency response from an independent parametrisation."""
    truth = system(modes=1, ny=2, nu=1, structure=structure)
    u, y, _ = recorded(truth, 200, 0.3, 3)
    record = scaled_recording(record_of([u], [y]), [1], True)
    errors = StateSpaceErrors(record, 2, structure)
    point = descend(errors, from_poles(errors, truth.noise_zeros()), 300, 1e-13).point
    found = errors.projection(point)
    model = PointModel(errors, found).model()
    covariance = parameter_covariance(errors, found)
    state = np.zeros(2)

    def of(p):
        K = p[8:12].reshape(2, 2) if structure == "ss" else np.zeros((2, 2))
        return StateSpaceModel(
            A=p[:4].reshape(2, 2), B=p[4:6].reshape(2, 1), C=p[-8:-4].reshape(2, 2),
            D=np.zeros((2, 1)), K=K, sampling_rate=RATE, level=p[-4:-2],
            noise_covariance=np.eye(2), structure=structure,
        ), p[-2:]  # fmt: skip

    state = PointModel(errors, found).initial_states()[0]
    gain = [model.K.ravel()] if structure == "ss" else [np.empty(0)]
    p0 = np.concatenate(
        [model.A.ravel(), model.B.ravel(), np.empty(2), *gain, model.C.ravel(), model.level, state]
    )
    p0 = np.concatenate([p0[:6], np.zeros(2), p0[8:]])
    whitener = np.linalg.inv(np.linalg.cholesky(model.noise_covariance))

    def residuals(p):
        m, x0 = of(p)
        return (m.residuals(u, y, x0) @ whitener.T).ravel()

    def response(p):
        g = of(p)[0].frequency_response(np.array([5.0, 15.0])).ravel()
        return np.concatenate([g.real, g.imag])

    def slopes(function):
        step = 1e-6
        return np.array(
            [
                (function(p0 + step * k) - function(p0 - step * k)) / (2 * step)
                for k in np.eye(len(p0))
            ]
        ).T

    J, G = slopes(residuals), slopes(response)
    expected = np.sqrt(np.diag(G @ np.linalg.pinv(J.T @ J, rcond=1e-11, hermitian=True) @ G.T))

    def entries_response(p):
        g = model.with_parameters(p).frequency_response(np.array([5.0, 15.0])).ravel()
        return np.concatenate([g.real, g.imag])

    q0, step = model.parameters, 1e-6
    gradients = np.array(
        [(entries_response(q0 + step * k) - entries_response(q0 - step * k)) / (2 * step)
         for k in np.eye(len(q0))]
    ).T  # fmt: skip
    np.testing.assert_allclose(covariance.standard_errors(gradients), expected, rtol=1e-3)


def test_jacobians_of_all_outputs_are_weighed_by_one_gram_matrix():
    errors, point = problem("ss", 5)
    solved = errors.projection(point)
    signals = errors.signals.derivatives(solved.sections, solved.states)
    ny, parts = errors.data.outputs.shape[1], []
    for output in range(ny):
        columns, places = errors.jacobian(solved, signals, output)
        parts.append(np.zeros((len(columns), errors.layout.dimension + solved.linear.size)))
        parts[-1][:, places] = columns
    root = np.random.default_rng(2).standard_normal((ny, ny))
    weights = root @ root.T
    expected = sum(weights[i, j] * parts[i].T @ parts[j] for i in range(ny) for j in range(ny))
    found = weighed_jacobians(errors, solved, signals, weights)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_many_lags_of_coloured_errors_are_summed_by_filters(monkeypatch):
    truth = system(modes=1, ny=2, nu=1, structure="ss_oe")
    u, y, _ = recorded(truth, 300, 0.3, 3)
    y += lfilter([1.0], [1.0, -1.2, 0.3], y, axis=0)
    record = scaled_recording(record_of([u[:100], u[100:]], [y[:100], y[100:]]), [1], True)
    errors = StateSpaceErrors(record, 3, "ss_oe")
    found = errors.projection(from_poles(errors, random_poles(3, np.random.default_rng(1))))
    by_filters = np.linalg.norm(parameter_covariance(errors, found).factor, axis=1)

    def by_lags(signals, of_lags, bounds):
        passed, most = np.zeros_like(signals), len(of_lags) // 2
        for first, stop in pairwise(bounds):
            for k in range(max(-most, first - stop + 1), min(most, stop - first - 1) + 1):
                after, before = max(k, 0), max(-k, 0)
                earlier = signals[first + before : stop - after]
                passed[first + after : stop - before] += of_lags[most + k] * earlier
        return passed

    monkeypatch.setattr("evopem.estimation.state_space.point_model._filtered", by_lags)
    listed = np.linalg.norm(parameter_covariance(errors, found).factor, axis=1)
    np.testing.assert_allclose(by_filters, listed, rtol=1e-6)


def test_decayed_responses_leave_no_subnormal_numbers():
    layout = Layout(2, 1)
    signals = SectionSignals(layout, np.empty((3000, 0)), np.array([0, 3000]))
    responses = signals.responses(sections_of(layout, np.array([0.5, -0.09, 1.0, 0.0])))
    assert not responses[2000:].any()
    assert np.abs(responses[responses != 0.0]).min() > np.finfo(float).tiny


def test_an_output_error_model_is_an_innovations_model_without_gain():
    errors, point = problem("ss_oe", 4)
    other = replace(errors, structure="ss")
    value = errors.criterion(errors.projection(point).covariance)
    there = converted(other, errors, point)
    # Its initial states are fitted anew, to the first samples.
    assert other.criterion(other.projection(there).covariance) == pytest.approx(value, rel=0.05)
    back = converted(errors, other, there)
    assert errors.criterion(errors.projection(back).covariance) == pytest.approx(value, rel=0.05)


def test_several_records_have_their_own_states_and_levels():
    truth = system(structure="ss_oe")
    u1, y1, _ = recorded(truth, 150, 0.05, 1)
    u2, y2, _ = recorded(truth, 100, 0.05, 2)
    y2 = y2 + 5.0
    found = estimate_state_space(
        record_of([u1, u2], [y1, y2]),
        4,
        structure="ss_oe",
        settings=FAST,
    )
    np.testing.assert_allclose(found.segment_levels[1] - found.segment_levels[0], 5.0, atol=0.1)
    assert [len(e) for e in found.residuals] == [150, 100]
    assert found.objective < 1.0


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_slow_changes_of_the_outputs_are_no_part_of_the_plant(objective):
    """Two records whose levels wander, and inputs of a slow plant that follow them."""
    truth = StateSpaceModel(
        A=np.array([[0.97]]),
        B=np.array([[0.03]]),
        C=np.array([[1.0], [-2.0]]),
        D=np.zeros((2, 1)),
        K=np.zeros((1, 2)),
        sampling_rate=RATE,
        level=np.array([2.0, 1.0]),
        noise_covariance=np.eye(2),
        structure="ss_oe",
    )
    generator = np.random.default_rng(5)
    inputs, steady, drifting = [], [], []
    for samples in (600, 400):
        wave = np.cos(2 * np.pi * np.arange(0.5, samples) / samples)[:, None]
        u = np.repeat(generator.standard_normal((samples // 40, 1)), 40, axis=0) - wave
        y = truth.simulate(u) + 0.05 * generator.standard_normal((samples, 2))
        inputs.append(u)
        steady.append(y)
        drifting.append(y + wave * [0.8, -0.5])

    def estimated(outputs, period=None):
        settings = replace(FAST, objective=objective)
        task = StateSpaceTask("ss_oe", settings=settings, drift_period=period)
        return descend_from(truth, record_of(inputs, outputs), task)

    alone, biased = estimated(steady), estimated(drifting)
    found = estimated(drifting, 200.0)

    def gain(estimate):
        return estimate.model.frequency_response([0.0]).real.ravel()

    assert np.abs(gain(biased) - [1.0, -2.0]).max() > 0.1
    np.testing.assert_allclose(gain(found), [1.0, -2.0], atol=0.03)
    np.testing.assert_allclose(found.model.level, alone.model.level, atol=0.05)
    np.testing.assert_allclose(np.std(found.residuals[0], axis=0), 0.05, rtol=0.1)


def test_a_drift_goes_on_over_missing_samples():
    """A level that rises over a gap, beside an input that is nothing of it."""
    truth = StateSpaceModel(
        *(np.array([[0.9]]), np.array([[0.1]]), np.eye(1), np.zeros((1, 1)), np.zeros((1, 1))),
        sampling_rate=RATE,
        level=np.zeros(1),
        noise_covariance=np.eye(1),
        structure="ss_oe",
    )
    generator = np.random.default_rng(6)
    u = generator.standard_normal((900, 1))
    rise = -np.cos(np.pi * np.arange(0.5, 900) / 900)[:, None]
    whole = Recording(
        u, truth.simulate(u) + rise + 0.05 * generator.standard_normal((900, 1)), RATE
    )
    (segment,) = whole.segments
    gapped = whole.with_segments([segment.between(0, 300), segment.between(600, 900)])
    task = StateSpaceTask("ss_oe", settings=FAST, drift_period=300.0)
    found = descend_from(truth, gapped, task)
    np.testing.assert_allclose(found.model.poles(), 0.9, atol=0.01)
    assert np.std(found.residuals) == pytest.approx(0.05, rel=0.1)
    # One drift, of as many cosines as without the gap; segments of other recordings have their own.
    of_whole, of_parts = (scaled_recording(r, 1, True, 300.0).drift for r in (whole, gapped))
    kept = of_whole[np.r_[:300, 600:900]]
    np.testing.assert_allclose(of_parts, kept - kept.mean(axis=0), atol=1e-12)
    apart = gapped.with_segments(
        [replace(part, recording=k) for k, part in enumerate(gapped.segments)]
    )
    assert scaled_recording(apart, 1, True, 300.0).drift.shape == (600, 4)


def test_the_drift_counts_as_parameters():
    truth = system(modes=1, structure="ss_oe")
    u, y, _ = recorded(truth, 500, 0.1, 4)
    record = scaled_recording(record_of([u, u[:300]], [y, y[:300]]), [1, 1], True, 200.0)
    errors = StateSpaceErrors(record, 2, "ss_oe")
    without = scaled_recording(record_of([u, u[:300]], [y, y[:300]]), [1, 1], True)
    # Periods of 200 samples and more: five of the first record and three of the second one.
    assert record.drift.shape == (800, 8)
    np.testing.assert_allclose(record.drift[:500].sum(axis=0), 0.0, atol=1e-9)
    assert errors.parameters == StateSpaceErrors(without, 2, "ss_oe").parameters + 3 * 8


def test_the_optimum_of_two_records_is_one_for_another_optimiser():
    truth = system(modes=1, ny=2)
    records = [recorded(truth, 150, 0.3, 2), recorded(truth, 90, 0.3, 3)]
    us, ys, starts = zip(*records, strict=True)
    ys = (ys[0], ys[1] + 4.0)
    found = estimate_state_space(record_of(us, ys), 2, weighting="power", settings=FAST)
    scale = np.sqrt(np.mean((np.concatenate(ys) - np.concatenate(ys).mean(axis=0)) ** 2, axis=0))

    def errors(point):
        own = point[-8:].reshape(2, -1)  # level and initial state of each record
        points = [np.concatenate([point[:-8], part]) for part in own]
        signals = zip(points, us, ys, strict=True)
        return np.concatenate([full_model_errors(p, u, y, 2, scale) for p, u, y in signals])

    def point_of(model, levels, states):
        parts = [part.ravel() for part in (model.A, model.B, model.C, model.K)]
        return np.concatenate([*parts, *np.hstack([levels, states])])

    start = point_of(truth, [truth.level, truth.level + 4.0], starts)
    peer = least_squares(errors, start, xtol=1e-12, ftol=1e-12)
    values = sum(y.size for y in ys)
    assert found.objective <= 200.0 * peer.cost / values * (1.0 + 1e-6)
    own = point_of(found.model, found.segment_levels, found.initial_states)
    squares = errors(own) @ errors(own)
    assert 100.0 * squares / values == pytest.approx(found.objective, rel=1e-9)
    improved = least_squares(errors, own, xtol=1e-12, ftol=1e-12)
    assert 2.0 * improved.cost == pytest.approx(squares, rel=1e-6)


def test_halves_of_a_record_with_states_of_their_own_cover_the_truth():
    truth = system(modes=1, ny=2, structure="ss_oe")
    (true,) = truth.modes()
    deviations = []
    for seed in range(60):
        u, y, _ = recorded(truth, 200, 0.5, 100 + seed)
        halves = [u[:100], u[100:]], [y[:100], y[100:]]
        found = descend_from(truth, record_of(*halves), StateSpaceTask("ss_oe", weighting="noise"))
        (mode,) = found.model.modes()
        deviations += [
            (mode.frequency_hz - true.frequency_hz) / mode.frequency_se_hz,
            (mode.damping_ratio - true.damping_ratio) / mode.damping_se,
        ]
    # 120 intervals of 95 %: 114 are expected to cover, 107 or fewer by chance once in 300 times.
    assert np.sum(np.abs(deviations) < 1.96) > 107


def test_delays_of_joined_records_are_those_of_the_truth():
    generator = np.random.default_rng(3)
    us = [generator.standard_normal((samples, 2)) for samples in (150, 60, 90)]
    ys = []
    for number, u in enumerate(us):
        y = 5.0 * number + 0.1 * generator.standard_normal((len(u), 1))
        y[1:, 0] += u[:-1, 0]
        y[3:, 0] += 0.5 * u[:-3, 1]
        ys.append(y)
    assert estimate_delays(record_of(us, ys)) == (1, 3)


def test_delays_by_input_are_taken_out_and_put_back():
    truth = system(structure="ss_oe")
    u, _, _ = recorded(truth, 200, 0.0, 1)
    delayed = np.column_stack([u[:, 0], np.concatenate([np.zeros(3), u[:-3, 1]])])
    y = truth.simulate(delayed)
    y += 0.01 * np.random.default_rng(1).standard_normal(y.shape)
    found = estimate_state_space(
        record_of(u, y),
        4,
        structure="ss_oe",
        delays=(1, 4),
        settings=FAST,
    )
    assert found.model.input_delays == (0, 3)
    assert np.isnan(found.residuals[0][:3]).all()
    left = y - found.model.simulate_from_fitted_state(u, y)
    assert (np.std(left, axis=0) < 0.02 * np.std(y, axis=0)).all()


def test_without_inputs_the_modes_of_the_noise_are_found():
    truth = system(nu=0, damping=0.02)
    _, y, _ = recorded(truth, 3000, 1.0, 5)
    found = estimate_state_space(record_of(None, y), 4, settings=FAST)
    for mode, true in zip(found.model.modes(), truth.modes(), strict=True):
        assert abs(mode.frequency_hz - true.frequency_hz) < 4.0 * mode.frequency_se_hz
        assert mode.frequency_se_hz < 0.3


def test_a_sweep_never_rises_with_the_order_by_much_and_finds_the_true_one():
    truth = system()
    u, y, _ = recorded(truth, 300, 0.3, 6)
    estimates = list(estimates_of_orders(record_of(u, y), range(2, 6)))
    assert all(estimate.model.covariance is not None for estimate in estimates)
    (bare,) = estimates_of_orders(record_of(u, y), [2], covariances=False)
    assert bare.model.covariance is None
    assert min(estimates, key=lambda each: each.bic).model.order == 4
    objectives = [estimate.objective for estimate in estimates]
    assert all(later <= earlier * 1.001 for earlier, later in pairwise(objectives))


def test_a_pair_left_out_of_a_larger_order_gives_the_smaller_one_back():
    errors, point = problem("ss", 5)
    larger = replace(errors, order=7)
    poles = random_poles(2, np.random.default_rng(3))
    (grown,) = extended(larger, errors.projection(point), [poles], 1)
    reduced = [
        errors.criterion(errors.projection(each).covariance) for each in reductions(larger, grown)
    ]
    assert len(reduced) == 3
    own = errors.criterion(errors.projection(point).covariance)
    assert min(abs(each - own) for each in reduced) < 1e-9


@pytest.mark.parametrize(("form", "order", "added"), [("ss", 4, 2), ("ss_oe", 3, 1), ("ss", 3, 4)])
def test_added_poles_are_ranked_by_the_errors_that_they_leave(form, order, added):
    errors, point = problem(form, order)
    larger = replace(errors, order=order + added)
    generator = np.random.default_rng(4)
    poles = [random_poles(added, generator) for _ in range(6)]
    solved = errors.projection(point)
    found = [
        larger.criterion(larger.projection(each).covariance)
        for each in extended(larger, solved, poles, 6)
    ]
    alone = [
        larger.criterion(larger.projection(extended(larger, solved, [each], 1)[0]).covariance)
        for each in poles
    ]
    np.testing.assert_allclose(found, sorted(alone), atol=1e-6)
    assert found[0] < errors.criterion(solved.covariance)
    assert np.ptp(found) > 1e-3


def test_an_order_is_reached_from_two_states_more():
    """An optimum that is not the lowest is left for the one that the larger order begins with."""
    u, y, _ = recorded(system(), 400, 0.3, 8)
    errors = StateSpaceErrors(scaled_recording(record_of([u], [y]), [1, 1], True), 4, "ss")
    larger = replace(errors, order=6)
    generator = np.random.default_rng(3)
    starts = list(StartingModels(errors, 6, thorough=True).points(errors))
    best, *_ = descended(errors, starts, 8)
    (grown,) = extended(larger, errors.projection(best.point), [random_poles(2, generator)], 1)
    above = descend(larger, grown, 20, 0)
    poor = from_poles(errors, random_poles(4, generator))
    known = descend(errors, poor, 1, 1e-7)
    assert known.value > best.value + 0.1
    rung = Rung(errors, [known]).lowered(Rung(larger, [above]), 100)
    assert rung.optima[0].value == pytest.approx(best.value, abs=1e-6)
    assert rung.optima[1] is known


def test_the_same_seed_gives_the_same_bits():
    u, y, _ = recorded(system(modes=1, ny=2), 80, 0.3, 7)
    settings = replace(FAST, evaluations=60)
    one, two = (estimate_state_space(record_of(u, y), 2, settings=settings) for _ in range(2))
    np.testing.assert_array_equal(one.model.parameters, two.model.parameters)


def test_input_that_cannot_be_used_is_refused():
    u, y, _ = recorded(system(), 60, 0.3, 8)
    with pytest.raises(ValueError, match="without one, use innovations"):
        estimate_state_space(record_of(None, y), 2, structure="ss_oe")
    with pytest.raises(ValueError, match="needs more than"):
        estimate_state_space(record_of(u, y), 25)
    with pytest.raises(ValueError, match="must be finite"):
        estimate_state_space(record_of(u, np.where(y > 1.0, np.nan, y)), 2)
    with pytest.raises(ValueError, match="2 inputs need 2 delays"):
        estimate_state_space(record_of(u, y), 2, delays=(1,))


def test_delays_are_those_of_the_truth():
    truth = system(structure="ss_oe")
    u, _, _ = recorded(truth, 600, 0.0, 1)
    delayed = np.column_stack([u[:, 0], np.concatenate([np.zeros(4), u[:-4, 1]])])
    y = truth.simulate(delayed) + 0.1 * np.random.default_rng(1).standard_normal((600, 3))
    assert estimate_delays(record_of(u, y)) == (1, 5)


def test_noise_does_not_make_delays_of_inputs_that_act_at_once():
    truth = system(2, modes=4, nu=2, ny=8, damping=0.01, structure="ss_oe")
    generator = np.random.default_rng(2)
    u = generator.standard_normal((600, 2))
    clean = truth.simulate(u)
    noise = 0.5 * clean.std(axis=0) * generator.standard_normal(clean.shape)
    assert max(estimate_delays(record_of(u, clean + noise))) == 1


def test_the_recursion_ends_where_past_errors_are_one_signal():
    ones = np.ones((3, 2, 2))
    assert len(list(_recursion(ones, 2))) == 1


def test_the_recursion_solves_the_yule_walker_equations():
    generator = np.random.default_rng(5)
    e = generator.standard_normal((3000, 2))
    for t in range(2, len(e)):
        e[t] += [[0.5, 0.2], [-0.3, 0.4]] @ e[t - 1] - 0.3 * e[t - 2]
    found = autoregression_of(e, np.array([0, len(e)]))
    assert len(found.coefficients) == 2
    gamma = found.autocovariances
    big = np.block([[gamma[0], gamma[1]], [gamma[1].T, gamma[0]]])
    expected = np.linalg.solve(big, np.vstack([gamma[1].T, gamma[2].T]))
    np.testing.assert_allclose(np.vstack([c.T for c in found.coefficients]), expected, atol=1e-10)


def test_nearly_equal_poles_do_not_spoil_the_matrices():
    """Sections of nearly equal poles cancel each other; the entries of the model stay moderate."""
    truth = StateSpaceModel(
        A=np.array([[0.9, 1.0, 0.0], [0.0, 0.9, 1.0], [0.0, 0.0, 0.9]]),
        B=np.array([[0.0], [0.0], [1.0]]),
        C=np.array([[1.0, 0.0, 0.0]]),
        D=np.zeros((1, 1)),
        K=np.zeros((3, 1)),
        sampling_rate=RATE,
        level=np.zeros(1),
        noise_covariance=np.eye(1),
        structure="ss_oe",
    )
    u = np.random.default_rng(6).standard_normal((600, 1))
    y = truth.simulate(u)
    found = estimate_state_space(record_of(u, y), 3, structure="ss_oe", settings=FAST)
    assert np.abs(found.model.A).max() < 10.0
    simulated = found.model.simulate(u, found.initial_states[0])
    np.testing.assert_allclose(y - simulated, found.residuals[0], atol=1e-6 * y.std())


def test_held_out_outputs_determine_no_state_of_a_simulation():
    truth = system(structure="ss_oe")
    generator = np.random.default_rng(7)
    u = generator.standard_normal((300, 2))
    y = truth.simulate(u, np.ones(truth.order))
    disturbance = generator.standard_normal((100, 3))
    y[200:] += disturbance
    found = truth.simulate_from_fitted_state(u, y, known=200)
    np.testing.assert_allclose((y - found)[200:], disturbance, atol=1e-6)


def last_order(recording, orders, **options):
    return list(estimates_of_orders(recording, orders, **options))[-1]


def test_a_predictor_that_forgets_goes_on_behind_the_samples():
    """Three poles in noise with one, and six states: two draw waves through the noise."""
    generator = np.random.default_rng(4)
    f = np.poly([0.9 * np.exp(0.6j), 0.9 * np.exp(-0.6j), 0.5]).real
    gains = generator.standard_normal((1, 2, 2))[0]
    u = generator.standard_normal((500, 2))
    x = sum(lfilter([0.0, *b], f, each) for b, each in zip(gains, u.T, strict=True))
    y = x + 0.1 * x.std() * lfilter([1.0], [1.0, -0.8], generator.standard_normal(500))
    y = y[:, None]
    known, error = Recording(u[:400], y[:400], 10.0), {}
    for forgets in (False, True):
        model = last_order(known, range(1, 7), forgets=forgets).model
        radius = np.abs(model.noise_zeros()).max()
        assert (radius <= np.exp(-3.0 / 400)) == forgets
        residuals = model.residuals(u, y, model.prediction_state(u[:400], y[:400]))[400:]
        error[forgets] = np.linalg.norm(residuals) / np.linalg.norm(y[400:] - y[400:].mean())
    assert error[True] < 0.13 < error[False]


def test_forgetting_costs_an_undamped_mode_the_likelihood_of_a_few_parameters():
    generator = np.random.default_rng(1)
    u = generator.standard_normal(600)
    pole = 0.9998 * np.exp(0.5j)
    x = lfilter([0.0, 1.0], np.poly([pole, pole.conjugate()]).real, u)
    recording = Recording(u, x + 0.2 * x.std() * generator.standard_normal(600), 1.0)
    free, forgetting = (last_order(recording, (1, 2), forgets=each) for each in (False, True))
    assert 0.0 <= 600 * np.log(forgetting.objective / free.objective) < 6.0
    for found in (free, forgetting):
        assert np.abs(found.model.poles()) == pytest.approx([0.9998] * 2, abs=5e-4)


def test_a_model_with_close_slow_poles_is_converted_as_it_is():
    """Its poles lie closer to each other than usual ones, and its initial state decays slowly."""
    poles = np.array([0.9996, 0.9995, 0.99945])
    residues = np.array([1.0, -0.7, 0.4])
    truth = StateSpaceModel(
        A=np.diag(poles),
        B=np.ones((3, 1)),
        C=residues[None, :],
        D=np.zeros((1, 1)),
        K=np.zeros((3, 1)),
        noise_covariance=np.eye(1),
        sampling_rate=10.0,
        level=np.zeros(1),
        structure="ss_oe",
    )
    generator = np.random.default_rng(3)
    u = generator.standard_normal(1500)
    y = truth.simulate(u, initial=[40.0, -50.0, 60.0])[:, 0]
    y += 1e-3 * y.std() * generator.standard_normal(1500)
    recording = Recording(u, y, 10.0)
    errors = StateSpaceTask("ss_oe", level=False).errors(recording, 3)
    start = point_of_model(truth, errors)
    converted_poles = np.linalg.eigvals(
        state_matrix(sections_of(errors.layout, start), errors.layout)
    )
    np.testing.assert_allclose(np.sort(converted_poles.real), np.sort(poles), atol=1e-5)
    assert StateSpaceProblem(errors).values(start[None, :])[0] < 1e-3


def test_the_initial_state_of_many_outputs_follows_from_their_first_samples():
    """Of 16 outputs 500 samples are 8000 values: what comes later changes no start."""
    model = system(nu=1, ny=16, structure="ss_oe")
    u, e = (np.random.default_rng(1).standard_normal((800, count)) for count in (1, 16))
    y = model.simulate(u) + e
    points = []
    for later in (1.0, 3.0):
        y[500:] *= later
        errors = StateSpaceTask("ss_oe").errors(Recording(u, y, RATE), model.order)
        points.append(point_of_model(model, errors))
    np.testing.assert_allclose(*points, rtol=1e-9, atol=1e-12)
