"""The scaled signals of a recording that state-space models of any order are fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from evopem.signals.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScaledRecording:
    """Scaled signals of a recording with m inputs and l outputs.

    Attributes
    ----------
    recording : Recording
        That they are made from, for its rate and names.
    delays : tuple of int
        nk of each input: 0 for one that acts on the output of the same sample, so that D has a
        column for it.
    inputs : (N, m) array
        Shifted by their delays, and divided by ``input_scales``.
    outputs : (N, l) array
        ``(y - output_offsets) / output_scales``: of unit mean square.
    bounds : (segments + 1,) integer array
        First sample of each segment, and N.  Each segment has an initial state of its own.
    level_of : (segments,) integer array
        Level of each segment: those of one recording share theirs.  Empty without levels.
    input_scales : (m,) array
    output_scales, output_offsets : (l,) arrays
    drift : (N, k) array
        Slow changes of the outputs of each segment beside its level, which the model does not
        explain.
    """

    recording: Recording
    delays: tuple[int, ...]
    inputs: Array
    outputs: Array
    bounds: NDArray[np.int64]
    level_of: NDArray[np.intp]
    input_scales: Array
    output_scales: Array
    output_offsets: Array
    drift: Array

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
    def constants(self) -> Array:
        """Regressors of the levels, (N, levels)."""
        if not self.levels:
            return np.empty((self.samples, 0))
        regressors: Array = np.eye(self.levels)[np.repeat(self.level_of, np.diff(self.bounds))]
        return regressors

    @property
    def feedthrough(self) -> NDArray[np.bool_]:
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
    """Shift and scale the signals of a recording.

    Parameters
    ----------
    recording : Recording
    delays : int or sequence of int
        nk of all inputs or of each.  Inputs with nk > 1 are not known at the first samples of a
        segment, which are then left out.
    level : bool
        Whether each recording has a level.
    drift_period : float, optional
        Shortest period of the drift, in samples; without one there is no drift.

    Raises
    ------
    ValueError
        When the delays do not fit the recording, or its signals cannot be used.
    """
    count = recording.inputs.shape[1]
    nk = (delays,) * count if isinstance(delays, int) else tuple(delays)
    if len(nk) != count or any(delay < 0 for delay in nk):
        raise ValueError(f"{count} inputs need {count} delays of at least 0, not {nk}")
    segments = recording.segments
    shortest = min(each.samples for each in segments)
    if shortest <= max(nk, default=0) + 10:
        raise ValueError(f"a segment of {shortest} samples is too short")
    for name, values in recording.signals.items():
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite")
    if not recording.outputs.any(axis=0).all():
        raise ValueError("an output is zero throughout")
    shifts = [max(delay - 1, 0) for delay in nk]
    lost = max(shifts, default=0)
    u = np.concatenate([_shifted(each.inputs, shifts, lost) for each in segments])
    y = np.concatenate([each.outputs[lost:] for each in segments])
    offsets = y.mean(axis=0) if level else np.zeros(y.shape[1])
    y_scale, u_scale = _sizes(y - offsets), _sizes(u)
    lengths = [each.samples - lost for each in segments]
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
        drift=block_diag(*(_slow_cosines(samples, drift_period) for samples in lengths)),
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


def _slow_cosines(samples: int, shortest: float | None) -> Array:
    """Cosines over a segment of periods down to the shortest, (samples, k); without a mean."""
    count = 0 if shortest is None else round(2 * samples / shortest)
    phase = np.pi * (np.arange(samples) + 0.5) / samples
    return np.cos(phase[:, None] * np.arange(1, count + 1))
