"""BFGS for many starts at once, in lockstep, so that they share the passes of the objective."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Evaluate = Callable[[Array, Rows], tuple[Array, Array]]
InverseHessians = Callable[[Array, Rows], Array]

SUFFICIENT_DECREASE = 1e-4
CURVATURE = 0.9
LONGEST_LINE_SEARCH = 30
# Least part of a bracket that an interpolated step keeps.
SHORTEST_CUT = 0.1
# Accepted steps after which the inverse Hessian is approximated anew.
REFRESH = 40


@dataclass(frozen=True)
class Descent:
    """Where each start ended: points (M, n), values (M,), evaluations of value and gradient."""

    points: Array
    values: Array
    converged: NDArray[np.bool_]
    evaluations: int


def descend(
    evaluate: Evaluate,
    starts: Array,
    inverse_hessians: InverseHessians,
    max_iterations: int,
    tolerance: float,
    refresh: int | None = REFRESH,
) -> Descent:
    """Minimise from each row of ``starts`` by BFGS with a weak Wolfe line search.

    The line search brackets and bisects as Lewis & Overton (2013) do for objectives with corners,
    so it serves the absolute objective as well as the quadratic one; points of infinite value
    (outside the stability region) only shorten the step.

    Parameters
    ----------
    evaluate : callable
        ``evaluate(points, rows)``: values (m,) and gradients (m, n) at the (m, n) points, which
        belong to the starts ``rows``; infinite values allowed.
    starts : (M, n) array
    inverse_hessians : callable
        ``inverse_hessians(points, rows)``: first approximations of the inverse Hessian, (m, n, n).
    max_iterations : int
        Accepted steps a start may take.
    tolerance : float
        A start has converged once the decrease its quadratic model promises, and the decrease it
        last made, are below this fraction of its value.
    refresh : int, optional
        Accepted steps after which ``inverse_hessians`` is asked again; None where it knows no more
        than at the start.
    """
    x = starts.copy()
    f, g = evaluate(x, np.arange(len(x)))
    evaluations = len(x)
    active = np.isfinite(f)
    h = np.zeros((*x.shape, x.shape[1]))
    h[active] = inverse_hessians(x[active], np.flatnonzero(active))
    d = np.zeros_like(x)
    slope = np.zeros(len(x))
    _aim(np.flatnonzero(active), g, h, d, slope)
    step, low, high = np.ones(len(x)), np.zeros(len(x)), np.full(len(x), np.inf)
    tries = np.zeros(len(x), dtype=int)
    iterations = np.zeros(len(x), dtype=int)
    converged = np.zeros(len(x), dtype=bool)
    while active.any():
        rows = np.flatnonzero(active)
        trial = x[rows] + step[rows, None] * d[rows]
        ft, gt = evaluate(trial, rows)
        # A step out of the stability region is refused before any residual is computed.
        evaluations += int(np.isfinite(ft).sum())
        tries[rows] += 1
        drop = f[rows] - ft
        decreased = ft <= f[rows] + SUFFICIENT_DECREASE * step[rows] * slope[rows]
        flat_enough = np.einsum("ij,ij->i", gt, d[rows]) >= CURVATURE * slope[rows]
        # A search that keeps its decrease but never flattens ends with the decrease it has.
        accept = decreased & (flat_enough | (tries[rows] >= LONGEST_LINE_SEARCH))
        refuse = rows[~decreased]
        high[refuse] = step[refuse]
        stretch = rows[decreased & ~accept]
        low[stretch] = step[stretch]
        searching = rows[~accept]
        step[searching] = _next_step(
            low[searching], high[searching], f[searching], slope[searching], ft[~accept]
        )
        active[searching[tries[searching] >= LONGEST_LINE_SEARCH]] = False

        moved = rows[accept]
        if not len(moved):
            continue
        _update(h, moved, step[moved, None] * d[moved], gt[accept] - g[moved])
        x[moved], f[moved], g[moved] = trial[accept], ft[accept], gt[accept]
        iterations[moved] += 1
        if refresh is not None:
            stale = moved[iterations[moved] % refresh == 0]
            if len(stale):
                h[stale] = inverse_hessians(x[stale], stale)
        _aim(moved, g, h, d, slope)
        step[moved], low[moved], high[moved], tries[moved] = 1.0, 0.0, np.inf, 0
        limit = tolerance * np.abs(f[moved])
        done = (-0.5 * slope[moved] <= limit) & (drop[accept] <= limit)
        converged[moved[done]] = True
        active[moved[done | (iterations[moved] >= max_iterations)]] = False
    return Descent(x, f, converged, evaluations)


def _next_step(low: Array, high: Array, f: Array, slope: Array, beyond: Array) -> Array:
    """The next trial step: twice the last one until a bracket is found, then inside it.

    While the bracket starts at zero its inside is the minimum of the parabola through value and
    slope there and the value at its far end; later, and where that end is infeasible, its middle.
    """
    width = high - low
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        parabola = -slope * high**2 / (2.0 * (beyond - f - slope * high))
    usable = np.isfinite(high) & np.isfinite(parabola) & np.isfinite(beyond) & (low == 0.0)
    inside = np.where(
        usable, np.clip(parabola, SHORTEST_CUT * width, 0.5 * width), low + 0.5 * width
    )
    return np.where(np.isfinite(high), inside, 2.0 * low)


def _aim(rows: Rows, g: Array, h: Array, d: Array, slope: Array) -> None:
    """Set the quasi-Newton direction; fall back on steepest descent where it does not descend."""
    d[rows] = -np.einsum("ijk,ik->ij", h[rows], g[rows])
    slope[rows] = np.einsum("ij,ij->i", d[rows], g[rows])
    uphill = rows[~(slope[rows] < 0.0)]
    if len(uphill):
        h[uphill] = np.eye(g.shape[1])
        d[uphill] = -g[uphill]
        slope[uphill] = -np.einsum("ij,ij->i", g[uphill], g[uphill])


def _update(h: Array, rows: Rows, s: Array, y: Array) -> None:
    """Update inverse Hessians by BFGS (Fletcher 1987), except where curvature is not positive."""
    sy = np.einsum("ij,ij->i", s, y)
    norms = np.linalg.norm(s, axis=1) * np.linalg.norm(y, axis=1)
    good = sy > 1e-12 * norms
    rows, s, y, sy = rows[good], s[good], y[good], sy[good]
    hy = np.einsum("ijk,ik->ij", h[rows], y)
    yhy = np.einsum("ij,ij->i", y, hy)
    weight = ((1.0 + yhy / sy) / sy)[:, None, None]
    cross = hy[:, :, None] * s[:, None, :]
    h[rows] += weight * s[:, :, None] * s[:, None, :]
    h[rows] -= (cross + np.swapaxes(cross, 1, 2)) / sy[:, None, None]
