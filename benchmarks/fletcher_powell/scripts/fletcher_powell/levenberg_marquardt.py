"""Levenberg-Marquardt descents on a sum of squares."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum, damped_step

Array = NDArray[np.float64]

FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e10


class LeastSquares(Protocol):
    """A sum of squares, and what a descent needs to know of it."""

    def repaired(self, point: Array) -> Array:
        """Move a point that lies outside into the feasible region."""

    def residuals(self, point: Array) -> Array:
        """Residuals at a point, (N,)."""

    def percent(self, residuals: Array) -> float:
        """Objective: the sum of the squares of the residuals, in a unit of its own."""

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals, (N, n)."""


def descend(errors: LeastSquares, start: Array, max_iterations: int, tolerance: float) -> Optimum:
    """Descend from a point by damped Gauss-Newton steps (Marquardt 1963, Nielsen 1999).

    A step beyond the radius of the roots is drawn in to it, so that a descent goes on along it.

    ``start`` (n,).  ``tolerance``: A descent ends when a step promises less than a tenth of this
    relative decrease, or twice in a row gains less.
    """
    point = errors.repaired(start)
    residuals = errors.residuals(point)
    value, evaluations = errors.percent(residuals), 1
    damping, growth, small_gains = FIRST_DAMPING, 2.0, 0
    while np.isfinite(value) and max_iterations > 0:
        max_iterations -= 1
        columns = errors.jacobian(point)
        evaluations += 1
        size = np.linalg.norm(columns, axis=0)
        if not np.isfinite(size).all():
            break
        size = np.where(size > 1e-12 * size.max(initial=1e-300), size, 1.0)
        columns /= size
        hessian, gradient = columns.T @ columns, columns.T @ residuals
        total = float(residuals @ residuals)
        while True:
            step = damped_step(hessian, gradient, damping)
            if step is not None:
                promised = -2.0 * (gradient @ step) - step @ hessian @ step
                if damping <= FIRST_DAMPING and promised < 0.1 * tolerance * total:
                    return Optimum(point, value, True, evaluations)
                trial = errors.repaired(point + step / size)
                found = errors.residuals(trial)
                new = errors.percent(found)
                evaluations += 1
                if new < value:
                    break
            damping, growth = damping * growth, growth * 2.0
            if damping > LARGEST_DAMPING:
                return Optimum(point, value, True, evaluations)
        gain = 1.0 - new / value
        ratio = gain * total / float(promised) if promised > 0.0 else 0.0
        damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-12)
        growth = 2.0
        point, residuals, value = trial, found, new
        small_gains = small_gains + 1 if gain < tolerance else 0
        if small_gains >= 2:
            return Optimum(point, value, True, evaluations)
    return Optimum(point, value, False, evaluations)
