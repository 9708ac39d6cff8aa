"""The search of a long record: on blocks of it, and descents on the whole from what it finds."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult, count_confirming, same_optimum
from evopem.estimation.search.staged_descent import (
    LINEAR_STEPS,
    POLISH_STAGES,
    polish,
    solve_linear,
)
from evopem.signals.recording import Segment, total_samples

# Samples of the blocks together, their number; how many times as many a long record has.
SEARCHED, BLOCKS, LONG = 50_000, 5, 4
# Optima that are descended from on the whole, at most: two passes take sixteen, eight at a time.
# They are those whose loss over the blocks is within so many standard errors of the lowest, and
# whose values differ by more than what descents leave.
DESCENDED, DOUBT, SAME = 16, 5.0, 1e-7
# How many times the mean error of a block that of other samples may be, and by how much the optimum
# of the whole may raise the objective of the blocks: chance raises its logarithm by the parameters
# over the samples.
LARGER, RAISED = 1.5, 20.0


def searched_blocks(segments: Sequence[Segment]) -> tuple[Segment, ...]:
    """The blocks that a long record is searched on; none of a shorter record, or where segments are
    too short for them.  Half of their density follows the power of the signals, so that what
    happens in a small part of the record is not missed; half is even."""
    if total_samples(segments) < LONG * SEARCHED:
        return ()
    power = np.concatenate([_power(segment) for segment in segments])
    density = np.cumsum(power / max(np.sum(power), np.finfo(float).tiny) + 1.0 / len(power))
    centres = np.searchsorted(density, density[-1] * (np.arange(BLOCKS) + 0.5) / BLOCKS)
    ends = np.cumsum([segment.samples for segment in segments])
    blocks, owners = [], np.searchsorted(ends, centres, "right")
    for owner in np.unique(owners):
        segment, at = segments[owner], centres[owners == owner] - ends[owner]
        length = min(SEARCHED // BLOCKS, segment.samples // len(at))
        places = length * np.arange(len(at))
        firsts = np.maximum(at + segment.samples - length // 2, 0)
        firsts = places + np.maximum.accumulate(firsts - places)  # without overlap
        firsts = np.minimum(firsts, segment.samples - length - places[::-1])
        blocks += [segment.between(first, first + length) for first in firsts.tolist()]
    shortest = min(block.samples for block in blocks)
    return tuple(blocks) if 2 * BLOCKS * shortest >= SEARCHED else ()


def _power(segment: Segment) -> Array:
    """Power of all signals, each about its mean and relative to its own, (N,)."""
    power = np.zeros(segment.samples)
    for signal in (*segment.inputs.T, *segment.outputs.T):
        squares = (signal - np.mean(signal)) ** 2
        power += squares / max(float(np.mean(squares)), np.finfo(float).tiny)
    return power


def carried(points: Array, errors: PolynomialErrors) -> Array:
    """Coefficients of points with the levels and states that other stretches ask for, (M, n)."""
    linear = errors.linear("level", "plant", "noise")
    moved = np.zeros((len(points), errors.dimension))
    moved[:, : errors.orders.parameters] = points[:, : errors.orders.parameters]
    steps = LINEAR_STEPS[errors.objective]
    return solve_linear(errors, moved, linear, steps) if linear.any() else moved


def searched_in_blocks(
    problem: PolynomialProblem,
    search: Callable[[PolynomialProblem, float], SearchResult],
    known: tuple[Array, float] | None = None,
) -> SearchResult | None:
    """The lowest optimum on a long record next to those of its blocks that these do not tell from
    the lowest; None of a shorter record, and where the blocks do not stand for it.

    ``search``: of a problem, and the share of its objective in that of the whole; ``known``: a
    point of the whole and its value.  Restarts that agree on the blocks do so on the whole.
    """
    whole = problem.errors
    if not (blocks := searched_blocks(whole.stretches)):
        return None
    in_blocks = PolynomialProblem(whole.of_other(blocks))
    errors, share = in_blocks.errors, 1.0
    if known is not None and known[1] > 0.0:
        share = float(errors.values(carried(known[0][None, :], errors))[0]) / known[1]
    outcome = search(in_blocks, share)
    values, optima = _undecided(errors, outcome)
    starts = carried(np.array(optima), whole)
    # Only an absolute objective has kinks, which the earlier stages smooth.
    stages = POLISH_STAGES[-1:] if whole.objective == "quadratic" else POLISH_STAGES
    ended = polish(whole, starts, max(values), stages, wait=None)
    best = int(np.argmin(ended.values))
    point, value = ended.points[best], float(ended.values[best])
    on_blocks = carried(point[None, :], errors)
    back = float(errors.values(on_blocks)[0])
    most = RAISED * errors.parameters / errors.scored_samples
    if not (back <= values[best] * (1.0 + most) and _alike((errors, on_blocks[0]), (whole, point))):
        return None
    pairs = list(zip(values, ended.values.tolist(), strict=True))
    ratio = pairs[0][1] / values[0] if values[0] > 0.0 else 1.0

    def on_whole(minimum: float) -> float:
        ends = (end for at, end in pairs if same_optimum(max(minimum, at), min(minimum, at)))
        return next(ends, minimum * ratio)

    of_search = outcome.diagnostics
    minima = tuple(map(on_whole, of_search.restart_minima))
    spent = of_search.evaluations + ended.evaluations
    passed = np.minimum.accumulate([max(on_whole(at), value) for _, at in of_search.convergence])
    convergence = [
        (at, v) for (at, _), v in zip(of_search.convergence, passed.tolist(), strict=True)
    ]
    diagnostics = replace(
        of_search,
        evaluations=spent,
        restart_minima=minima,
        n_confirming=count_confirming(minima, value),
        convergence=(*convergence, (spent, value)),
    )
    return SearchResult(point, value, diagnostics)


def _undecided(errors: PolynomialErrors, outcome: SearchResult) -> tuple[list[float], list[Array]]:
    """Values and points of the optima that the losses do not tell from the lowest (Vuong 1989)."""
    values, points = [outcome.value], [outcome.point]
    lowest = _losses(errors, outcome.point)
    for value, point in sorted(outcome.ends, key=lambda end: end[0]):
        if len(values) == DESCENDED:
            break
        if not np.isfinite(value) or same_optimum(value, values[-1], SAME):
            continue
        above = _losses(errors, point) - lowest
        if np.mean(above) <= DOUBT * np.std(above) / np.sqrt(len(above)):
            values.append(value)
            points.append(point)
    return values, points


def _losses(errors: PolynomialErrors, point: Array) -> Array:
    residuals = errors.residuals(point)
    return np.abs(residuals) if errors.objective == "absolute" else residuals**2


def _alike(blocks: tuple[PolynomialErrors, Array], whole: tuple[PolynomialErrors, Array]) -> bool:
    """Whether the errors of no part of the whole are far larger than those of all blocks."""
    length = min(blocks[0].residual_counts())
    in_blocks, everywhere = (
        max(
            float(np.mean(np.abs(e[at : at + length])))
            for e in errors.residuals_of_stretches(point)
            for at in (*range(0, len(e) - length, length), max(len(e) - length, 0))
        )
        for errors, point in (blocks, whole)
    )
    return everywhere <= LARGER * in_blocks
