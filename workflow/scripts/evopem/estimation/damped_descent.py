"""Damped Gauss-Newton descents (Marquardt 1963, Nielsen 1999)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

Array = NDArray[np.float64]

# Damping relative to the diagonal of the Hessian: at the start, and where a descent gives up.
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e12


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where a descent ended.

    Attributes
    ----------
    point : (n,) array
    value : float
        Of what is minimised; infinite where no feasible point was found.
    converged : bool
    evaluations : int
        A Jacobian counts as one.
    """

    point: Array
    value: float
    converged: bool
    evaluations: int


class HasCovariance(Protocol):
    """Errors of a point."""

    @property
    def covariance(self) -> Array:
        """Of the outputs, (l, l)."""


Errors = TypeVar("Errors", bound=HasCovariance)


class Squares(Protocol[Errors]):
    """What :func:`descend` needs to know of a problem."""

    def begun(self, start: Array) -> Array:
        """A start within its bounds."""

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, within its bounds."""

    def projection(self, point: Array) -> Errors:
        """Errors of a point."""

    def criterion(self, covariance: Array) -> float:
        """Criterion of errors."""

    def stable(self, projection: Errors) -> bool:
        """Whether a descent may end there."""

    def normal_equations(self, projection: Errors) -> tuple[Array, Array]:
        """Gradient, (n,), and Gauss-Newton Hessian, (n, n), of the criterion of the last point."""


def descend(problem: Squares[Errors], start: Array, steps: int, tolerance: float) -> Optimum:
    """Minimise a criterion from a point by at most some accepted steps.

    The descent has converged when a step promises less than a tenth of the tolerance, or twice in
    a row gains less than it.
    """
    point = problem.begun(start)
    if not np.isfinite(point).all():
        return Optimum(point, np.inf, False, 0)
    projection = problem.projection(point)
    criterion, stable = problem.criterion(projection.covariance), problem.stable(projection)
    evaluations, small_gains, damping = 1, 0, Damping()
    converged = not np.isfinite(criterion)

    def tried(step: Array) -> float:
        nonlocal point, projection, criterion, stable, evaluations
        evaluations += 1
        trial = problem.moved(point, step)
        if not np.isfinite(trial).all():
            return 0.0
        errors = problem.projection(trial)
        now_stable = problem.stable(errors)
        # A descent may begin with an unstable A, but never goes back to one.
        if stable and not now_stable:
            return 0.0
        new = problem.criterion(errors.covariance)
        if not new < criterion:
            return 0.0
        gain = criterion - new
        point, projection, criterion, stable = trial, errors, new, now_stable
        return gain

    while steps > 0 and not converged:
        steps -= 1
        evaluations += 1
        gain = damping.step(*problem.normal_equations(projection), 0.1 * tolerance, tried)
        small_gains = small_gains + 1 if gain is not None and gain < tolerance else 0
        converged = gain is None or small_gains >= 2
    if not (stable and np.isfinite(criterion)):
        criterion = np.inf
    return Optimum(point, criterion, converged, evaluations)


class Damping:
    """The damping of a descent on its way."""

    def __init__(self) -> None:
        self._damping = FIRST_DAMPING

    def step(
        self, gradient: Array, hessian: Array, least: float, tried: Callable[[Array], float]
    ) -> float | None:
        """Damp a step until it gains something, and what it gained; ``tried`` takes a step.

        None where no step promises more than ``least``, or none gains.
        """
        scale = np.sqrt(np.maximum(np.diag(hessian), 0.0))
        scale = np.where(scale > 1e-12 * scale.max(initial=1e-300), scale, 1.0)
        gradient, hessian = gradient / scale, hessian / np.outer(scale, scale)
        growth = 2.0
        while self._damping <= LARGEST_DAMPING:
            step = damped_step(hessian, gradient, self._damping)
            if step is not None:
                promised = float(-(gradient @ step) - 0.5 * step @ hessian @ step)
                if promised < least and self._damping <= FIRST_DAMPING:
                    return None
                gain = tried(step / scale)
                if gain > 0.0:
                    ratio = gain / promised if promised > 0.0 else 0.0
                    factor = max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
                    self._damping = max(self._damping * factor, 1e-15)
                    return gain
            self._damping, growth = self._damping * growth, growth * 2.0
        self._damping = FIRST_DAMPING
        return None


def damped_step(hessian: Array, gradient: Array, damping: float) -> Array | None:
    """Damped Gauss-Newton step in scaled coordinates, or None where it does not exist."""
    matrix = hessian.copy()
    # Far below the damping, this keeps free directions of the coordinates solvable.
    matrix[np.diag_indices_from(matrix)] += damping + 1e-12
    try:
        factor = cho_factor(matrix, lower=True, check_finite=False)
    except LinAlgError:
        return None
    step: Array = -cho_solve(factor, gradient, check_finite=False)
    return step if np.isfinite(step).all() else None
