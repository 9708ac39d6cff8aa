"""Damped Gauss-Newton descents (Marquardt 1963, Nielsen 1999) of squares and of absolute errors.
The corner of the absolute value is smoothed, ``sqrt(e**2 + width**2)``, and the width falls to a
millionth of the errors. Newton's matrix is nearly singular then, and reweighted least squares is
slow. The primal-dual matrix (Chan, Golub & Mulet 1999) lies between both: its weights are ``(1 - d
e / h) / h``, h the smoothed value, and a *dual* d follows ``e / h`` by its linearisation."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from scipy.linalg.lapack import dposv

from evopem.arrays import Array, Indices

Places = Indices | slice
Weighing = Literal["noise", "power"]

# Damping relative to the diagonal of the Hessian: at the start, and where a descent gives up.
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e12

# Widths of the smoothing relative to the mean absolute error of an output: the first one, and the
# factor from one to the next.
FIRST_WIDTH, NARROWER = 1.0, 0.1
# The last one of a descent of a search over orders, of one for an order, and to the last digits.
SWEEP_WIDTH, SEARCH_WIDTH, POLISH_WIDTH = 1e-2, 1e-4, 1e-6
LAST_PASS = 1e-3  # the first one of the last pass to the last digits, which stays at its optimum
# A width is left when a step promises less than this share of it, or twice in a row gains less.
ABSOLUTE_TOLERANCE = 1e-3
STEPS_AT_WIDTH = 60  # steps at one width
# Mean absolute errors below this share of those of the output carry no information.
ROUNDING = 1e-9
PASSES = 10  # passes of reweighted least squares towards linear coefficients


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where a descent ended; the value is infinite where no feasible point was found."""

    point: Array
    value: float
    converged: bool
    evaluations: int  # a Jacobian counts as one


class Descended(Protocol):
    """What descents need to know of a problem."""

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, within its bounds."""

    def projection(self, point: Array) -> Any:
        """Errors of a point, with their covariance."""

    def stable(self, projection: Any) -> bool:
        """Whether a descent may end there."""


class Squares(Descended, Protocol):
    """The same of squared errors."""

    def begun(self, start: Array) -> Array:
        """A start within its bounds."""

    def criterion(self, covariance: Array) -> float:
        """Criterion of errors."""

    def normal_equations(self, projection: Any) -> tuple[Array, Array]:
        """Gradient, (n,), and Gauss-Newton Hessian, (n, n), of the criterion of the last point."""


class AbsoluteErrors(Descended, Protocol):
    """The same of absolute errors."""

    @property
    def weighing(self) -> Weighing:
        """How the outputs are weighed; see :func:`absolute_criterion`."""

    @property
    def sizes(self) -> Array:
        """Mean absolute values of the outputs, (l,), in the units of the errors."""

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Of each output the derivatives of its errors, (N, m), and the m entries of a point."""


def descend(problem: Squares, start: Array, steps: int, tolerance: float) -> Optimum:
    """Minimise a criterion from a point by at most some accepted steps. Converged when a step
    promises less than a tenth of the tolerance, or twice gains less than it."""
    point = problem.begun(start)
    if not np.isfinite(point).all():
        return Optimum(point, np.inf, False, 0)
    projection = problem.projection(point)
    criterion, stable = problem.criterion(projection.covariance), problem.stable(projection)
    evaluations = 1

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

    def equations() -> tuple[Array, Array]:
        nonlocal evaluations
        evaluations += 1
        return problem.normal_equations(projection)

    converged = not np.isfinite(criterion) or Damping().descend(equations, tried, steps, tolerance)
    if not (stable and np.isfinite(criterion)):
        criterion = np.inf
    return Optimum(point, criterion, converged, evaluations)


class Damping:
    """The damping of a descent on its way."""

    def __init__(self) -> None:
        self._damping = FIRST_DAMPING

    def descend(
        self,
        equations: Callable[[], tuple[Array, Array]],
        tried: Callable[[Array], float],
        steps: int,
        tolerance: float,
    ) -> bool:
        """Take at most some steps; whether one promises less than a tenth of the tolerance, or two
        in a row gain less than it.  ``equations``: gradient and Hessian of the present point."""
        small_gains = 0
        for _ in range(steps):
            gain = self._step(*equations(), 0.1 * tolerance, tried)
            small_gains = small_gains + 1 if gain is not None and gain < tolerance else 0
            if gain is None or small_gains >= 2:
                return True
        return False

    def _step(
        self, gradient: Array, hessian: Array, least: float, tried: Callable[[Array], float]
    ) -> float | None:
        """Damp a step until it gains something, and what it gained; ``tried`` takes a step. None
        where no step promises more than ``least``, or none gains."""
        scale = np.sqrt(np.maximum(np.diag(hessian), 0.0))
        scale = np.where(scale > 1e-12 * scale.max(initial=1e-300), scale, 1.0)
        gradient, hessian = gradient / scale, hessian / np.outer(scale, scale)
        multiplier = 2.0
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
            self._damping, multiplier = self._damping * multiplier, multiplier * 2.0
        self._damping = FIRST_DAMPING
        return None


def damped_step(hessian: Array, gradient: Array, damping: float) -> Array | None:
    """Damped Gauss-Newton step in scaled coordinates, or None where it does not exist."""
    matrix = hessian.copy()
    # Far below the damping, this keeps free directions of the coordinates solvable.
    matrix.flat[:: len(matrix) + 1] += damping + 1e-12
    # Transposed it is stored as LAPACK has it, and overwritten.
    _, step, info = dposv(matrix.T, -gradient, lower=True, overwrite_a=True)
    return np.asarray(step) if info == 0 and np.isfinite(step).all() else None


def absolute_criterion(errors: Array, weighing: Weighing) -> float:
    """The mean over outputs of the logarithms of mean absolute errors, or (``power``) of the mean.
    ``noise`` is the maximum likelihood of independent errors with Laplace's distribution."""
    if not np.isfinite(errors).all():
        return float("inf")
    return _criterion(np.mean(np.abs(errors), axis=0), weighing)


def _criterion(sizes: Array, weighing: Weighing) -> float:
    sizes = sizes + ROUNDING
    return float(np.mean(np.log(sizes)) if weighing == "noise" else np.log(np.mean(sizes)))


def output_weights(sizes: Array, weighing: Weighing) -> Array:
    """Derivative of the criterion by the mean absolute error of each output, (outputs,)."""
    sizes = sizes + ROUNDING
    if weighing == "noise":
        return np.asarray(1.0 / (len(sizes) * sizes))
    return np.full(len(sizes), 1.0 / float(np.sum(sizes)))


def polish_absolute(problem: AbsoluteErrors, start: Array) -> Optimum:
    """Minimise the criterion to the last digits, and never above the start. A pass from wide
    smoothing may end at another optimum; the last one begins at the lower point."""
    first = descend_absolute(problem, start, SEARCH_WIDTH)
    before = absolute_criterion(_relative_errors(problem, start), problem.weighing)
    stays = before < first.value and problem.stable(problem.projection(start))
    point = start if stays else first.point
    last = descend_absolute(problem, point, POLISH_WIDTH, LAST_PASS)
    return replace(last, evaluations=first.evaluations + last.evaluations)


def descend_absolute(
    problem: AbsoluteErrors, start: Array, last_width: float, first_width: float = FIRST_WIDTH
) -> Optimum:
    """Minimise the criterion from a point; widths are relative to the mean absolute errors."""
    descent = _Descent(problem, start)
    width, converged = first_width, False
    while np.isfinite(descent.errors).all():
        converged = descent.at_width(width)
        if width <= last_width * (1.0 + 1e-9):
            break
        width *= NARROWER
    value = absolute_criterion(descent.errors, problem.weighing) if descent.stable else float("inf")
    return Optimum(descent.point, value, converged, descent.evaluations)


def linear_coefficients(regressors: Array, outputs: Array) -> Array:
    """Coefficients of nearly the least sum of absolute errors, (q, l), of orthonormal (N, q). By
    iteratively reweighted least squares, each output with weights of its own."""
    coefficients = regressors.T @ outputs
    ridge = 1e-12 * np.eye(regressors.shape[1])
    width = FIRST_WIDTH
    for _ in range(PASSES):
        width *= 0.5
        errors = outputs - regressors @ coefficients
        for k, column in enumerate(errors.T):
            size = float(np.mean(np.abs(column)))
            if not size > 0.0:
                continue
            weights = size / np.hypot(column, width * size)
            weighted = regressors * weights[:, None]
            coefficients[:, k] = np.linalg.solve(
                regressors.T @ weighted + ridge, weighted.T @ outputs[:, k]
            )
    return np.asarray(coefficients)


def _relative_errors(problem: AbsoluteErrors, point: Array) -> Array:
    """Errors of a point, (N, l), over the sizes of their outputs."""
    if not np.isfinite(point).all():
        return np.full((1, len(problem.sizes)), np.nan)
    return np.asarray(problem.projection(point).errors / problem.sizes)


class _Descent:
    """A point on its way, with its errors and duals."""

    def __init__(self, problem: AbsoluteErrors, start: Array) -> None:
        self.problem = problem
        self.point = problem.moved(start, np.zeros_like(start))
        self.errors = _relative_errors(problem, self.point)
        self.stable = problem.stable(problem.projection(self.point))
        self.evaluations = 1
        self._damping = Damping()
        self._duals = np.zeros_like(self.errors)

    def at_width(self, width: float) -> bool:
        """Descend at one width of the smoothing; whether it converged."""
        widths = width * np.maximum(np.mean(np.abs(self.errors), axis=0), ROUNDING)
        value = self._smoothed(self.errors, widths)
        slopes = curvatures = np.empty(0)

        def equations() -> tuple[Array, Array]:
            nonlocal slopes, curvatures
            sizes = np.hypot(self.errors, widths)
            slopes = self.errors / sizes
            curvatures = (1.0 - self._duals * slopes) / sizes
            return self._normal_equations(sizes, slopes, curvatures)

        def tried(step: Array) -> float:
            nonlocal value
            point = self.problem.moved(self.point, step)
            errors = _relative_errors(self.problem, point)
            self.evaluations += 1
            new = self._smoothed(errors, widths)
            if not new < value:
                return 0.0
            stable = self.problem.stable(self.problem.projection(point))
            # A descent may begin with an unstable point, but never goes back to one.
            if self.stable and not stable:
                return 0.0
            self._duals = np.clip(slopes + curvatures * (errors - self.errors), -1.0, 1.0)
            self.point, self.errors, self.stable = point, errors, stable
            gain, value = value - new, new
            return gain

        tolerance = ABSOLUTE_TOLERANCE * width
        return self._damping.descend(equations, tried, STEPS_AT_WIDTH, tolerance)

    def _smoothed(self, errors: Array, widths: Array) -> float:
        if not np.isfinite(errors).all():
            return float("inf")
        return _criterion(np.mean(np.hypot(errors, widths), axis=0), self.problem.weighing)

    def _normal_equations(
        self, sizes: Array, slopes: Array, curvatures: Array
    ) -> tuple[Array, Array]:
        """Gradient and primal-dual Hessian of the smoothed criterion."""
        weights = output_weights(np.mean(sizes, axis=0), self.problem.weighing) / len(sizes)
        count = len(self.point)
        gradient, hessian = np.zeros(count), np.zeros((count, count))
        for k, (columns, places) in enumerate(self.problem.jacobians(self.point)):
            rows, columns = np.arange(count)[places], columns / self.problem.sizes[k]
            gradient[rows] += weights[k] * (slopes[:, k] @ columns)
            weighted = columns * (weights[k] * curvatures[:, k])[:, None]
            hessian[np.ix_(rows, rows)] += columns.T @ weighted
        self.evaluations += 1
        return gradient, hessian
