"""The compiled kernels against the difference equation and finite differences."""

import numpy as np
import pytest

from evopem.estimation.prediction_error import PredictionErrorProblem
from evopem.models.armax import Orders

CASES = [Orders(2, 3, 1, 0), Orders(7, 6, 7, 3), Orders(1, 1, 4, 2), Orders(3, 2, 0, 1)]


def population(orders, count, seed=0):
    """Feasible random parameters."""
    rng = np.random.default_rng(seed)
    points = np.zeros((count, orders.parameters + orders.nc))
    for point in points:
        for start, order in ((0, orders.na), (orders.na + orders.nb, orders.nc)):
            radii = rng.uniform(0.1, 0.6, order)
            point[start : start + order] = np.atleast_1d(
                np.poly(radii * rng.choice([-1, 1], order))
            )[1:]
        point[orders.na : orders.na + orders.nb] = rng.standard_normal(orders.nb)
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
        a, b, c, d = np.split(point, [orders.na, orders.na + orders.nb, orders.parameters])
        for t in range(11, samples):
            e[t] = y[t] + sum(a[i] * y[t - 1 - i] for i in range(orders.na))
            e[t] -= sum(b[j] * u[t - orders.nk - j] for j in range(orders.nb))
            e[t] -= sum(c[k] * e[t - 1 - k] for k in range(orders.nc))
            e[t] += d[t - 11] if t - 11 < orders.nc else 0.0
        np.testing.assert_allclose(errors.residuals(point), e, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("orders", CASES, ids=str)
def test_objectives_are_the_chapters(orders):
    for objective, total in (("absolute", np.abs), ("quadratic", np.square)):
        errors, _, y = problem(orders, objective)
        points = population(orders, 11)
        expected = [
            100 * np.sum(total(errors.residuals(p)[40:])) / np.sum(total(y[40:])) for p in points
        ]
        np.testing.assert_allclose(errors.values(points), expected, rtol=1e-12)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
@pytest.mark.parametrize("orders", CASES, ids=str)
def test_adjoint_gradient_is_the_derivative(orders, objective):
    errors, _, _ = problem(orders, objective)
    points = population(orders, 9)
    corners = np.full(9, 0.3)
    _, gradients = errors.values_and_gradients(points, corners)
    for i in range(errors.dimension):
        step = np.zeros(errors.dimension)
        step[i] = 1e-6
        up, _ = errors.values_and_gradients(points + step, corners)
        down, _ = errors.values_and_gradients(points - step, corners)
        scale = np.abs(gradients).max(axis=1)
        np.testing.assert_allclose((up - down) / 2e-6 / scale, gradients[:, i] / scale, atol=1e-6)


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
    (found,) = errors.curvatures(point[None, :], np.zeros(1))
    # The kernel forgets the start of the filters; 1500 samples make that a small share.
    # A noise state that has died out before the scored samples has no derivative to compare.
    felt = np.diag(expected) > 1e-12 * np.diag(expected).max()
    expected, found = expected[np.ix_(felt, felt)], found[np.ix_(felt, felt)]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.03)


def test_a_model_gets_the_same_bits_whatever_shares_its_pass():
    orders = Orders(7, 6, 7, 3)
    errors, _, _ = problem(orders, "absolute")
    points = population(orders, 21)
    corners = np.full(21, 0.1)
    together = errors.values_and_gradients(points, corners)
    for i in (0, 7, 8, 20):
        alone = errors.values_and_gradients(points[i : i + 1], corners[:1])
        assert alone[0][0] == together[0][i]
        np.testing.assert_array_equal(alone[1][0], together[1][i])


def test_infeasible_points_are_infinite_and_repair_makes_them_feasible():
    orders = Orders(2, 1, 2, 0)
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


def test_the_record_is_not_modified():
    orders = Orders(2, 1, 2, 0)
    u, y = np.random.default_rng(1).standard_normal((2, 200))
    before = u.copy(), y.copy()
    errors = PredictionErrorProblem(u, y, orders, "absolute", 11, 40, 0.999)
    errors.values_and_gradients(population(orders, 5), np.full(5, 0.1))
    np.testing.assert_array_equal((u, y), before)
