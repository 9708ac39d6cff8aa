"""Optima of ascending orders, each from estimates and from the optima of its neighbours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.levenberg_marquardt import descend
from evopem.estimation.state_space.problem import STEPS, TOLERANCE
from evopem.estimation.state_space.starting_models import StartingModels
from evopem.estimation.state_space.starting_points import (
    extended,
    from_matrices,
    from_poles,
    random_poles,
)

Array = NDArray[np.float64]
Log = Callable[[str], None]

# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 3
# Multiplications of one set of normal equations from which on descents race each other, and steps
# of a lap of such a race.
COSTLY, LAP = 2e7, 10
# Gain of twice the log likelihood that no choice depends on.
NEGLIGIBLE = 0.1


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


def raced(errors: StateSpaceErrors, starts: list[Array], steps: int) -> list[Optimum]:
    """Optima from starts, the lowest first, which alone is descended to the last digits.

    The others end where no choice depends on what is left, and where each step takes long as soon
    as they fall behind.
    """
    tolerance = _rough(errors)
    optima = []
    if errors.cost > COSTLY:
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
