"""Prediction errors of a polynomial model on one stretch, for whole populations at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from evopem.arrays import Array, Indices
from evopem.config.settings import ScoringWindow
from evopem.estimation.pem.kernels.bfgs import LINE, State
from evopem.estimation.pem.kernels.gauss_newton import gauss_newton_matrices
from evopem.estimation.pem.kernels.gradient import GRADIENTS, RESIDUALS, passes
from evopem.estimation.pem.kernels.polynomials import filter_rows
from evopem.estimation.pem.kernels.record import (
    LagSums,
    Objective,
    Record,
    Stretches,
    Workspace,
    lag_sums_for,
    record_of,
    workspace_for,
)
from evopem.models.orders import Orders
from evopem.signals.least_squares import chunks

# What the square of a noise state weighs against that of a residual: a prior of ten standard
# deviations of the innovations.  Where C forgets its start before the first scored residual, a
# state of any size would fit a few residuals more, and the search would have no end.
STATE_WEIGHT = 1e-2
# Width of the kernel that estimates the density of the residuals at zero, in mean |e|.
DENSITY_BANDWIDTH = 0.3
# Weight of the square of a plant state against that of a residual.  It only bounds states that the
# residuals that count do not determine: a prior of a thousand standard deviations.
PLANT_WEIGHT = 1e-6
NO_FRAMES: Array = np.empty((0, 0, 0))
LineSearch = tuple[Array, Array, float, int]


@dataclass(eq=False)
class StretchErrors:
    """What one stretch adds to an objective, its gradient and curvature, by compiled passes.
    ``inputs`` (N, m), ``output`` (N,).  Points are those of a problem of this stretch alone."""

    inputs: Array
    output: Array
    orders: Orders
    window: ScoringWindow
    objective: Objective
    level: bool

    def __post_init__(self) -> None:
        self.samples = len(self.output)
        self.residual_start, self.loss_start = self.window.residual_start, self.window.loss_start
        self.lender = self  # of buffers; no shorter
        self._sums: dict[bool, LagSums] = {}

    # Tables of eight numbers a sample, made when needed: a problem that is only scaled has none.
    @cached_property
    def _record(self) -> Record:
        starts = self.residual_start, self.loss_start
        return record_of(self.output, self.inputs, self.orders, self.level, *starts)

    @cached_property
    def _workspace(self) -> Workspace:
        return workspace_for(self._record)

    @cached_property
    def _alone(self) -> Passes:
        return Passes([(self, np.arange(np.sum(self._record.entry >= 0)))], np.ones(1))

    def _lag_sums(self, linear: bool) -> LagSums:
        if linear not in self._sums:
            self._sums[linear] = lag_sums_for(self._record, linear)
        return self._sums[linear]

    def curvatures(self, points: Array, smoothing: Array, linear: bool) -> Array:
        """Gauss-Newton matrices, (M, n, n), complete or only where B, level and states meet.  Those
        of the absolute loss are scaled by its mean second derivative: twice the density of the
        residuals at zero."""
        lender = self.lender
        sums = lender._lag_sums(linear)
        matrices: Array = gauss_newton_matrices(
            *(self._record, self.objective, lender._workspace, sums, DENSITY_BANDWIDTH),
            *(np.ascontiguousarray(points), smoothing),
        )
        return matrices

    def residuals(self, point: Array) -> Array:
        """Residuals of one point, (N,); zero before ``residual_start``."""
        residuals = np.zeros(self.samples)
        residuals[self.residual_start :] = self._residuals(point)
        return residuals

    def _residuals(self, point: Array) -> Array:
        """Residuals from the first on; x_i and v stand in the workspace as well."""
        none, first = np.zeros(1), self._record.layout["history"]
        self._alone.passed(RESIDUALS, point[None, :], none, none)
        return self._workspace.e[first : first + self.samples - self.residual_start, 0].copy()

    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Derivatives of the residuals from the first on by a point, consecutive rows.  Signals and
        impulses, delayed and filtered through D/C, D/CF_i or 1/C (Ljung 1999, section 10.3)."""
        parts = self._regressors(point)
        for first, stop in chunks(0, self.samples - self.residual_start):
            yield np.concatenate([part.rows(first, stop) for part in parts]).T

    def _regressors(self, point: Array) -> list[_Regressors]:
        """What the entries of a point multiply, in their order."""
        o, start, record, work = self.orders, self.residual_start, self._record, self._workspace
        e = self._residuals(point)
        rows = slice(first := record.layout["history"], first + len(e))
        v = work.v[rows, 0].copy() if o.nd else e
        impulse = np.zeros(len(e))
        impulse[0] = 1.0
        c, d = (np.append(1.0, point[o.part(name)]) for name in "cd")
        none = np.ones(1)
        of_b, of_f, of_states = [], [], []
        for i, (nb, nf, nk) in enumerate(zip(o.nb, o.nf, o.nk, strict=True)):
            f, u = np.append(1.0, point[o.part("f", i)]), self.inputs[:, i]
            of_b.append(_Regressors(-u, start, nk, nb, d, (c, f)))
            if nf:
                x = work.x[i * record.layout["rows"] :][rows, 0]
                of_f.append(_Regressors(*_from_rest(-x, nf), 1, nf, d, (c, f)))
                of_states.append(_Regressors(*_from_rest(impulse, nf), 0, nf, d, (c, f)))
        regressors = [
            _Regressors(self.output, start, 1, o.na, d, (c,)),
            *of_b,
            _Regressors(*_from_rest(-e, o.nc), 1, o.nc, none, (c,)),
            _Regressors(*_from_rest(v, o.nd), 1, o.nd, none, (c,)),
            *of_f,
            _Regressors(-np.ones(len(e)), 0, 0, int(self.level), d, (c,)),
            *of_states,
            _Regressors(*_from_rest(impulse, o.noise_states), 0, o.noise_states, none, (c,)),
        ]
        return [regressors for regressors in regressors if regressors.copies]


class Passes:
    """Passes over stretches, each with the place of its point and its share of the barriers.
    ``owners``: of each the only start that it counts for, -1 for all."""

    def __init__(
        self,
        places: Sequence[tuple[StretchErrors, Indices]],
        shares: Array,
        owners: Sequence[int] = (),
    ) -> None:
        parts, at = zip(*places, strict=True)
        longest = max(parts, key=lambda part: part.samples)
        for part in parts:
            part.lender = longest
        records = [part._record for part in parts]
        signals = [r.y for r in records], [r.u for r in records]
        of_y, of_u = (s[0] if len(s) == 1 else np.concatenate(s) for s in signals)
        y, u = (np.cumsum([0, *map(len, s)]) for s in signals)
        ends = np.stack([y[:-1], y[1:], u[:-1], u[1:], [r.loss_stop for r in records]], axis=1)
        weights = np.array([part.objective[1:4] for part in parts])
        of_starts = np.array(owners or [-1] * len(parts), dtype=np.intp)
        stretches = Stretches(of_y, of_u, ends, np.stack(at), shares, weights, of_starts)
        self._problem = longest._record, stretches, longest.objective, longest._workspace

    def passed(
        self, task: int, points: Array, smoothing: Array, barriers: Array, frames: Array = NO_FRAMES
    ) -> tuple[Array, Array]:
        """One pass over the points, for residuals in the workspace, values, or gradients."""
        state = State(np.ascontiguousarray(points), *_rest(len(points))[1:])
        given = smoothing, barriers, 0.0, 0, 0, 0, frames
        return tuple(passes(self._problem, task, state, *given)[2:])

    def advance(
        self, given: LineSearch, state: State, trials: int, few: int, frames: Array = NO_FRAMES
    ) -> tuple[int, int]:
        """Trials of descents, as :func:`.bfgs.descend_by` asks for them, with given smoothing,
        barriers, tolerance and iterations at most; ``frames`` as of :func:`.gradient.passes`."""
        if not trials:
            state.line["value"], state.g[:] = self.passed(GRADIENTS, state.x, *given[:2], frames)
            return 0, 0
        return tuple(passes(self._problem, GRADIENTS, state, *given, trials, few, frames)[:2])


@lru_cache(maxsize=64)
def _rest(count: int) -> State:
    """The state of a pass that makes no trials, which is only read."""
    line, none = np.zeros(count, LINE), np.empty((0, 0))
    line["active"] = True
    return State(none, none, np.empty((0, 0, 0)), none, line)


class _Regressors:
    """Delayed copies of a signal, filtered from rest through ``numerator / denominators``.
    ``signal[start]`` is the sample of the first residual, ``delay`` that of the first copy."""

    def __init__(
        self,
        signal: Array,
        start: int,
        delay: int,
        copies: int,
        numerator: Array,
        denominators: tuple[Array, ...],
    ) -> None:
        self.signal, self.first, self.copies = signal, start - delay, copies
        self.numerator, self.denominators = numerator, denominators
        self.past = np.zeros((copies, len(numerator) - 1))
        self.states = [np.zeros((copies, len(denominator) - 1)) for denominator in denominators]

    def rows(self, begin: int, end: int) -> Array:
        """Samples ``begin ... end - 1`` of each copy, (copies, M), the ones before being known."""
        shifts = range(self.first, self.first - self.copies, -1)
        raw = np.stack([self.signal[shift + begin : shift + end] for shift in shifts])
        whole, lags = np.concatenate([self.past, raw], axis=1), len(self.numerator) - 1
        filtered = raw.copy()
        for lag, weight in enumerate(self.numerator[1:], start=1):
            filtered += weight * whole[:, lags - lag : whole.shape[1] - lag]
        self.past = whole[:, whole.shape[1] - lags :]
        for denominator, state in zip(self.denominators, self.states, strict=True):
            if state.shape[1]:
                filter_rows(filtered, denominator, state)
        return filtered


def _from_rest(signal: Array, before: int) -> tuple[Array, int]:
    """A signal with zeros before it, and where it begins."""
    return np.concatenate([np.zeros(before), signal]), before
