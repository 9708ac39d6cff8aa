"""The kernels of the general polynomial model against difference equations and differences."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.models.structures import Orders

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
]


def problem(orders, level, objective="quadratic", samples=203, loss_start=LOSS_START):
    u, y = np.random.default_rng(5).standard_normal((2, samples))
    errors = PolynomialErrors(u, y, orders, objective, START, loss_start, 0.999, 0.995, level)
    return errors, u, y


def population(errors, count, seed=0):
    """Feasible random points."""
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((count, errors.dimension))
    for name in "acdf":
        part = errors.parts()[name]
        order = part.stop - part.start
        for point in points:
            roots = rng.uniform(0.1, 0.7, order) * rng.choice([-1, 1], order)
            point[part] = np.atleast_1d(np.poly(roots))[1:]
    return points


def by_difference_equations(errors, u, y, point):
    o, parts = errors.orders, errors.parts()
    a, b, c, d, f = (point[parts[name]] for name in "abcdf")
    level = point[parts["level"]].sum()
    g, s = point[parts["plant"]], point[parts["noise"]]
    x, v, e = np.zeros((3, len(y)))
    for t in range(START, len(y)):
        x[t] = -sum(b[j] * u[t - o.single.nk - j] for j in range(o.single.nb))
        x[t] -= sum(f[k] * x[t - 1 - k] for k in range(o.single.nf))
        x[t] += g[t - START] if t - START < o.single.nf else 0.0
        v[t] = y[t] + sum(a[i] * y[t - 1 - i] for i in range(o.na)) + x[t] - level
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
        np.testing.assert_allclose(errors.residuals(point), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_values_are_sums_of_losses(orders, level, objective):
    errors, _, y = problem(orders, level, objective, samples=700)
    total = np.abs if objective == "absolute" else np.square
    points = population(errors, 11)
    scale = 100 / np.sum(total(y[LOSS_START:]))
    unit = np.mean(np.abs(y[LOSS_START:])) if objective == "absolute" else 1.0
    parts = errors.parts()
    expected = [
        np.sum(total(errors.residuals(point)[LOSS_START:]))
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


@pytest.mark.parametrize(("orders", "level"), CASES, ids=str)
@pytest.mark.parametrize("loss_start", [START, LOSS_START])
def test_the_jacobian_is_exact_from_the_first_residual_on(orders, level, loss_start):
    errors, _, y = problem(orders, level, samples=400, loss_start=loss_start)
    (point,) = population(errors, 1)
    steps = 1e-6 * np.eye(errors.dimension)
    expected = np.column_stack(
        [(errors.residuals(point + h) - errors.residuals(point - h)) / 2e-6 for h in steps]
    )[loss_start:]
    found = errors.jacobian(point)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    matrix = 200.0 * found.T @ found / np.sum(y[loss_start:] ** 2)
    none = np.zeros(1)
    states = np.zeros(errors.dimension)
    states[errors.parts()["plant"]] = 1e-6
    states[errors.parts()["noise"]] = 1e-2
    matrix += 200.0 * np.diag(states) / np.sum(y[loss_start:] ** 2)
    np.testing.assert_allclose(
        errors.curvatures(point[None, :], none, none)[0],
        matrix,
        rtol=1e-9,
        atol=1e-11 * np.abs(matrix).max(),
    )


def test_a_model_gets_the_same_bits_whatever_shares_its_pass():
    errors, _, _ = problem(*CASES[-1], "absolute")
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


def test_the_armax_structure_has_the_objective_of_the_armax_kernels():
    from evopem.estimation.pem.objective import PredictionErrorProblem
    from evopem.models.structures import Orders, armax_orders

    errors, u, y = problem(Orders(na=2, nb=3, nc=4, nk=3), False)
    armax = PredictionErrorProblem(
        u, y, armax_orders(2, 3, 4, 3), "quadratic", START, LOSS_START, 0.995
    )
    points = population(errors, 9)
    np.testing.assert_allclose(errors.values(points), armax.values(points), rtol=1e-12)


def test_an_output_error_model_simulates():
    errors, u, y = problem(Orders(nb=2, nf=2, nk=1), False)
    (point,) = population(errors, 1)
    simulated = lfilter([0.0, *point[:2]], [1.0, *point[2:4]], u)
    # The states that make the recursion go on from before the first residual.
    state = [
        -np.dot(point[2:4], simulated[START - 1 : START - 3 : -1]),
        -point[3] * simulated[START - 1],
    ]
    point[4:6] = -np.array(state)
    expected = (y - simulated)[START:]
    np.testing.assert_allclose(errors.residuals(point)[START:], expected, rtol=1e-9, atol=1e-9)
