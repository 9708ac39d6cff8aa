"""Descents in stages: BFGS with ever less smoothing and an ever weaker stability barrier.

Of many points on one recording, or of one point on several parts of it at once.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array, Flags, Indices
from evopem.errors import InputError
from evopem.estimation.pem.derived_errors import CoordinateErrors, KStepErrors
from evopem.estimation.pem.kernels.bfgs import Descent, descend, descend_by
from evopem.estimation.pem.kernels.gradient import GRADIENTS, VALUES
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import Passes
from evopem.estimation.search.problem import (
    SearchResult,
    converged_values,
    count_distinct,
    same_optimum,
)

PredictionErrors = PolynomialErrors | KStepErrors | CoordinateErrors

MAX_ITERATIONS = 200
# A pass over the recording costs the same for one model as for eight.  Once half of the descents
# have ended, the others get as many trials again, and keep the point they have reached then.
WAIT = 1.0
# Added to the unit diagonal of a scaled Gauss-Newton matrix, times its size: directions that the
# data say less about are left to BFGS.
DAMPING = 1e-12
# Smallest eigenvalue of such a matrix that its products of columns still tell, and the smallest
# singular value of its columns themselves, relative to the largest.
DEPENDENT, LEAST_SINGULAR = 1e-13, 1e-11
# Variance inflation factor, a diagonal entry times that of the damped inverse, from which on the
# eigenvalues are looked at.
SUSPECTED = 1e8
# Smallest ratio of a diagonal entry to the largest one at which a coordinate is sensitive.
SENSITIVE = 1e-60


class DescentStage(NamedTuple):
    """One BFGS run of a descent.  The smoothing of the absolute value is in units of mean |e|, the
    weight of the stability barrier in units of the objective, and the tolerance is the relative
    decrease that ends the run."""

    smoothing: float
    barrier: float
    tolerance: float


DESCENT_STAGES = (DescentStage(0.1, 1e-4, 1e-5), DescentStage(0.01, 1e-7, 1e-9))
POLISH_STAGES = (
    DescentStage(1e-2, 1e-7, 1e-10),
    DescentStage(1e-3, 1e-8, 1e-10),
    DescentStage(1e-4, 1e-9, 1e-11),
)
# Of the first pass of a race, which compares far larger differences than the other stages take most
# of their evaluations for: of an absolute objective 0.004 of its value times parameters over
# samples.
COARSE_STAGES = (DescentStage(0.05, 1e-5, 1e-6),)
LAST_COARSE_STAGES = POLISH_STAGES[:1]

# Relative distance from the lowest value within which a descent is refined, and the most of them.
NEAR, REFINED = 1e-3, 8
SHARPENED = 0.01  # the same of descents of absolute errors that are told apart

# Newton steps towards linear coordinates: one is exact for the quadratic objective.
LINEAR_STEPS = {"quadratic": 1, "absolute": 4}


def staged_descent(
    errors: PredictionErrors,
    points: Array,
    stages: tuple[DescentStage, ...],
    largest_value: float | None = None,
    first_damping: float = DAMPING,
    wait: float | None = WAIT,
) -> Descent:
    """BFGS from each point, preconditioned by its Gauss-Newton matrix, stage after stage.
    ``points`` (M, n): feasible.  ``largest_value``: values of the objective that weigh the barrier
    are cut off here, or at the lowest.  ``first_damping``: of the Gauss-Newton matrix at first."""
    values = errors.values(points)
    largest_value = float(np.min(values)) if largest_value is None else largest_value
    evaluations = len(points)
    damping = first_damping
    for stage in stages:
        smoothing, barriers = stage_weights(errors, stage, values, largest_value)
        result = _bfgs(errors, points, smoothing, barriers, stage.tolerance, damping, wait)
        damping = DAMPING
        points = result.points
        values = errors.values(points)
        evaluations += 2 * result.evaluations + len(points)
    return Descent(points, values, result.converged, evaluations)


def coarse_descent(errors: PredictionErrors, points: Array, largest_value: float) -> Descent:
    """Descents to 1e-4 of the value; the lowest goes a little further."""
    descents = staged_descent(errors, points, COARSE_STAGES, largest_value)
    lowest = [int(np.argmin(descents.values))]
    polished = polish(errors, descents.points[lowest], largest_value, LAST_COARSE_STAGES)
    descents.points[lowest], descents.values[lowest] = polished.points, polished.values
    return replace(descents, evaluations=descents.evaluations + polished.evaluations)


def sharpened(errors: PolynomialErrors, descents: Descent, largest_value: float) -> Descent:
    """Descents of absolute errors, the lowest repeated from their ends: smoothed by the value that
    each began with, descents to one optimum end up to 1e-3 apart."""
    if errors.objective == "quadratic":
        return descents
    near = np.flatnonzero(descents.values <= (1.0 + SHARPENED) * np.min(descents.values))
    ended = polish(errors, descents.points[near], largest_value, POLISH_STAGES[:1])
    descents.points[near], descents.values[near] = ended.points, ended.values
    descents.converged[near] |= ended.converged
    return replace(descents, evaluations=descents.evaluations + ended.evaluations)


def polish(
    errors: PredictionErrors,
    points: Array,
    largest_value: float,
    stages: tuple[DescentStage, ...] = POLISH_STAGES,
    wait: float | None = WAIT,
) -> Descent:
    """Descents with ever less smoothing; never worse than where they began."""
    polished = staged_descent(errors, points, stages, largest_value, wait=wait)
    before = errors.values(points)
    worse = ~(polished.values <= before)
    polished.points[worse], polished.values[worse] = points[worse], before[worse]
    return replace(polished, evaluations=polished.evaluations + len(points))


def stage_weights(
    errors: PredictionErrors, stage: DescentStage, values: Array, largest_value: float
) -> tuple[Array, Array]:
    """Smoothing and weight of the barrier for points that start a stage at these values."""
    mean = errors.mean_absolute_residuals(values)
    mean = np.where(np.isfinite(mean) & (mean > 0.0), mean, 1.0)
    return stage.smoothing * mean, stage.barrier * np.minimum(values, largest_value)


def _bfgs(
    errors: PredictionErrors,
    points: Array,
    smoothing: Array,
    barriers: Array,
    tolerance: float,
    damping: float,
    wait: float | None,
) -> Descent:
    """BFGS from each point, in a frame of its own where the products of its matrix say too little
    for a start without further damping."""

    def inverse_hessians(at: Array, rows: Indices) -> Array:
        return damped_inverses(errors.curvatures(at, smoothing[rows], barriers[rows]), damping)

    if not isinstance(errors, PolynomialErrors):
        return descend(
            lambda trial, rows: errors.values_and_gradients(trial, smoothing[rows], barriers[rows]),
            points,
            inverse_hessians,
            MAX_ITERATIONS,
            tolerance,
            wait=wait,
        )
    matrices = errors.curvatures(points, smoothing, barriers)
    inverses = damped_inverses(matrices, damping)
    if damping > DAMPING or not (framed := nearly_dependent(matrices, inverses)).any():
        advance = partial(errors.passes.advance, (smoothing, barriers, tolerance, MAX_ITERATIONS))
        return descend_by(advance, points, inverse_hessians, wait=wait, first=inverses)
    rest = ~framed
    given = points[framed], smoothing[framed], barriers[framed]
    ends = [_bfgs_in_frames(errors, *given, tolerance, wait)]
    if rest.any():
        given = points[rest], smoothing[rest], barriers[rest]
        ends.append(_bfgs(errors, *given, tolerance, damping, wait))
    order = np.argsort(np.concatenate([np.flatnonzero(framed), np.flatnonzero(rest)]))
    return Descent(
        np.concatenate([end.points for end in ends])[order],
        np.concatenate([end.values for end in ends])[order],
        np.concatenate([end.converged for end in ends])[order],
        sum(end.evaluations for end in ends),
    )


def _bfgs_in_frames(
    errors: PolynomialErrors,
    points: Array,
    smoothing: Array,
    barriers: Array,
    tolerance: float,
    wait: float | None,
) -> Descent:
    """BFGS in coordinates in which the Gauss-Newton matrix of each start is the identity."""
    starts = zip(points, smoothing, barriers, strict=True)
    frames = np.array([_frame(errors.curvature_root(*start)) for start in starts])
    placed = np.concatenate([frames, points[:, :, None]], axis=2)
    line_search = smoothing, barriers, tolerance, MAX_ITERATIONS
    advance = partial(errors.passes.advance, line_search, frames=placed)
    identities = np.tile(np.eye(points.shape[1]), (len(points), 1, 1))
    given = np.zeros_like(points), lambda _, rows: identities[rows]
    ended = descend_by(advance, *given, refresh=False, wait=wait)
    return replace(ended, points=points + np.einsum("mnk,mk->mn", frames, ended.points))


def _frame(root: Array) -> Array:
    """T, (n, n), with ``T T'`` the pseudo-inverse of ``R'R``: what no data tell does not move."""
    size = np.linalg.norm(root, axis=0)
    if not np.isfinite(size).all():
        return np.eye(len(root))
    sensitive = size**2 > SENSITIVE * np.max(size**2)
    scale = np.where(sensitive, 1.0 / np.where(sensitive, size, 1.0), 0.0)
    _, singular, directions = np.linalg.svd(root * scale)
    known = singular > LEAST_SINGULAR * singular[0]
    return (
        scale[:, None] * directions.T * np.where(known, 1.0 / np.where(known, singular, 1.0), 0.0)
    )


def promised_values(
    errors: PredictionErrors, points: Array, value: float, largest_value: float, damping: float
) -> Array:
    """Objective that one Gauss-Newton step from each feasible point predicts, (M,).  ``points`` (M,
    n).  ``value``: the size of the values, which smoothing and barrier depend on.  ``damping``: of
    the Gauss-Newton matrix."""
    smoothing, barriers = stage_weights(
        errors, DESCENT_STAGES[0], np.full(len(points), value), largest_value
    )
    values, gradients = errors.values_and_gradients(points, smoothing, barriers)
    inverses = damped_inverses(errors.curvatures(points, smoothing, barriers), damping)
    return np.asarray(values - 0.5 * np.einsum("ij,ijk,ik->i", gradients, inverses, gradients))


def nearly_dependent(matrices: Array, inverses: Array) -> Flags:
    """Which Gauss-Newton matrices, scaled, have an eigenvalue of the size of their rounding."""
    dependent = np.einsum("ijj,ijj->ij", matrices, inverses).max(axis=1) > SUSPECTED
    rows = np.flatnonzero(dependent)
    dependent[rows] = np.linalg.eigvalsh(_scaled(matrices[rows])[0])[:, 0] < DEPENDENT
    return np.asarray(dependent)


def damped_inverses(matrices: Array, damping: float = DAMPING) -> Array:
    """Inverses of positive semidefinite matrices, scaled to a unit diagonal and damped."""
    scaled, scale = _scaled(matrices)
    np.einsum("ijj->ij", scaled)[:] += damping * matrices.shape[1]
    inverses = np.linalg.inv(scaled)
    damped = 0.5 * (inverses + np.swapaxes(inverses, 1, 2))
    damped *= scale[:, :, None]
    damped *= scale[:, None, :]
    return np.asarray(damped)


def _scaled(matrices: Array) -> tuple[Array, Array]:
    """Matrices scaled to a unit diagonal, and the scales, (M, n).  Coordinates without any effect,
    such as a noise state that has decayed, are not changed."""
    diagonal = np.einsum("ijj->ij", matrices)
    sensitive = diagonal > SENSITIVE * diagonal.max(axis=1, keepdims=True)
    scale = np.where(sensitive, 1.0 / np.sqrt(np.where(sensitive, diagonal, 1.0)), 0.0)
    scaled = matrices * scale[:, :, None]
    scaled *= scale[:, None, :]
    finite = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~finite] = np.eye(matrices.shape[1])
    scale[~finite] = 1.0
    np.einsum("ijj->ij", scaled)[:] = 1.0
    return scaled, scale


def solve_linear(
    errors: PredictionErrors, points: Array, linear: Flags, steps: int, alone: bool = False
) -> Array:
    """Points, (M, n), changed in place, whose linear coordinates minimise the objective, given the
    others, by Newton steps (:data:`LINEAR_STEPS`); ``alone`` with the rounding of each alone."""
    none = size = np.zeros(len(points))
    for _ in range(steps):
        if errors.objective == "absolute":
            size = errors.mean_absolute_residuals(errors.values(points))
            size = np.where(np.isfinite(size) & (size > 0.0), size, 1.0)
        _, gradients = errors.values_and_gradients(points, size, none)
        if isinstance(errors, PolynomialErrors):
            matrices = errors.curvatures_of(points, size, linear)
        else:
            matrices = errors.curvatures(points, size, none)[:, linear][:, :, linear]
        inverses = damped_inverses(matrices)
        slopes = np.asarray(gradients[:, linear], order="C" if alone else None)
        points[:, linear] -= np.einsum("ijk,ik->ij", inverses, slopes)
    return points


def multistart(errors: PredictionErrors, starts: Array, largest_value: float) -> SearchResult:
    """Descend from every start, refine the lowest, and count how many agree.  ``starts`` (M, n):
    those without a finite value are left out, the others count as restarts.  InputError when no
    start has a finite value."""
    evaluations = len(starts)
    starts = starts[np.isfinite(errors.values(starts))]
    if not len(starts):
        problem, remedy = "no model that was tried meets them", "relax them, or raise the orders"
        raise InputError("constraints", problem, remedy)
    descents = staged_descent(errors, starts, DESCENT_STAGES, largest_value)
    order = np.argsort(descents.values, kind="stable")
    lowest = descents.values[order[0]]
    near = [row for row in order if same_optimum(descents.values[row], lowest, NEAR)][:REFINED]
    refined = polish(errors, descents.points[near], largest_value)
    evaluations += descents.evaluations + refined.evaluations
    minima = descents.values.copy()
    minima[near] = refined.values
    best = int(np.argmin(refined.values))
    value = float(refined.values[best])
    optima = count_distinct(converged_values(descents))
    return SearchResult.of_descents(
        refined.points[best], value, evaluations, optima, minima.tolist()
    )


def descents_on_parts(
    parts: Sequence[PolynomialErrors], coefficients: Array, stage: DescentStage
) -> list[Array | None]:
    """Where BFGS ends on each part, as a point filled up with zeros, from the same coefficients.

    ``parts``: problems of the same orders and objective.  ``coefficients``: (n,), of A, B, C, D and
    F; B, levels and states are fitted to each part first.  None where a part begins outside
    the stability region, or products of columns say too little (:func:`.nearly_dependent`).
    """
    places = [place for part in parts for place in part.places]
    owners = [number for number, part in enumerate(parts) for _ in part.places]
    passes = Passes(places, np.concatenate([part.shares for part in parts]), owners)
    size = max(part.dimension for part in parts)
    points, none = np.zeros((len(parts), size)), np.zeros(len(parts))
    points[:, : len(coefficients)] = coefficients
    every, linear = np.arange(len(parts)), np.ones(size, dtype=bool)
    linear[: len(coefficients)] = parts[0].linear("b")[: len(coefficients)]
    points[:, linear] = 0.0

    def stacked(at: Array, rows: Indices, smoothing: Array, barriers: Array) -> Array:
        stack = np.zeros((len(rows), size, size))
        for matrix, point, row in zip(stack, at, rows, strict=True):
            n, given = parts[row].dimension, (smoothing[[row]], barriers[[row]])
            matrix[:n, :n] = parts[row].curvatures(point[None, :n], *given)[0]
        return stack

    def sizes() -> tuple[Array, Array]:
        values = passes.passed(VALUES, points, none, none)[0]
        pairs = zip(parts, values, strict=True)
        return values, np.array([part.mean_absolute_residuals(value) for part, value in pairs])

    for _ in range(LINEAR_STEPS[parts[0].objective]):
        smoothing = sizes()[1]
        slopes = passes.passed(GRADIENTS, points, smoothing, none)[1][:, linear]
        matrices = np.zeros((len(parts), *np.full(2, np.sum(linear))))
        for matrix, part, point, size_of in zip(matrices, parts, points, smoothing, strict=True):
            entries, n = linear[: part.dimension], np.sum(linear[: part.dimension])
            given = point[None, : part.dimension], size_of[None], entries
            matrix[:n, :n] = part.curvatures_of(*given)[0]
        inverses = damped_inverses(matrices)
        lost = nearly_dependent(matrices, inverses)
        points[:, linear] -= np.einsum("ijk,ik->ij", inverses, slopes)
    values, smoothing = sizes()
    smoothing, barriers = stage.smoothing * smoothing, stage.barrier * values
    lost |= ~np.isfinite(values)
    barriers[lost] = 0.0
    matrices = stacked(points, every, smoothing, barriers)
    inverses = damped_inverses(matrices)
    lost |= nearly_dependent(matrices, inverses)
    if lost.all():
        return [None] * len(parts)
    line_search = smoothing, barriers, stage.tolerance, MAX_ITERATIONS
    ended = descend_by(
        *(partial(passes.advance, line_search), points),
        lambda at, rows: damped_inverses(stacked(at, rows, smoothing, barriers)),
        first=inverses,
    )
    return [None if left else point for left, point in zip(lost, ended.points, strict=True)]
