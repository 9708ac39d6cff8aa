"""The compiled kernels against the difference equation and finite differences."""

from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.estimation.pem import kernels
from evopem.estimation.pem.batch_bfgs import descend, descend_by
from evopem.estimation.pem.kernels.filtering import filter_rows
from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.search.staged_descent import damped_inverses
from evopem.models.structures import armax_orders

CASES = [
    armax_orders(2, 3, 1, 0),
    armax_orders(7, 6, 7, 3),
    armax_orders(1, 1, 4, 2),
    armax_orders(3, 2, 0, 1),
]


def population(orders, count, seed=0):
    """Feasible random parameters."""
    rng = np.random.default_rng(seed)
    points = np.zeros((count, orders.parameters + orders.nc))
    for point in points:
        for start, order in ((0, orders.na), (orders.na + orders.single.nb, orders.nc)):
            radii = rng.uniform(0.1, 0.6, order)
            point[start : start + order] = np.atleast_1d(
                np.poly(radii * rng.choice([-1, 1], order))
            )[1:]
        point[orders.na : orders.na + orders.single.nb] = rng.standard_normal(orders.single.nb)
        point[orders.parameters :] = rng.standard_normal(orders.nc)
    return points


def problem(orders, objective="quadratic", samples=203, seed=5):
    u, y = np.random.default_rng(seed).standard_normal((2, samples))
    return PredictionErrorProblem(u, y, orders, objective, 11, 40, 0.999), u, y


@pytest.mark.parametrize("orders", CASES, ids=str)
@pytest.mark.parametrize("samples", [200, 201, 202, 203])
def test_residuals_follow_the_difference_equation(orders, samples):
    errors, u, y = problem(orders, samples=samples)
    for point in population(orders, 3):
        e = np.zeros(samples)
        a, b, c, d = np.split(point, [orders.na, orders.na + orders.single.nb, orders.parameters])
        for t in range(11, samples):
            e[t] = y[t] + sum(a[i] * y[t - 1 - i] for i in range(orders.na))
            e[t] -= sum(b[j] * u[t - orders.single.nk - j] for j in range(orders.single.nb))
            e[t] -= sum(c[k] * e[t - 1 - k] for k in range(orders.nc))
            e[t] += d[t - 11] if t - 11 < orders.nc else 0.0
        np.testing.assert_allclose(errors.residuals(point), e, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("orders", CASES, ids=str)
def test_objectives_are_the_chapters(orders):
    for objective, total in (("absolute", np.abs), ("quadratic", np.square)):
        errors, _, y = problem(orders, objective)
        points = population(orders, 11)
        scale = 100 / np.sum(total(y[40:]))
        expected = np.array([np.sum(total(errors.residuals(p)[40:])) for p in points])
        # And a hundredth of the square of the noise state, in the unit of the objective.
        states = 0.01 * np.sum(points[:, orders.parameters :] ** 2, axis=1)
        states /= np.mean(np.abs(y[40:])) if objective == "absolute" else 1.0
        np.testing.assert_allclose(errors.values(points), scale * (expected + states), rtol=1e-12)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("orders", CASES, ids=str)
def test_adjoint_gradient_is_the_derivative(orders, objective):
    errors, _, _ = problem(orders, objective)
    points = population(orders, 9)
    smoothing, barriers = np.full(9, 0.3), np.full(9, 0.2)
    _, gradients = errors.values_and_gradients(points, smoothing, barriers)
    for i in range(errors.dimension):
        step = np.zeros(errors.dimension)
        step[i] = 1e-6
        up, _ = errors.values_and_gradients(points + step, smoothing, barriers)
        down, _ = errors.values_and_gradients(points - step, smoothing, barriers)
        scale = np.abs(gradients).max(axis=1)
        np.testing.assert_allclose((up - down) / 2e-6 / scale, gradients[:, i] / scale, atol=1e-6)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("orders", CASES, ids=str)
def test_a_record_in_parts_is_the_whole_record(orders, objective, monkeypatch):
    """Of a long record some residuals are not kept, but computed again."""
    whole, _, _ = problem(orders, objective, samples=1500)
    points = population(orders, 9)
    weights = np.full(9, 0.3), np.full(9, 0.2)
    monkeypatch.setattr("evopem.estimation.pem.kernels.record.KEPT", 256)
    parted, _, _ = problem(orders, objective, samples=1500)
    for kept in (0, 256):  # two parts, and six
        parted._workspace = kernels.workspace_for(parted._record, kept)
        assert len(parted._workspace.residuals) < 800
        np.testing.assert_array_equal(parted.residuals(points[0]), whole.residuals(points[0]))
        for own, other in zip(
            (parted.curvatures(points, *weights), *parted.values_and_gradients(points, *weights)),
            (whole.curvatures(points, *weights), *whole.values_and_gradients(points, *weights)),
            strict=True,
        ):
            np.testing.assert_allclose(own, other, rtol=1e-11, atol=1e-11 * np.abs(other).max())


@pytest.mark.parametrize("orders", CASES, ids=str)
def test_gauss_newton_matrix_is_that_of_the_jacobian(orders):
    errors, _, y = problem(orders, samples=1500)
    (point,) = population(orders, 1)
    jacobian = np.column_stack(
        [
            (errors.residuals(point + h) - errors.residuals(point - h)) / 2e-6
            for h in 1e-6 * np.eye(errors.dimension)
        ]
    )[40:]
    expected = 200.0 * jacobian.T @ jacobian / np.sum(y[40:] ** 2)
    (found,) = errors.curvatures(point[None, :], np.zeros(1), np.zeros(1))
    # The kernel forgets the start of the filters; 1500 samples make that a small share.
    # A noise state that has died out before the scored samples has no derivative to compare.
    felt = np.diag(expected) > 1e-12 * np.diag(expected).max()
    expected, found = expected[np.ix_(felt, felt)], found[np.ix_(felt, felt)]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.03)


@pytest.mark.parametrize("kept", [None, 0, 256])
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("orders", [*CASES, armax_orders(9, 17, 11, 2)], ids=str)
def test_a_model_gets_the_same_bits_whatever_shares_its_pass(orders, objective, kept, monkeypatch):
    """Alone it takes another way through the record, and of a long record the parts one by one."""
    u, y = np.random.default_rng(5).standard_normal((2, 1100))
    errors = PredictionErrorProblem(u, y, orders, objective, 19, 40, 0.999)
    if kept is not None:
        monkeypatch.setattr("evopem.estimation.pem.kernels.record.KEPT", 256)
        errors._workspace = kernels.workspace_for(errors._record, kept)
    points = population(orders, 21)
    smoothing, barriers = np.full(21, 0.1), np.full(21, 0.2)
    together = errors.values_and_gradients(points, smoothing, barriers)
    for i in (0, 7, 8, 20):
        alone = errors.values_and_gradients(points[i : i + 1], smoothing[:1], barriers[:1])
        assert alone[0][0] == together[0][i]
        np.testing.assert_array_equal(alone[1][0], together[1][i])


@pytest.mark.parametrize("wait", [None, 0.5])
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_descents_are_those_that_python_steps_through(objective, wait):
    orders = armax_orders(3, 3, 3, 1)
    errors, _, _ = problem(orders, objective, samples=400)
    starts = population(orders, 11)
    smoothing, barriers = np.full(11, 0.05), np.full(11, 1e-4)

    def evaluate(points, rows):
        return errors.values_and_gradients(points, smoothing[rows], barriers[rows])

    def inverse_hessians(points, rows):
        return damped_inverses(errors.curvatures(points, smoothing[rows], barriers[rows]))

    stepped = descend(evaluate, starts, inverse_hessians, 200, 1e-9, wait=wait)
    advance = partial(errors.advance_descents, smoothing, barriers, 1e-9, 200)
    found = descend_by(advance, starts, inverse_hessians, wait=wait)
    assert found.evaluations == stepped.evaluations > 200
    for own, other in zip(
        (found.points, found.values, found.converged),
        (stepped.points, stepped.values, stepped.converged),
        strict=True,
    ):
        np.testing.assert_array_equal(own, other)


def test_infeasible_points_are_infinite_and_repair_makes_them_feasible():
    orders = armax_orders(2, 1, 2, 0)
    errors, _, _ = problem(orders)
    good = [0.1, 0.2, 1.0, 0.1, 0.1, 0.0, 0.0]
    points = np.array([good, [0.1, 0.2, 1.0, -2.5, 0.1, 0.0, 0.0], [np.nan] * 7])
    values = errors.values(points)
    assert np.isfinite(values[0])
    assert np.isinf(values[1:]).all()
    repaired = errors.repair(points)
    np.testing.assert_array_equal(repaired[0], points[0])
    assert errors.feasible(repaired).all()
    assert np.isfinite(errors.values(repaired)).all()


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
    values, gradients, curvatures = kernels.stability_barriers(coefficients[None, :], radius)
    np.testing.assert_allclose(values[0], np.log(response @ response), rtol=1e-9, atol=1e-12)
    for j in range(degree):
        step = 1e-6 * np.eye(degree)[j]
        moved = np.array([coefficients + step, coefficients - step])
        up, down = kernels.stability_barriers(moved, radius)[0]
        np.testing.assert_allclose(gradients[0, j], (up - down) / 2e-6, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(curvatures[0], curvatures[0].T, rtol=1e-9)
    assert np.linalg.eigvalsh(curvatures[0])[0] > -1e-9 * np.linalg.norm(curvatures[0])


def test_the_stability_barrier_is_infinite_outside():
    values, gradients, curvatures = kernels.stability_barriers(
        np.array([[-0.5], [-0.97], [-0.99], [np.nan]]), 0.98
    )
    assert np.isfinite(values[:2]).all()
    assert values[1] > values[0]
    assert np.isinf(values[2:]).all()
    np.testing.assert_array_equal(gradients[2:], 0.0)
    np.testing.assert_array_equal(curvatures[2:], 0.0)


def test_the_barrier_of_a_descent_is_that_of_a_and_of_c():
    orders = armax_orders(3, 2, 2, 1)
    errors, _, _ = problem(orders)
    points = population(orders, 5)
    none, weights = np.zeros(5), np.linspace(0.5, 2.0, 5)
    bare, bare_gradients = errors.values_and_gradients(points, none, none)
    with_barrier, gradients = errors.values_and_gradients(points, none, weights)
    values, slopes = np.zeros(5), np.zeros_like(points)
    matrices = np.zeros((5, errors.dimension, errors.dimension))
    for part in (slice(0, 3), slice(5, 7)):
        of_part = kernels.stability_barriers(np.ascontiguousarray(points[:, part]), 0.999)
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
    orders = armax_orders(2, 1, 2, 0)
    u, y = np.random.default_rng(1).standard_normal((2, 200))
    before = u.copy(), y.copy()
    errors = PredictionErrorProblem(u, y, orders, "absolute", 11, 40, 0.999)
    errors.values_and_gradients(population(orders, 5), np.full(5, 0.1), np.zeros(5))
    np.testing.assert_array_equal((u, y), before)
