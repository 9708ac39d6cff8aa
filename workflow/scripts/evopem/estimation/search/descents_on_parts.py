"""Descents of one model on several parts of a recording at once, one on each."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from evopem.arrays import Array, Indices
from evopem.estimation.pem.kernels.bfgs import descend_by
from evopem.estimation.pem.kernels.gradient import GRADIENTS, VALUES
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.stretch_errors import Passes
from evopem.estimation.search.staged_descent import (
    LINEAR_STEPS,
    MAX_ITERATIONS,
    DescentStage,
    damped_inverses,
    nearly_dependent,
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
