"""The compiled kernels of polynomial models against difference equations and differences."""

from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.settings import ScoringWindow
from evopem.estimation.pem.kernels.bfgs import descend, descend_by
from evopem.estimation.pem.kernels.polynomials import filter_rows, stability_barriers
from evopem.estimation.pem.kernels.record import CHUNK
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.staged_descent import damped_inverses
from evopem.models.orders import Orders
from evopem.signals.recording import Segment

START, LOSS_START = 11, 40
CASES = [
    (Orders(nb=3, nk=2), False),
    (Orders(na=2, nb=1, nk=1), True),
    (Orders(na=3, nc=2), False),
    (Orders(na=2, nb=3, nc=4, nk=3), False),
    (Orders(na=2, nb=2, nd=5), True),
    (Orders(na=1, nb=2, nc=2, nd=3, nk=1), False),
    (Orders(nb=2, nf=2, nk=1), False),
    (Orders(nb=4, nf=6), True),
    (Orders(nb=3, nc=2, nd=1, nf=4, nk=2), False),
    (Orders(na=2, nb=3, nc=5, nd=4, nf=3, nk=1), True),
    (Orders(na=7, nb=6, nc=7, nk=3), False),
    (Orders(na=2, nb=(3, 1), nc=2, nk=(0, 4)), False),
    (Orders(nb=(2, 3), nc=1, nd=2, nf=(4, 2), nk=(2, 1)), True),
    (Orders(na=1, nb=(2, 3, 1), nc=1, nf=(4, 0, 2), nk=(2, 1, 0)), True),
]


def problem(orders, level, objective="quadratic", samples=203, loss_start=LOSS_START):
    generator = np.random.default_rng(5)
    y = generator.standard_normal(samples)
    u = generator.standard_normal((samples, orders.inputs))
    window = ScoringWindow(START, loss_start)
    errors = PolynomialErrors([Segment(u, y)], orders, objective, 0.999, 0.995, level, window)
    return errors, u, y


def residuals_of(errors, point):
    """All residuals of the one stretch, (N,)."""
    ((stretch, own),) = errors.of_stretches(point)
    return stretch.residuals(own)


def population(errors, count, seed=0):
    """Feasible random points."""
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((count, errors.dimension))
    o = errors.orders
    parts = [o.part(name) for name in "acd"] + [o.part("f", i) for i in range(o.inputs)]
    for part in parts:
        order = part.stop - part.start
        for point in points:
            roots = rng.uniform(0.1, 0.7, order) * rng.choice([-1, 1], order)
            point[part] = np.atleast_1d(np.poly(roots))[1:]
    return points


def by_difference_equations(errors, u, y, point):
    o, parts = errors.orders, errors.parts
    a, c, d = (point[o.part(name)] for name in "acd")
    level = point[parts["level"]].sum()
    states, s = point[parts["plant"]], point[parts["noise"]]
    v, e = np.zeros((2, len(y)))
    v[START:] = lfilter([1.0, *a], [1.0], y)[START:] - level
    for i in range(o.inputs):
        b, f, x = point[o.part("b", i)], point[o.part("f", i)], np.zeros(len(y))
        g, states = np.split(states, [o.nf[i]])
        for t in range(START, len(y)):
            x[t] = -sum(b[j] * u[t - o.nk[i] - j, i] for j in range(o.nb[i]))
            x[t] -= sum(f[k] * x[t - 1 - k] for k in range(o.nf[i]))
            x[t] += g[t - START] if t - START < o.nf[i] else 0.0
        v += x
    for t in range(START, len(y)):
        e[t] = v[t] + sum(d[k] * v[t - 1 - k] for k in range(o.nd))
        e[t] -= sum(c[k] * e[t - 1 - k] for k in range(o.nc))
        e[t] += s[t - START] if t - START < o.noise_states else 0.0
    return e


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("samples", [200, 201, 203, 700])
def test_residuals_follow_the_difference_equations(orders, level, samples):
    errors, u, y = problem(orders, level, samples=samples)
    for point in population(errors, 2):
        expected = by_difference_equations(errors, u, y, point)
        np.testing.assert_allclose(residuals_of(errors, point), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_values_are_sums_of_losses(orders, level, objective):
    errors, _, y = problem(orders, level, objective, samples=700)
    total = np.abs if objective == "absolute" else np.square
    points = population(errors, 11)
    scale = 100 / np.sum(total(y[LOSS_START:]))
    unit = np.mean(np.abs(y[LOSS_START:])) if objective == "absolute" else 1.0
    parts = errors.parts
    expected = [
        np.sum(total(errors.residuals(point)))
        + 1e-6 * np.sum(point[parts["plant"]] ** 2) / unit
        + 1e-2 * np.sum(point[parts["noise"]] ** 2) / unit
        for point in points
    ]
    np.testing.assert_allclose(errors.values(points), scale * np.array(expected), rtol=1e-10)


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("loss_start", [START, LOSS_START])
def test_adjoint_gradient_is_the_derivative(orders, level, objective, loss_start):
    errors, _, _ = problem(orders, level, objective, samples=300, loss_start=loss_start)
    points = population(errors, 9)
    smoothing, barriers = np.full(9, 0.3), np.full(9, 0.2)
    _, gradients = errors.values_and_gradients(points, smoothing, barriers)
    scale = np.abs(gradients).max(axis=1)
    for i in range(errors.dimension):
        step = np.zeros(errors.dimension)
        step[i] = 1e-6
        up, _ = errors.values_and_gradients(points + step, smoothing, barriers)
        down, _ = errors.values_and_gradients(points - step, smoothing, barriers)
        np.testing.assert_allclose((up - down) / 2e-6 / scale, gradients[:, i] / scale, atol=2e-6)


@pytest.mark.parametrize("samples", [START + 128 * 2 + rest for rest in (1, 8, 20, 40, 127)])
def test_the_gradient_does_not_depend_on_where_stretches_begin(samples):
    """The first stretch may end before the first residual that counts."""
    errors, _, _ = problem(Orders(na=2, nb=2, nc=3, nd=2, nf=2), True, samples=samples)
    points, none = population(errors, 3), np.zeros(3)
    _, gradients = errors.values_and_gradients(points, none, none)
    for point, gradient in zip(points, gradients, strict=True):
        residuals = errors.residuals(point)
        expected = 2.0 * errors.loss_factor * errors.jacobian(point).T @ residuals
        expected += 2.0 * errors.state_weights() * point
        np.testing.assert_allclose(gradient, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("loss_start", [START, LOSS_START])
def test_the_jacobian_is_exact_from_the_first_residual_on(orders, level, loss_start):
    errors, _, _ = problem(orders, level, samples=400, loss_start=loss_start)
    (point,) = population(errors, 1)
    steps = 1e-6 * np.eye(errors.dimension)
    expected = np.column_stack(
        [(errors.residuals(point + h) - errors.residuals(point - h)) / 2e-6 for h in steps]
    )
    found = errors.jacobian(point)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("loss_start", [START, LOSS_START])
def test_the_gauss_newton_matrix_is_that_of_the_jacobian(orders, level, loss_start):
    errors, _, _ = problem(orders, level, samples=400, loss_start=loss_start)
    points, none = population(errors, 3), np.zeros(3)
    entries = errors.linear("b", "level", "noise")
    of_linear = errors.curvatures_of(points, none, entries)
    matrices = errors.curvatures(points, none, none)
    for point, found, linear in zip(points, matrices, of_linear, strict=True):
        jacobian = errors.jacobian(point)
        expected = 2.0 * errors.loss_factor * jacobian.T @ jacobian
        expected += 2.0 * np.diag(errors.state_weights())
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())
        np.testing.assert_allclose(linear, found[entries][:, entries], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("last", range(1, 6))
@pytest.mark.parametrize("inputs", [1, 2])
def test_the_gauss_newton_matrix_is_exact_when_few_samples_are_left_for_the_last_chunk(
    last, inputs
):
    """Responses to impulses have ended long before, also where the signals are kept."""
    orders = Orders("ararx", na=2, nb=(2,) * inputs, nd=2, nk=(1, 3)[:inputs])
    first = orders.first_residual
    generator = np.random.default_rng(last)
    u = generator.standard_normal((2 * CHUNK + first + last, inputs))
    y = generator.standard_normal(len(u))
    errors = PolynomialErrors([Segment(u, y)], orders, "quadratic", 0.99, 0.99, True)
    points = errors.repair(0.3 * generator.standard_normal((3, errors.dimension)))
    none = np.zeros(3)
    for point, found in zip(points, errors.curvatures(points, none, none), strict=True):
        jacobian = errors.jacobian(point)
        expected = 2.0 * errors.loss_factor * jacobian.T @ jacobian
        expected += 2.0 * np.diag(errors.state_weights())
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_long_record_in_blocks_has_the_jacobian_of_the_whole():
    errors, _, _ = problem(*CASES[-1], samples=20000)
    (point,) = population(errors, 1)
    blocks = list(errors.jacobian_blocks(point))
    assert len(blocks) > 2
    expected = np.concatenate(blocks)
    place = 8192 - LOSS_START + START  # the joint of two blocks
    step = 1e-6
    for k in range(errors.dimension):
        h = step * np.eye(errors.dimension)[k]
        change = (errors.residuals(point + h) - errors.residuals(point - h)) / (2.0 * step)
        rows = slice(place - 5, place + 5)
        np.testing.assert_allclose(expected[rows, k], change[rows], atol=1e-5)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("case", [CASES[3], CASES[9], CASES[-1]], ids=str)
def test_a_model_gets_the_same_bits_whatever_shares_its_pass(case, objective):
    errors, _, _ = problem(*case, objective, samples=1100)
    points = population(errors, 21)
    smoothing, barriers = np.full(21, 0.1), np.full(21, 0.2)
    together = errors.values_and_gradients(points, smoothing, barriers)
    for i in (0, 7, 8, 20):
        alone = errors.values_and_gradients(points[i : i + 1], smoothing[:1], barriers[:1])
        assert alone[0][0] == together[0][i]
        np.testing.assert_array_equal(alone[1][0], together[1][i])


def test_roots_have_the_radii_of_their_polynomials_and_repair_moves_them_inside():
    errors, _, _ = problem(Orders(na=1, nb=1, nc=1, nd=1, nf=1), False)
    inside = np.array([-0.998, 1.0, -0.99, -0.99, -0.998, 0.0, 0.0])
    points = np.tile(inside, (6, 1))
    for row, entry in enumerate((0, 2, 3, 4)):
        points[row, entry] = -0.9985 if entry in (2, 3) else -0.9995
    points[4] = np.nan
    np.testing.assert_array_equal(errors.feasible(points), [False] * 5 + [True])
    assert np.isinf(errors.values(points)[:5]).all()
    repaired = errors.repair(points)
    assert errors.feasible(repaired).all()
    np.testing.assert_array_equal(repaired[5], inside)


def test_an_output_error_model_simulates():
    errors, u, y = problem(Orders(nb=2, nf=2, nk=1), False)
    (point,) = population(errors, 1)
    simulated = lfilter([0.0, *point[:2]], [1.0, *point[2:4]], u[:, 0])
    # The states that make the recursion go on from before the first residual.
    state = [
        -np.dot(point[2:4], simulated[START - 1 : START - 3 : -1]),
        -point[3] * simulated[START - 1],
    ]
    point[4:6] = -np.array(state)
    expected = (y - simulated)[START:]
    np.testing.assert_allclose(residuals_of(errors, point)[START:], expected, rtol=1e-9, atol=1e-9)


def test_the_barrier_of_a_descent_is_that_of_all_monic_polynomials():
    errors, _, _ = problem(Orders(nb=3, nc=2, nd=1, nf=4, nk=2), False)
    points = population(errors, 5)
    none, weights = np.zeros(5), np.linspace(0.5, 2.0, 5)
    bare, bare_gradients = errors.values_and_gradients(points, none, none)
    with_barrier, gradients = errors.values_and_gradients(points, none, weights)
    values, slopes = np.zeros(5), np.zeros_like(points)
    matrices = np.zeros((5, errors.dimension, errors.dimension))
    for name in "cdf":
        part = errors.parts[name]
        own = np.ascontiguousarray(points[:, part])
        of_part = stability_barriers(own, errors.radius_of(name))
        values += of_part[0]
        slopes[:, part] = of_part[1]
        matrices[:, part, part] = of_part[2]
    np.testing.assert_allclose(with_barrier - bare, weights * values, rtol=1e-9)
    np.testing.assert_allclose(
        gradients - bare_gradients, weights[:, None] * slopes, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(
        errors.curvatures(points, none, weights) - errors.curvatures(points, none, none),
        weights[:, None, None] * matrices,
        rtol=1e-6,
        atol=1e-9,
    )


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_the_root_of_a_gauss_newton_matrix_has_it_as_its_square(orders, level, objective):
    errors, _, _ = problem(orders, level, objective, samples=400)
    points, smoothing, weights = population(errors, 3), np.full(3, 0.1), np.array([0.0, 0.5, 2.0])
    matrices = errors.curvatures(points, smoothing, weights)
    for point, weight, matrix in zip(points, weights, matrices, strict=True):
        root = errors.curvature_root(point, 0.1, weight)
        np.testing.assert_allclose(root.T @ root, matrix, atol=1e-9 * np.abs(matrix).max())


@pytest.mark.parametrize("degree", [1, 2, 5, 8])
def test_the_stability_barrier_is_the_log_variance_of_filtered_noise(degree):
    """Of white noise through 1/A: sum of the squared impulse response (Jury's identity)."""
    generator = np.random.default_rng(degree)
    roots = (
        0.95 * generator.random(degree // 2) * np.exp(1j * np.pi * generator.random(degree // 2))
    )
    roots = np.concatenate([roots, roots.conj(), [0.3] * (degree % 2)])
    coefficients = np.real(np.poly(roots))[1:]
    radius = 0.98
    scaled = np.concatenate([[1.0], coefficients / radius ** np.arange(1, degree + 1)])
    response = lfilter([1.0], scaled, np.eye(1, 20000)[0])
    values, gradients, curvatures = stability_barriers(coefficients[None, :], radius)
    np.testing.assert_allclose(values[0], np.log(response @ response), rtol=1e-9, atol=1e-12)
    for j in range(degree):
        step = 1e-6 * np.eye(degree)[j]
        moved = np.array([coefficients + step, coefficients - step])
        up, down = stability_barriers(moved, radius)[0]
        np.testing.assert_allclose(gradients[0, j], (up - down) / 2e-6, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(curvatures[0], curvatures[0].T, rtol=1e-9)
    assert np.linalg.eigvalsh(curvatures[0])[0] > -1e-9 * np.linalg.norm(curvatures[0])


def test_the_stability_barrier_is_infinite_outside():
    values, gradients, curvatures = stability_barriers(
        np.array([[-0.5], [-0.97], [-0.99], [np.nan]]), 0.98
    )
    assert np.isfinite(values[:2]).all()
    assert values[1] > values[0]
    assert np.isinf(values[2:]).all()
    np.testing.assert_array_equal(gradients[2:], 0.0)
    np.testing.assert_array_equal(curvatures[2:], 0.0)


@pytest.mark.parametrize("order", [0, 1, 4])
def test_rows_are_filtered_as_scipy_filters_them_piece_by_piece(order):
    generator = np.random.default_rng(order)
    denominator = np.poly(generator.uniform(-0.9, 0.9, order)) if order else np.ones(1)
    signals = generator.standard_normal((3, 200))
    expected = lfilter([1.0], denominator, signals)
    states = np.zeros((3, order))
    pieces = [signals[:, :70].copy(), signals[:, 70:].copy()]
    for piece in pieces:
        filter_rows(piece, denominator, states)
    np.testing.assert_array_equal(np.hstack(pieces), expected)


def test_the_record_is_not_modified():
    u, y = np.random.default_rng(1).standard_normal((2, 200))
    before = u.copy(), y.copy()
    orders, window = Orders(na=2, nb=1, nc=2), ScoringWindow(11, 40)
    errors = PolynomialErrors([Segment(u, y)], orders, "absolute", 0.999, 0.999, False, window)
    errors.values_and_gradients(population(errors, 5), np.full(5, 0.1), np.zeros(5))
    np.testing.assert_array_equal((u, y), before)


def of_stretches(objective):
    """Three stretches of two recordings, of different lengths."""
    orders = Orders(na=1, nb=(2, 3), nc=1, nd=2, nf=(2, 1), nk=(2, 0))
    _, u, y = problem(orders, True, samples=400)
    cuts = [(0, 90, 0), (95, 240, 0), (240, 400, 1)]
    stretches = [Segment(u[a:b], y[a:b], recording) for a, b, recording in cuts]
    window = ScoringWindow(START, LOSS_START)
    return PolynomialErrors(stretches, orders, objective, 0.999, 0.995, True, window)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_passes_over_several_stretches_add_up(objective):
    errors = of_stretches(objective)
    points, none, ones = population(errors, 11), np.zeros(11), np.ones(11)
    by_residuals = [errors.loss(errors.residuals(point)) for point in points]
    values = errors.values(points)
    np.testing.assert_allclose(values, by_residuals + points**2 @ errors.state_weights(), 1e-10)
    smoothed, gradients = errors.values_and_gradients(points, 0.1 * ones, none)
    for k, step in enumerate(1e-6 * np.eye(errors.dimension)):
        up, _ = errors.values_and_gradients(points + step, 0.1 * ones, none)
        down, _ = errors.values_and_gradients(points - step, 0.1 * ones, none)
        np.testing.assert_allclose(gradients[:, k], (up - down) / 2e-6, rtol=1e-5, atol=1e-5)
    barred, slopes = errors.values_and_gradients(points, 0.1 * ones, 2.0 * ones)
    of_roots, of_entries, _ = errors.barriers(points)
    np.testing.assert_allclose(barred - smoothed, 2.0 * of_roots, 1e-7, 1e-9)
    np.testing.assert_allclose(slopes - gradients, 2.0 * of_entries, 1e-7, 1e-9)


@pytest.mark.parametrize("wait", [None, 0.5])
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("several", [False, True])
def test_descents_are_those_that_python_steps_through(objective, wait, several):
    errors, _, _ = problem(Orders(na=3, nb=3, nc=3, nk=1), False, objective, samples=400)
    errors = of_stretches(objective) if several else errors
    starts = population(errors, 11)
    smoothing, barriers = np.full(11, 0.05), np.full(11, 1e-4)

    def evaluate(points, rows):
        return errors.values_and_gradients(points, smoothing[rows], barriers[rows])

    def inverse_hessians(points, rows):
        return damped_inverses(errors.curvatures(points, smoothing[rows], barriers[rows]))

    stepped = descend(evaluate, starts, inverse_hessians, 200, 1e-9, wait=wait)
    advance = partial(errors.passes.advance, (smoothing, barriers, 1e-9, 200))
    found = descend_by(advance, starts, inverse_hessians, wait=wait)
    assert found.evaluations == stepped.evaluations > 200
    for own, other in zip(
        (found.points, found.values, found.converged),
        (stepped.points, stepped.values, stepped.converged),
        strict=True,
    ):
        np.testing.assert_array_equal(own, other)
