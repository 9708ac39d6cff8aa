"""A recording as the estimation of state-space models has it: inputs shifted, signals scaled."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from evopem.arrays import Array, Flags, Indices, Integers
from evopem.errors import NoModelError
from evopem.signals.recording import Recording, sample_times


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
