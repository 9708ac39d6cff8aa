"""Descents of state-space models, and the problem as the memetic search sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import Objective
from evopem.estimation.damped_descent import Optimum, damped_step
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.state_space.errors import NormalEquations, Projection, StateSpaceErrors
from evopem.estimation.state_space.point_model import parameter_covariance
from evopem.estimation.state_space.sections import inside, normalised
from evopem.estimation.state_space.starting_points import from_poles, random_poles
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]


# Steps and tolerance of a descent of a search.
STEPS, TOLERANCE = 100, 1e-7
# Multiplications of one set of normal equations from which on descents race each other, and steps
# of a lap of such a race.
COSTLY, LAP = 2e7, 10
# Gain of twice the log likelihood that no choice depends on.
NEGLIGIBLE = 0.1
# Damping relative to the diagonal of the Hessian: at the start, and where a descent gives up.
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e12


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

    def normal_equations(self, projection: Errors) -> NormalEquations:
        """Gradient and Hessian of the last point."""


def descend(
    errors: Squares[Errors], start: Array, max_iterations: int, tolerance: float
) -> Optimum:
    """Minimise the criterion from a point.

    Parameters
    ----------
    errors : Squares
    start : (n,) array
    max_iterations : int
        Accepted steps.
    tolerance : float
        The descent has converged when a Gauss-Newton step promises less than this decrease of the
        criterion, or twice in a row gains less.
    """
    point = errors.begun(start)
    if not np.isfinite(point).all():
        return Optimum(point, np.inf, False, 0)
    projection = errors.projection(point)
    criterion, stable = errors.criterion(projection.covariance), errors.stable(projection)
    evaluations = 1
    if not np.isfinite(criterion):
        return Optimum(point, np.inf, False, evaluations)

    def ended(converged: bool) -> Optimum:
        return Optimum(point, criterion if stable else np.inf, converged, evaluations)

    damping, growth, small_gains = FIRST_DAMPING, 2.0, 0
    for _ in range(max_iterations):
        equations = errors.normal_equations(projection)
        evaluations += 1
        scale = np.sqrt(np.maximum(np.diag(equations.hessian), 0.0))
        scale = np.where(scale > 1e-12 * scale.max(initial=1e-300), scale, 1.0)
        gradient = equations.gradient / scale
        hessian = equations.hessian / np.outer(scale, scale)
        while True:
            step = damped_step(hessian, gradient, damping)
            if step is None:
                damping, growth = damping * growth, growth * 2.0
                if damping > LARGEST_DAMPING:
                    return ended(True)
                continue
            promised = -(gradient @ step) - 0.5 * step @ hessian @ step
            if promised < 0.1 * tolerance and damping <= FIRST_DAMPING:
                return ended(True)
            trial = errors.moved(point, step / scale)
            tried = errors.projection(trial) if np.isfinite(trial).all() else None
            evaluations += 1
            new, new_stable = np.inf, False
            if tried is not None:
                new_stable = errors.stable(tried)
                # A descent may begin with an unstable A, but never goes back to one.
                if new_stable or not stable:
                    new = errors.criterion(tried.covariance)
            if new < criterion and tried is not None:
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > LARGEST_DAMPING:
                return ended(True)
        gain = criterion - new
        ratio = gain / promised if promised > 0.0 else 0.0
        damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-15)
        growth = 2.0
        point, projection, criterion, stable = trial, tried, new, new_stable
        small_gains = small_gains + 1 if gain < tolerance else 0
        if small_gains >= 2:
            return ended(True)
    return ended(False)


def descended(
    errors: StateSpaceErrors,
    starts: list[Array],
    count: int,
    steps: int = STEPS,
    tolerance: float = TOLERANCE,
) -> list[Optimum]:
    """Optima from the best starts, the lowest first; infeasible ones are left out."""
    optima = [descend(errors, start, steps, tolerance) for start in lowest(errors, starts, count)]
    optima = [optimum for optimum in optima if np.isfinite(optimum.value)]
    return sorted(optima, key=lambda optimum: optimum.value)


def lowest(errors: StateSpaceErrors, starts: list[Array], count: int) -> list[Array]:
    """The starts of lowest criterion, in this order; A may be unstable there."""
    criteria = []
    for start in starts:
        finite = bool(np.isfinite(start).all())
        criteria.append(errors.criterion(errors.projection(start).covariance) if finite else np.inf)
    order = np.argsort(criteria, kind="stable")[:count]
    return [starts[k] for k in order]


def raced(errors: StateSpaceErrors, starts: list[Array], steps: int) -> list[Optimum]:
    """Optima from starts, the lowest first, which alone is descended to the last digits.

    The others end where no choice depends on what is left, and where each step takes long as soon
    as they fall behind.
    """
    tolerance = rough_tolerance(errors)
    optima = []
    if errors.cost > COSTLY:
        optima = _in_laps(errors, starts, steps, tolerance)
    optima = optima or descended(errors, starts, len(starts), steps, tolerance)
    return [continued(errors, optima[0], steps, TOLERANCE), *optima[1:]] if optima else []


def _in_laps(
    errors: StateSpaceErrors, starts: list[Array], steps: int, tolerance: float
) -> list[Optimum]:
    """Optima of descents of which only the better half goes on after each lap."""
    running = descended(errors, starts, len(starts), min(LAP, steps), tolerance)
    behind: list[Optimum] = []
    for _ in range(LAP, steps, LAP):
        if len(running) < 2:
            break
        half = -(-len(running) // 2)
        behind = running[half:] + behind
        further = [
            each if each.converged else continued(errors, each, LAP, tolerance)
            for each in running[:half]
        ]
        running = sorted(further, key=lambda optimum: optimum.value)
    return running + behind


def rough_tolerance(errors: StateSpaceErrors) -> float:
    """Tolerance of a descent whose last digits no choice depends on."""
    return max(NEGLIGIBLE / errors.data.samples if errors.logarithmic else 0.0, TOLERANCE)


def continued(errors: StateSpaceErrors, optimum: Optimum, steps: int, tolerance: float) -> Optimum:
    """The optimum that a descent goes on to, with the evaluations of both."""
    ended = descend(errors, optimum.point, steps, tolerance)
    return replace(ended, evaluations=optimum.evaluations + ended.evaluations)


# Steps and tolerance of the last descent of a search.
POLISH_STEPS, POLISH_TOLERANCE = 1000, 1e-11
# Random points of the first batch of a multistart check suffice.
MIN_MULTISTART = 1


class StateSpaceProblem:
    """Search problem of one recording, order and form; see :class:`.Problem`.

    Parameters
    ----------
    errors : StateSpaceErrors
    """

    objective: Objective = "quadratic"
    grams = 1
    """Gram matrices of one set of normal equations."""

    def __init__(self, errors: StateSpaceErrors) -> None:
        self.errors = errors
        self._starts: Array | None = None

    def start_from(self, coordinates: list[Array]) -> int:
        """Let the first population hold these points; returns the evaluations it took."""
        self._starts, used = self.nearest(coordinates)
        return used

    def nearest(self, coordinates: list[Array]) -> tuple[Array, int]:
        """Points next to optima of the quadratic objective, (m, n), and the evaluations."""
        return np.array(coordinates).reshape(-1, self.errors.dimension), 0

    def lowest_of(self, optima: list[Optimum]) -> tuple[Array, float, int]:
        """The lowest optimum next to those of the quadratic objective, its value, evaluations."""
        return optima[0].point, self.errors.percent(optima[0].value), 0

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates."""
        return coordinates

    def coordinates(self, point: Array) -> Array:
        """The coordinates of a point."""
        return point

    def projection(self, point: Array) -> Projection:
        """States, linear coefficients and errors of a point."""
        return self.errors.projection(point)

    def limited(self, errors: Array) -> Array:
        """Errors, (N, l), as their autoregression is fitted to them."""
        return errors

    def covariance(self, projection: Projection) -> ParameterCovariance | None:
        """Covariance of the entries of the model."""
        return parameter_covariance(
            self.errors, projection, self.errors.weights(projection.covariance)
        )

    @property
    def min_multistart(self) -> int:
        """Random points that a multistart check takes at least."""
        return MIN_MULTISTART

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._starts is None:
            return self.random(count, generator), count
        points = np.vstack([self._starts, self.random(max(count // 3, 1), generator)])
        if len(points) < count:
            points = np.vstack([points, self.random(count - len(points), generator)])
        self._starts = None
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], 2 * len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the recording."""
        order = self.errors.order
        return np.array(
            [from_poles(self.errors, random_poles(order, generator)) for _ in range(count)]
        )

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        limit = self.errors.radius * (1.0 - 1e-6)
        return np.array([inside(self.errors.layout, point, limit) for point in points])

    def values(self, points: Array) -> Array:
        """Criterion of each row in percent, (M,)."""
        return np.array([self.errors.percent(self.errors.value(point)) for point in points])

    def descend(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row."""
        return self.descents(points, STEPS, TOLERANCE)

    def polish(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row to the last digits."""
        return self.descents(points, POLISH_STEPS, POLISH_TOLERANCE)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section, poles and inputs, from one of two parents; no evaluations.

        Sections are ordered by the angle of their poles: those of one place are much alike.
        """
        layout = self.errors.layout
        pairs = generator.integers(len(parents), size=(2, count))
        from_first = generator.random((count, layout.sections)) < 0.5
        offspring = parents[pairs[1]].copy()
        for child, first, chosen in zip(offspring, parents[pairs[0]], from_first, strict=True):
            rows, other = layout.pair_rows(child), layout.pair_rows(first)
            taken = chosen[: layout.pairs]
            rows[taken] = other[taken]
            if layout.single and chosen[-1]:
                layout.single_row(child)[:] = layout.single_row(first)
        return np.array([normalised(layout, child) for child in offspring]), 0

    def descents(self, points: Array, steps: int, tolerance: float) -> Descent:
        """Descents of at most some steps from each row."""
        optima = [descend(self.errors, point, steps, tolerance) for point in points]
        return descent_of(optima, points, self.errors.percent)


def descent_of(
    optima: Sequence[Optimum], points: Array, percent: Callable[[float], float]
) -> Descent:
    """Descents from each row of points, their values in percent."""
    return Descent(
        points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
        values=np.array([percent(optimum.value) for optimum in optima]),
        converged=np.array([optimum.converged for optimum in optima], dtype=bool),
        evaluations=sum(optimum.evaluations for optimum in optima),
    )
