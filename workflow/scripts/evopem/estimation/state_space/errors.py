"""The prediction-error problem of state-space models, with the output matrices eliminated.

The one-step predictor of innovations form, ``x+ = (A - K C) x + (B - K D) u + K y``, ``y = C x + D
u + constant + e``, is an output-error model with the inputs u and y: one set of coordinates, the
sections of the predictor (:mod:`.sections`), serves both forms.  C, D and constants are linear, of
the same regressors for all outputs (Zellner 1962), and eliminated by variable projection (Golub &
Pereyra 1973) with the Jacobian of Kaufman (1975).  A derivative is a signal of one section times a
row of C: one Gram matrix of those signals gives the normal equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, qr
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dpotrf, dtrcon, dtrtri, dtrtrs

from evopem.arrays import Array, Flags, Indices, Integers
from evopem.config.settings import OutputWeighting
from evopem.errors import NoModelError
from evopem.estimation.damped_descent import Weighing
from evopem.estimation.state_space.sections import (
    Layout,
    SectionArrays,
    SectionSignals,
    input_matrix,
    inside,
    moved,
    normalised,
    section_states,
    sections_of,
    state_matrix,
)
from evopem.models.state_space import PlainStructure
from evopem.signals.recording import Recording, sample_times

# Singular values of the regressors, their columns scaled to unit length, below this share of the
# largest one are rounding; none can be where the reciprocal condition is above the second for each.
# Above the third their products tell enough for a basis (CholeskyQR, Stathopoulos & Wu 2002).
REGRESSOR_RANK, WELL_CONDITIONED, OF_PRODUCTS = 1e-9, 1e-8, 1e-4
# Added to the variances of the errors, relative to the power of the outputs: errors of less than a
# ten-millionth of an output carry no information, and a determinant would seek them out.
ROUNDING = 1e-14
# A predictor that forgets has e**-3 of its initial state left at the end of the longest segment.
# Waves and drifts of others may be fitted to the noise, and go on behind the samples; a predictor
# that has to forget loses the likelihood of a few parameters at most.
FORGETTING = 3.0
EDGE = 1e-9  # a pole moved to the radius stops just inside it


@dataclass(frozen=True, eq=False)
class ScaledRecording:
    """Scaled signals of a recording with m inputs and l outputs, in segments."""

    recording: Recording  # that they are made from, for its rate and names
    delays: tuple[int, ...]  # nk of each input: with 0 it has a column of D
    inputs: Array  # (N, m), shifted by their delays, over input_scales
    outputs: Array  # (N, l), (y - output_offsets) / output_scales: of unit mean square
    bounds: Integers  # (segments + 1,): first sample of each segment, and N
    level_of: Indices  # (segments,): level of each segment, one for each recording
    input_scales: Array
    output_scales: Array
    output_offsets: Array
    drift: Array  # (N, k): slow changes of the outputs that the model does not explain

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.bounds) - 1

    @property
    def samples(self) -> int:
        """Samples N of all segments."""
        return len(self.outputs)

    @property
    def levels(self) -> int:
        """Number of levels: of recordings, or none."""
        return int(self.level_of.max(initial=-1)) + 1

    @cached_property
    def level_shares(self) -> Array:
        """Share of the samples that have each level, (levels,)."""
        lengths = np.diff(self.bounds)[: len(self.level_of)]
        return np.bincount(self.level_of, lengths, self.levels) / self.samples

    @property
    def absolute_sizes(self) -> Array:
        """Mean absolute values of the scaled outputs, (l,)."""
        sizes = np.mean(np.abs(self.outputs), axis=0)
        return np.where(sizes == 0.0, 1.0, sizes)

    @property
    def constants(self) -> Array:
        """Regressors of the levels, (N, levels)."""
        if not self.levels:
            return np.empty((self.samples, 0))
        regressors: Array = np.eye(self.levels)[np.repeat(self.level_of, np.diff(self.bounds))]
        return regressors

    @property
    def feedthrough(self) -> Flags:
        """Whether each input acts on the output of the same sample, (m,)."""
        return np.array([delay == 0 for delay in self.delays], dtype=bool)

    @property
    def shifts(self) -> tuple[int, ...]:
        """Samples by which each input is shifted."""
        return tuple(max(delay - 1, 0) for delay in self.delays)


def scaled_recording(
    recording: Recording,
    delays: int | Sequence[int] = 1,
    level: bool = True,
    drift_period: float | None = None,
) -> ScaledRecording:
    """Shift and scale the signals of a recording; ValueError when they or the delays do not fit.

    Inputs with nk > 1 are not known at the first samples of a segment, which are left out.
    ``drift_period``: the shortest period of the drift, samples.
    """
    count = recording.inputs.shape[1]
    nk = (delays,) * count if isinstance(delays, int) else tuple(delays)
    if len(nk) != count or any(delay < 0 for delay in nk):
        raise ValueError(f"{count} inputs need {count} delays of at least 0, not {nk}")
    segments = recording.segments
    shortest = min(segment.samples for segment in segments)
    if shortest <= max(nk, default=0) + 10:
        raise NoModelError(f"a segment of {shortest} samples is too short")
    for name, values in recording.signals.items():
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite")
    if not recording.outputs.any(axis=0).all():
        raise NoModelError("an output is zero throughout")
    shifts = [max(delay - 1, 0) for delay in nk]
    lost = max(shifts, default=0)
    u = np.concatenate([_shifted(segment.inputs, shifts, lost) for segment in segments])
    y = np.concatenate([segment.outputs[lost:] for segment in segments])
    offsets = y.mean(axis=0) if level else np.zeros(y.shape[1])
    y_scale, u_scale = _sizes(y - offsets), _sizes(u)
    lengths = [segment.samples - lost for segment in segments]
    numbers = np.unique(recording.segment_recordings, return_inverse=True)[1]
    return ScaledRecording(
        recording=recording,
        delays=nk,
        inputs=np.ascontiguousarray(u / u_scale),
        outputs=np.ascontiguousarray((y - offsets) / y_scale),
        bounds=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        level_of=numbers if level else np.empty(0, dtype=np.intp),
        input_scales=u_scale,
        output_scales=y_scale,
        output_offsets=offsets,
        drift=block_diag(*(_slow_cosines(at, drift_period) for at in sample_times(segments, lost))),
    )


def _shifted(inputs: Array, shifts: Sequence[int], lost: int) -> Array:
    """Inputs of a segment less the first samples of it, each shifted, (N - lost, m)."""
    stop = len(inputs)
    columns = [inputs[lost - shift : stop - shift, k] for k, shift in enumerate(shifts)]
    return np.column_stack(columns) if columns else np.empty((stop - lost, 0))


def _sizes(signals: Array) -> Array:
    """Root mean squares of signals, 1 for one of zeros."""
    sizes = np.sqrt(np.mean(signals**2, axis=0))
    return np.where(sizes > 0.0, sizes, 1.0)


def _slow_cosines(times: Array, shortest: float | None) -> Array:
    """Cosines over a recording of periods down to the shortest, (samples, k); without a mean."""
    span = times[-1] - times[0] + 1.0
    count = 0 if shortest is None else round(2 * span / shortest)
    phase = np.pi * (times - times[0] + 0.5) / span
    cosines: Array = np.cos(phase[:, None] * np.arange(1, count + 1))
    return cosines - cosines.mean(axis=0) if span > len(times) else cosines


@dataclass(frozen=True, eq=False)
class Projection:
    """Errors of a point with the best output matrices."""

    point: Array
    sections: SectionArrays
    states: Array  # (N, n)
    regressors: Array  # (N, q): states, inputs with feedthrough, constants of levels, and drift
    basis: Array  # (N, rank): orthonormal, of the regressors
    linear: Array  # (q, ny): least-squares C, D, constants and drift, transposed
    errors: Array  # (N, ny)

    @cached_property
    def covariance(self) -> Array:
        """``errors' errors / N``, (ny, ny)."""
        return np.asarray(self.errors.T @ self.errors / len(self.errors))


@dataclass(frozen=True, eq=False)
class StateSpaceErrors:
    """Criterion, normal equations and feasibility of models of one order on a recording.

    The criterion is the logarithm of the determinant of the errors' covariance (``determinant``),
    the sum of the logarithms of their variances (``noise``), or of the relative variances
    (``power``).
    """

    data: ScaledRecording
    order: int
    structure: PlainStructure
    weighting: OutputWeighting = "determinant"
    radius: float = 0.9999
    forgets: bool = False  # whether a predictor of innovations form forgets its initial state

    @property
    def innovations(self) -> bool:
        """Whether there is a K."""
        return self.structure == "ss"

    @property
    def layout(self) -> Layout:
        """Of a point."""
        return self.signals.layout

    @cached_property
    def signals(self) -> SectionSignals:
        """The signals that drive the states, and a pulse for each segment."""
        outputs = [self.data.outputs] if self.innovations else []
        driving = np.column_stack([self.data.inputs, *outputs])
        layout = Layout(self.order, driving.shape[1] + self.data.segments)
        return SectionSignals(layout, driving, self.data.bounds)

    @cached_property
    def direct(self) -> tuple[Array, ...]:
        """Regressors beside the states."""
        return self.data.inputs[:, self.data.feedthrough], self.data.constants, self.data.drift

    @property
    def section_radius(self) -> float:
        """The largest radius of the sections, poles of the predictor."""
        if not (self.forgets and self.innovations):
            return self.radius
        return min(self.radius, float(np.exp(-FORGETTING / np.diff(self.data.bounds).max())))

    @property
    def level_columns(self) -> slice:
        """Where levels stand among the regressors, behind the states and inputs at once."""
        first = self.order + int(self.data.feedthrough.sum())
        return slice(first, first + self.data.levels)

    @property
    def weighing(self) -> Weighing:
        """The weighting of absolute errors: outputs by their power, or by their noise."""
        return "power" if self.weighting == "power" else "noise"

    @property
    def parameters(self) -> int:
        """Independent parameters: coefficients, level and drift, without initial states."""
        ny, n = self.data.outputs.shape[1], self.order
        nu = self.data.inputs.shape[1]
        count = n * (nu + ny) + ny * int(self.data.feedthrough.sum())
        count += n * ny if self.innovations else 0
        return count + ny * (int(self.data.levels > 0) + self.data.drift.shape[1])

    @property
    def estimated(self) -> int:
        """Parameters and initial states."""
        return self.parameters + self.order * self.data.segments

    @property
    def cost(self) -> float:
        """Multiplications of one set of normal equations."""
        signals = 2 * self.layout.sections * self.layout.drives + 2 * self.order
        return float(self.data.samples) * signals**2

    def projection(self, point: Array) -> Projection:
        """Errors with the best C, D and constants."""
        sections, states, regressors = self._regression(point)
        gram, y = regressors.T @ regressors, self.data.outputs
        sizes = np.sqrt(np.diag(gram))
        sizes[sizes == 0.0] = 1.0
        triangle, failed = dpotrf(gram / np.outer(sizes, sizes))
        if not failed and dtrcon(triangle)[0] > OF_PRODUCTS:
            basis = regressors @ (dtrtri(triangle)[0] / sizes[:, None])
        else:
            basis, triangle = qr(regressors / sizes, mode="economic", check_finite=False)
        if dtrcon(triangle)[0] > WELL_CONDITIONED * len(sizes):
            along = basis.T @ y
            along += basis.T @ (y - basis @ along)  # of products the basis is orthogonal to 1e-8
            linear = dtrtrs(triangle, along)[0]
        else:
            left, singular, right = np.linalg.svd(triangle)
            kept = singular > REGRESSOR_RANK * singular[0]
            basis = basis @ left[:, kept]
            along = basis.T @ y
            linear = (right[kept].T / singular[kept]) @ along
        linear = linear / sizes[:, None]
        errors = y - basis @ along
        return Projection(point, sections, states, regressors, basis, linear, errors)

    def with_linear(self, point: Array, linear: Array) -> Projection:
        """Errors with given C, D and constants, (q, ny) as those of a projection; no basis."""
        sections, states, regressors = self._regression(point)
        errors, no_basis = self.data.outputs - regressors @ linear, np.empty((len(states), 0))
        return Projection(point, sections, states, regressors, no_basis, linear, errors)

    def _regression(self, point: Array) -> tuple[SectionArrays, Array, Array]:
        """Sections of a point, the states, and all regressors."""
        sections = sections_of(self.layout, point)
        drives = input_matrix(sections, self.layout)
        inputs = self.signals.of_drives @ drives[:, : self.signals.driving].T
        initial = np.ascontiguousarray(drives[:, self.signals.driving :].T)
        poles = sections.sigma, sections.coupling, sections.back
        states = section_states(*poles, initial, inputs, self.data.bounds)
        return sections, states, np.column_stack([states, *self.direct])

    def jacobian(self, solved: Projection, signals: Array, output: int) -> tuple[Array, Indices]:
        """Derivatives of what is predicted of an output, from those signals of the sections.

        By the coordinates and by its own linear coefficients, and where these stand among the
        coordinates and all coefficients, output by output.
        """
        q, c = solved.regressors.shape[1], solved.linear[: self.order, output]
        by_coordinates = self.signals.of_output(solved.sections, signals, c)
        output_columns = self.layout.dimension + output * q + np.arange(q)
        columns = np.column_stack([by_coordinates, solved.regressors])
        return columns, np.concatenate([np.arange(self.layout.dimension), output_columns])

    def criterion(self, covariance: Array) -> float:
        """Criterion of the errors' covariance, (ny, ny); its unit is one for each output."""
        if not np.isfinite(covariance).all():
            return float("inf")
        floor = ROUNDING * np.eye(len(covariance))
        if self.weighting == "determinant":
            return float(np.linalg.slogdet(covariance + floor)[1])
        if self.weighting == "noise":
            return float(np.sum(np.log(np.diag(covariance + floor))))
        return float(np.trace(covariance))

    def percent(self, criterion: float) -> float:
        """A criterion as a percentage of the power of the outputs, y less its mean with a level.

        The geometric mean over outputs or principal directions; for ``power`` the arithmetic one.
        """
        mean = criterion / self.data.outputs.shape[1]
        return 100.0 * (mean if self.weighting == "power" else float(np.exp(mean)))

    def stable(self, projection: Projection) -> bool:
        """Whether the eigenvalues of A lie within the radius; those of A - K C do."""
        if not self.innovations:
            return True
        if not np.isfinite(projection.linear).all():
            return False
        drives = input_matrix(projection.sections, self.layout)
        gain = drives[:, self.data.inputs.shape[1] : self.signals.driving]
        predictor = state_matrix(projection.sections, self.layout)
        A = predictor + gain @ projection.linear[: self.order].T
        return bool(np.abs(np.linalg.eigvals(A)).max() <= self.radius)

    def weights(self, covariance: Array) -> Array:
        """Derivative of the criterion by the covariance: weights of the outputs, (ny, ny)."""
        floor = ROUNDING * np.eye(len(covariance))
        if self.weighting == "determinant":
            weights = np.linalg.inv(covariance + floor)
            return np.asarray(0.5 * (weights + weights.T), dtype=float)
        if self.weighting == "noise":
            return np.diag(1.0 / np.diag(covariance + floor))
        return np.eye(len(covariance))

    def begun(self, start: Array) -> Array:
        """A start whose poles lie within the radius, in its normal form."""
        return normalised(
            self.layout, inside(self.layout, start, self.section_radius * (1.0 - EDGE))
        )

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, its poles within the radius."""
        after = moved(self.layout, point, step)
        return inside(self.layout, after, self.section_radius * (1.0 - EDGE))

    def normal_equations(self, projection: Projection) -> tuple[Array, Array]:
        """Gradient and Gauss-Newton Hessian of the criterion, s of each section held."""
        signals = self.signals.derivatives(projection.sections, projection.states)
        along = projection.basis.T @ signals
        # Less their part in the space of the regressors, without another array of this size.
        against = signals.T @ projection.errors
        signals = dgemm(-1.0, along.T, projection.basis.T, 1.0, signals.T, overwrite_c=True).T
        c = projection.linear[: self.order].T
        weights = self.weights(projection.covariance)
        per_sample = 2.0 / self.data.samples
        hessian = per_sample * self.signals.contracted(
            projection.sections, signals.T @ signals, c.T @ weights @ c
        )
        gradient = self.signals.summed(projection.sections, -against @ (weights @ c))
        return per_sample * gradient, hessian
