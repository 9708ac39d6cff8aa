"""Descents of sums of absolute errors, of one output or of several that are weighed.

The absolute value has a corner.  It is smoothed, ``sqrt(e**2 + width**2)``, and the width falls
from the size of the errors to a millionth of it.  Newton's matrix of the smoothed sum is nearly
singular then, and that of iteratively reweighted least squares leads there slowly.  The primal-dual
matrix (Chan, Golub & Mulet 1999) lies between both: its weights are ``(1 - d e / h) / h`` with
``h = sqrt(e**2 + width**2)`` and a *dual* d, which follows ``e / h`` by its linearisation.  Steps
are damped as those of Levenberg and Marquardt.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Damping, Optimum

Array = NDArray[np.float64]
Places = NDArray[np.intp] | slice
Weighing = Literal["noise", "power"]

# Widths of the smoothing relative to the mean absolute error of an output: the first one, and the
# factor from one to the next.
FIRST_WIDTH, NARROWER = 1.0, 0.1
# The last one of a descent of a search over orders, of one for an order, and to the last digits.
SWEEP_WIDTH, SEARCH_WIDTH, POLISH_WIDTH = 1e-2, 1e-4, 1e-6
# The first one of the last pass to the last digits, which stays at its optimum.
LAST_PASS = 1e-3
# A width is left when a step promises less than this share of it, or twice in a row gains less.
TOLERANCE = 1e-3
# Steps at one width.
STEPS = 60
# Mean absolute errors below this share of those of the output carry no information.
ROUNDING = 1e-9
# Passes of reweighted least squares towards linear coefficients.
PASSES = 10


class AbsoluteErrors(Protocol):
    """What :func:`descend` needs to know of a model."""

    @property
    def weighing(self) -> Weighing:
        """How the outputs are weighed; see :func:`criterion`."""

    def errors(self, point: Array) -> Array:
        """Errors of a point, (N, outputs), in the units of the outputs' mean absolute values."""

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Of each output the derivatives of its errors, (N, m), and the m entries of a point."""

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, drawn into the bounds of its roots."""

    def is_stable(self, point: Array) -> bool:
        """Whether a descent may end there."""


def criterion(errors: Array, weighing: Weighing) -> float:
    """What is minimised, from errors (N, outputs).

    The mean over the outputs of the logarithms of their mean absolute errors (``noise``: maximum
    likelihood of independent errors with Laplace's distribution, a scale for each output), or the
    logarithm of the mean over the outputs (``power``).
    """
    if not np.isfinite(errors).all():
        return float("inf")
    return _criterion(np.mean(np.abs(errors), axis=0), weighing)


def _criterion(sizes: Array, weighing: Weighing) -> float:
    sizes = sizes + ROUNDING
    return float(np.mean(np.log(sizes)) if weighing == "noise" else np.log(np.mean(sizes)))


def output_weights(errors: Array, weighing: Weighing) -> Array:
    """Derivative of the criterion by the sum of the absolute errors of each output, (outputs,)."""
    return _weights(np.mean(np.abs(errors), axis=0), weighing) / len(errors)


def _weights(sizes: Array, weighing: Weighing) -> Array:
    sizes = sizes + ROUNDING
    if weighing == "noise":
        return np.asarray(1.0 / (len(sizes) * sizes))
    return np.full(len(sizes), 1.0 / float(np.sum(sizes)))


def polish(problem: AbsoluteErrors, start: Array) -> Optimum:
    """Minimise the criterion to the last digits, and never above the start.

    A pass from wide smoothing may end at another optimum; the last one begins at the lower point.

    Parameters
    ----------
    problem : AbsoluteErrors
    start : (n,) array
    """
    first = descend(problem, start, SEARCH_WIDTH)
    before = criterion(problem.errors(start), problem.weighing)
    stays = before < first.value and problem.is_stable(start)
    point = start if stays else first.point
    last = descend(problem, point, POLISH_WIDTH, LAST_PASS)
    return replace(last, evaluations=first.evaluations + last.evaluations)


def descend(
    problem: AbsoluteErrors, start: Array, last_width: float, first_width: float = FIRST_WIDTH
) -> Optimum:
    """Minimise the criterion from a point.

    Parameters
    ----------
    problem : AbsoluteErrors
    start : (n,) array
    last_width, first_width : float
        Of the smoothing, relative to the mean absolute errors.
    """
    found = _Descent(problem, start)
    width, converged = first_width, False
    while np.isfinite(found.errors).all():
        converged = found.at_width(width)
        if width <= last_width * (1.0 + 1e-9):
            break
        width *= NARROWER
    value = criterion(found.errors, problem.weighing) if found.stable else float("inf")
    return Optimum(found.point, value, converged, found.evaluations)


def linear_coefficients(regressors: Array, outputs: Array) -> Array:
    """Coefficients of nearly the least sum of absolute errors, (q, outputs).

    By iteratively reweighted least squares, each output with weights of its own.

    Parameters
    ----------
    regressors : (N, q) array
        With orthonormal columns.
    outputs : (N, outputs) array
    """
    found = regressors.T @ outputs
    ridge = 1e-12 * np.eye(regressors.shape[1])
    width = FIRST_WIDTH
    for _ in range(PASSES):
        width *= 0.5
        errors = outputs - regressors @ found
        for k, column in enumerate(errors.T):
            size = float(np.mean(np.abs(column)))
            if not size > 0.0:
                continue
            weights = size / np.hypot(column, width * size)
            weighted = regressors * weights[:, None]
            found[:, k] = np.linalg.solve(
                regressors.T @ weighted + ridge, weighted.T @ outputs[:, k]
            )
    return np.asarray(found)


class _Descent:
    """A point on its way, with its errors and duals."""

    def __init__(self, problem: AbsoluteErrors, start: Array) -> None:
        self.problem = problem
        self.point = problem.moved(start, np.zeros_like(start))
        self.errors = problem.errors(self.point)
        self.stable = problem.is_stable(self.point)
        self.evaluations = 1
        self._damping = Damping()
        self._duals = np.zeros_like(self.errors)

    def at_width(self, width: float) -> bool:
        """Descend at one width of the smoothing; whether it converged."""
        widths = width * np.maximum(np.mean(np.abs(self.errors), axis=0), ROUNDING)
        tolerance, small_gains = TOLERANCE * width, 0
        value = self._smoothed(self.errors, widths)
        for _ in range(STEPS):
            gain = self._step(value, widths, 0.1 * tolerance)
            if gain is None:
                return True
            value -= gain
            small_gains = small_gains + 1 if gain < tolerance else 0
            if small_gains >= 2:
                return True
        return False

    def _smoothed(self, errors: Array, widths: Array) -> float:
        if not np.isfinite(errors).all():
            return float("inf")
        return _criterion(np.mean(np.hypot(errors, widths), axis=0), self.problem.weighing)

    def _step(self, value: float, widths: Array, least: float) -> float | None:
        """One damped step, and what it gained; None where no step promises more than ``least``."""
        sizes = np.hypot(self.errors, widths)
        slopes = self.errors / sizes
        curvatures = (1.0 - self._duals * slopes) / sizes
        return self._damping.step(
            *self._normal_equations(sizes, slopes, curvatures),
            least,
            lambda step: self._try(step, value, widths, slopes, curvatures),
        )

    def _try(
        self, step: Array, value: float, widths: Array, slopes: Array, curvatures: Array
    ) -> float:
        """Take a step where it lowers the smoothed criterion; what it gained."""
        point = self.problem.moved(self.point, step)
        errors = self.problem.errors(point)
        self.evaluations += 1
        new = self._smoothed(errors, widths)
        if not new < value:
            return 0.0
        stable = self.problem.is_stable(point)
        # A descent may begin with an unstable point, but never goes back to one.
        if self.stable and not stable:
            return 0.0
        followed = slopes + curvatures * (errors - self.errors)
        self._duals = np.clip(followed, -1.0, 1.0)
        self.point, self.errors, self.stable = point, errors, stable
        return value - new

    def _normal_equations(
        self, sizes: Array, slopes: Array, curvatures: Array
    ) -> tuple[Array, Array]:
        """Gradient and primal-dual Hessian of the smoothed criterion."""
        weights = _weights(np.mean(sizes, axis=0), self.problem.weighing) / len(sizes)
        count = len(self.point)
        gradient, hessian = np.zeros(count), np.zeros((count, count))
        for k, (columns, places) in enumerate(self.problem.jacobians(self.point)):
            rows = np.arange(count)[places]
            gradient[rows] += weights[k] * (slopes[:, k] @ columns)
            weighted = columns * (weights[k] * curvatures[:, k])[:, None]
            hessian[np.ix_(rows, rows)] += columns.T @ weighted
        self.evaluations += 1
        return gradient, hessian
