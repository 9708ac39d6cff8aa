"""Least absolute errors by another method: successive linear programmes in a trust region."""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, eye_array, hstack, vstack

# Finite differences of the errors.
STEP = 1e-7


def descended(errors_of, start, steps=60):
    """Sum over outputs of the log of mean absolute errors, from a start (Osborne & Watson 1971).

    Parameters
    ----------
    errors_of : callable
        Errors (N, ny) of parameters.
    start : (n,) array

    Returns
    -------
    parameters, value
    """
    point, radius = np.asarray(start, dtype=float), 0.1
    errors = errors_of(point)
    value = loss(errors)
    for _ in range(steps):
        weights = 1.0 / np.sum(np.abs(errors), axis=0)
        step = linear_step(errors * weights, slopes(errors_of, point) * weights[:, None], radius)
        trial = errors_of(point + step)
        new = loss(trial)
        if new < value:
            gain, radius = value - new, 2.0 * radius
            point, errors, value = point + step, trial, new
            if gain < 1e-13:
                break
        else:
            radius *= 0.25
            if radius < 1e-10:
                break
    return point, value


def loss(errors):
    if not np.isfinite(errors).all():
        return np.inf
    return float(np.sum(np.log(np.mean(np.abs(errors), axis=0))))


def slopes(errors_of, point):
    steps = STEP * np.eye(len(point))
    return np.stack([(errors_of(point + h) - errors_of(point - h)) / (2 * STEP) for h in steps], -1)


def linear_step(errors, jacobian, radius):
    """The step that minimises the sum of |errors + jacobian step| within a box."""
    e, j = errors.ravel(), csr_array(jacobian.reshape(errors.size, -1))
    rows, count = j.shape
    cost = np.concatenate([np.zeros(count), np.ones(rows)])
    one = eye_array(rows)
    above = vstack([hstack([j, -one]), hstack([-j, -one])])
    bounds = [(-radius, radius)] * count + [(0.0, None)] * rows
    found = linprog(cost, above, np.concatenate([-e, e]), bounds=bounds, method="highs")
    return found.x[:count]
