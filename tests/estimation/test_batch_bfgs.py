"""Lockstep BFGS on functions whose minima are known."""

import numpy as np
from scipy.optimize import rosen, rosen_der

from evopem.estimation.pem.kernels.bfgs import descend


def rosenbrock(points, rows):
    return np.array([rosen(p) for p in points]), np.array([rosen_der(p) for p in points])


def identities(points, rows):
    return np.tile(np.eye(points.shape[1]), (len(points), 1, 1))


def test_every_start_reaches_the_minimum_of_rosenbrocks_valley():
    starts = np.random.default_rng(1).uniform(-1.5, 1.5, (12, 2))
    result = descend(rosenbrock, starts, identities, 500, 1e-14)
    np.testing.assert_allclose(result.points, 1.0, atol=1e-4)
    assert result.evaluations < 12 * 200


def test_a_start_ends_in_the_same_bits_alone_or_in_company():
    starts = np.random.default_rng(2).uniform(-1.5, 1.5, (6, 4))
    together = descend(rosenbrock, starts, identities, 500, 1e-12)
    for i in range(6):
        alone = descend(rosenbrock, starts[i : i + 1], identities, 500, 1e-12)
        np.testing.assert_array_equal(alone.points[0], together.points[i])


def test_stragglers_are_left_where_they_are():
    starts = np.concatenate([1.0 + 1e-3 * np.eye(2), [[-1.5, 2.0], [-1.9, -1.9]]])
    patient = descend(rosenbrock, starts, identities, 500, 1e-14)
    hasty = descend(rosenbrock, starts, identities, 500, 1e-14, wait=0.2)
    assert patient.converged.all()
    np.testing.assert_array_equal(hasty.converged, [True, True, False, False])
    np.testing.assert_array_equal(hasty.points[:2], patient.points[:2])
    assert (hasty.values[2:] < [rosen(start) for start in starts[2:]]).all()
    assert hasty.evaluations < patient.evaluations


def test_a_function_that_is_not_smooth_does_not_stop_it():
    """|x_1| + 10 |x_2 - x_1|, which smooth methods stall on."""

    def value(points, rows):
        x, r = points[:, 0], points[:, 1] - points[:, 0]
        gradient = np.column_stack([np.sign(x) - 10 * np.sign(r), 10 * np.sign(r)])
        return np.abs(x) + 10 * np.abs(r), gradient

    starts = np.random.default_rng(3).standard_normal((8, 2))
    result = descend(value, starts, identities, 300, 1e-14)
    assert np.all(result.values < 1e-6)


def test_infinite_values_only_shorten_the_step():
    def walled(points, rows):
        values = np.sum((points - 0.95) ** 2, axis=1)
        values[np.any(points > 1.0, axis=1)] = np.inf
        return values, 2 * (points - 0.95)

    def overlong(points, rows):
        return 50 * identities(points, rows)

    result = descend(walled, np.zeros((3, 2)), overlong, 100, 1e-12)
    np.testing.assert_allclose(result.points, 0.95, atol=1e-5)


def test_a_start_outside_stays_infinite():
    def nowhere(points, rows):
        return np.full(len(points), np.inf), np.zeros_like(points)

    result = descend(nowhere, np.zeros((2, 3)), identities, 10, 1e-9)
    assert np.isinf(result.values).all()
    assert not result.converged.any()
