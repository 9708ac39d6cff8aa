"""The state-space problem as the memetic search sees it, and the estimates it starts from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.state_space.covariance import parameter_covariance
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.levenberg_marquardt import descend
from evopem.estimation.state_space.sections import inside, normalised
from evopem.estimation.state_space.settings import Objective
from evopem.estimation.state_space.starting_points import (
    extended,
    from_matrices,
    from_poles,
    random_poles,
)
from evopem.estimation.state_space.subspace import (
    Complex,
    PredictorModel,
    canonical_variates,
    instrumental_poles,
    largest_lag,
    long_arx,
    realised_poles,
)
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]
Log = Callable[[str], None]

# Lags of the long ARX models, and horizons of the instrumental estimates.
LAGS = (8, 20, 50)
HORIZONS = (10, 25)
# Largest order of most records.
USUAL_ORDER = 20
# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 3
# Steps and tolerance of a descent of the search, and of the last one.
STEPS, TOLERANCE = 100, 1e-7
POLISH_STEPS, POLISH_TOLERANCE = 1000, 1e-11
# Multiplications of one set of normal equations from which on descents race each other, and steps
# of a lap of such a race.
COSTLY, LAP = 2e7, 10
# Gain of twice the log likelihood that no choice depends on.
NEGLIGIBLE = 0.1
# Random points of the first batch of a multistart check suffice.
MIN_MULTISTART = 1


class StateSpaceProblem:
    """Search problem of one record, order and form; see :class:`evopem...search.problem.Problem`.

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
        """Errors, (N, ny), as their autoregression is fitted to them."""
        return errors

    def covariance(self, found: Projection) -> ParameterCovariance | None:
        """Covariance of the entries of the model."""
        return parameter_covariance(self.errors, found, self.errors.weights(found.covariance))

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
        """Independent points with random poles, whose inputs fit the record."""
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
        return Descent(
            points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
            values=np.array([self.errors.percent(optimum.value) for optimum in optima]),
            converged=np.array([optimum.converged for optimum in optima], dtype=bool),
            evaluations=sum(optimum.evaluations for optimum in optima),
        )


_Estimates = tuple[list[list[PredictorModel]], list[list[Complex]]]


class StartingModels:
    """Estimates by linear algebra of one record, for all orders and both forms.

    Parameters
    ----------
    errors : StateSpaceErrors
        Of any order and form.
    largest_order : int
    thorough : bool
        Several lags and horizons instead of one.
    """

    def __init__(self, errors: StateSpaceErrors, largest_order: int, thorough: bool) -> None:
        self._record, self._thorough = errors.record, thorough
        self._inputs = errors.record.inputs.shape[1]
        self._largest = largest_order
        self._made: dict[int, _Estimates] = {}

    def points(self, errors: StateSpaceErrors) -> Iterator[Array]:
        """Points of the order and form of a problem."""
        at = errors.order - 1
        predictors, found_poles = self._estimates(errors.order)
        for models in predictors:
            if at >= len(models):
                continue
            model = models[at]
            A, B = model.A, model.B
            if not errors.innovations:
                A, B = A + B[:, self._inputs :] @ model.C, B[:, : self._inputs]
            yield from_matrices(errors, A, B)
            yield from_poles(errors, np.asarray(np.linalg.eigvals(A), dtype=complex))
        for poles in found_poles:
            if at < len(poles) and not errors.innovations:
                yield from_poles(errors, poles[at])

    def _estimates(self, order: int) -> _Estimates:
        """Predictors and poles of all orders, made for the larger ones only where they are needed.

        Those take longer lags, which the smaller ones do not need.
        """
        largest = self._largest if order > USUAL_ORDER else min(self._largest, USUAL_ORDER)
        if largest not in self._made:
            self._made[largest] = self._made_for(largest)
        return self._made[largest]

    def _made_for(self, largest_order: int) -> _Estimates:
        record, thorough = self._record, self._thorough
        outputs = record.outputs.shape[1]
        least = -(-largest_order // outputs) + 2
        most = largest_lag(record)
        lags = sorted({min(max(lag, least), most) for lag in LAGS})
        if not thorough:
            lags = lags[len(lags) // 2 : len(lags) // 2 + 1]
        predictors, poles = [], []
        for lag in lags:
            arx = long_arx(record, lag)
            future = min(lag, max(10, least))
            predictors.append(canonical_variates(record, arx, future, largest_order))
            if thorough:
                poles.append(realised_poles(record, arx, largest_order))
        for horizon in HORIZONS if thorough else ():
            longest = (record.samples // (2 * self._inputs + 2 * outputs)) // 3
            wanted = min(max(horizon, least + 1), longest)
            if wanted > 2:
                poles.append(instrumental_poles(record, wanted, largest_order))
        return predictors, poles


def converted(errors: StateSpaceErrors, other: StateSpaceErrors, point: Array) -> Array:
    """The point of a problem of the other form as one of this form.

    An innovations model loses its K, an output-error model gets K = 0.
    """
    found = other.projection(point)
    inputs = errors.record.inputs.shape[1]
    A, C = other.state_matrix(found), found.linear[: other.order].T
    B = other.drive_matrix(found)[:, :inputs]
    if errors.innovations:
        return from_matrices(errors, A, np.column_stack([B, np.zeros((len(A), len(C)))]))
    D = np.zeros((len(C), inputs))
    direct = errors.record.feedthrough
    D[:, direct] = found.linear[other.order : other.order + int(direct.sum())].T
    return from_matrices(errors, A, B + other.gain(found) @ D)


def extensions(
    larger: StateSpaceErrors,
    smaller: StateSpaceErrors,
    point: Array,
    generator: np.random.Generator,
    tried: int = PAIRS,
    kept: int = DESCENDED,
) -> list[Array]:
    """The best of some points that add random poles to the optimum of a smaller order."""
    remainder = smaller.projection(point).errors
    added = larger.order - smaller.order
    points = [
        extended(larger, smaller, point, remainder, random_poles(added, generator))
        for _ in range(tried)
    ]
    # Added poles may leave A unstable where the descent does not.
    criteria = [larger.criterion(larger.projection(each).covariance) for each in points]
    return [points[k] for k in np.argsort(criteria, kind="stable")[:kept]]


def reductions(larger: StateSpaceErrors, point: Array) -> list[Array]:
    """The point of an order without one of its pairs of poles, for each of them."""
    rows, single = larger.layout.pair_rows(point), larger.layout.single_row(point)
    return [
        np.concatenate([np.delete(rows, pair, axis=0).ravel(), single]) for pair in range(len(rows))
    ]


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
        found = errors.projection(start) if np.isfinite(start).all() else None
        criteria.append(np.inf if found is None else errors.criterion(found.covariance))
    order = np.argsort(criteria, kind="stable")[:count]
    return [starts[k] for k in order]


def cost(errors: StateSpaceErrors) -> float:
    """Multiplications of one set of normal equations."""
    layout = errors.layout
    signals = 2 * layout.sections * layout.drives + 2 * layout.order
    return float(errors.record.samples) * signals**2


def raced(errors: StateSpaceErrors, starts: list[Array], steps: int) -> list[Optimum]:
    """Optima from starts, the lowest first, which alone is descended to the last digits.

    The others end where no choice depends on what is left, and where each step takes long as soon
    as they fall behind.
    """
    tolerance = _rough(errors)
    optima = []
    if cost(errors) > COSTLY:
        optima = _in_laps(errors, starts, steps, tolerance)
    optima = optima or descended(errors, starts, len(starts), steps, tolerance)
    return [_continued(errors, optima[0], steps, TOLERANCE), *optima[1:]] if optima else []


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
            each if each.converged else _continued(errors, each, LAP, tolerance)
            for each in running[:half]
        ]
        running = sorted(further, key=lambda optimum: optimum.value)
    return running + behind


def _rough(errors: StateSpaceErrors) -> float:
    """Tolerance of a descent whose last digits no choice depends on."""
    return max(NEGLIGIBLE / errors.record.samples if errors.logarithmic else 0.0, TOLERANCE)


def _continued(errors: StateSpaceErrors, optimum: Optimum, steps: int, tolerance: float) -> Optimum:
    ended = descend(errors, optimum.point, steps, tolerance)
    return replace(ended, evaluations=optimum.evaluations + ended.evaluations)


def rungs(
    errors: StateSpaceErrors,
    models: StartingModels,
    generator: np.random.Generator,
    width: int,
    orders: range,
    steps: int = STEPS,
    log: Log | None = None,
) -> Iterator[tuple[StateSpaceErrors, list[Optimum]]]:
    """Optima of several orders, each from estimates and from the optima of its neighbours.

    Parameters
    ----------
    errors : StateSpaceErrors
        Of any order.
    models : StartingModels
    generator : numpy.random.Generator
    width : int
        Estimates of each order that are descended from.
    orders : range
        Ascending, in steps of one or two.
    steps : int
        Of each descent at most.
    log : callable, optional
        Receives one line as each order begins.

    Yields
    ------
    The problem of each order, and its optima, the lowest first; an order after the one that has two
    states more, whose optimum is a start for it as well.
    """
    found: list[Rung] = []
    yielded = 0
    for order in orders:
        if log is not None:
            log(f"{errors.form}: order {order} of at most {orders[-1]}")
        problem = errors.of_order(order)
        starts = lowest(problem, list(models.points(problem)), width)
        for below in [rung for rung in found if rung.optima][-2:]:
            starts += extensions(
                *(problem, below.problem, below.optima[0].point, generator),
                tried=8 * width,
                kept=max(width // 2, 1),
            )
        optima = raced(problem, starts, steps)
        for _ in range(20):
            if optima:
                break
            start = from_poles(problem, random_poles(order, generator))
            optima = descended(problem, [start], 1, steps)
        found.append(Rung(problem, optima))
        while found[yielded].problem.order <= order - 2:
            rung = found[yielded] = found[yielded].lowered(found[-1], steps)
            yielded += 1
            yield rung.problem, rung.optima
    for rung in found[yielded:]:
        yield rung.problem, rung.optima


@dataclass(frozen=True)
class Rung:
    """A problem of one order and its optima, the lowest first."""

    problem: StateSpaceErrors
    optima: list[Optimum]

    def lowered(self, above: Rung, steps: int) -> Rung:
        """With the optimum that begins with that of two states more."""
        if above.problem.order != self.problem.order + 2 or not above.optima:
            return self
        starts = reductions(above.problem, above.optima[0].point)
        reached = descended(self.problem, starts, 1, steps, _rough(self.problem))
        if reached and (not self.optima or reached[0].value < self.optima[0].value):
            reached = [_continued(self.problem, reached[0], steps, TOLERANCE)]
        optima = sorted([*reached, *self.optima], key=lambda optimum: optimum.value)
        return Rung(self.problem, optima)
