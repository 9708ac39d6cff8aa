"""The scaled signals that state-space models of any order are fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpaceRecord:
    """Scaled signals of one or more records, one after the other.

    Attributes
    ----------
    inputs : (N, nu) array
        Shifted by their delays, and divided by ``input_scales``.
    outputs : (N, ny) array
        ``(y - output_offsets) / output_scales``: of unit mean square.
    bounds : (records + 1,) integer array
        First sample of each record, and N.
    input_scales : (nu,) array
    output_scales, output_offsets : (ny,) arrays
    feedthrough : (nu,) boolean array
        Whether an input acts on the output of the same sample, so that D has a column for it.
    levels : bool
        Whether each record has a constant of its own.
    drift : (N, k) array
        Slow changes of the outputs of each record beside its constant, which the model does not
        explain.
    """

    inputs: Array
    outputs: Array
    bounds: NDArray[np.int64]
    input_scales: Array
    output_scales: Array
    output_offsets: Array
    feedthrough: NDArray[np.bool_]
    levels: bool
    drift: Array

    @property
    def records(self) -> int:
        """Number of records."""
        return len(self.bounds) - 1

    @property
    def samples(self) -> int:
        """Samples N of all records."""
        return len(self.outputs)

    @property
    def values(self) -> int:
        """Values of all inputs and outputs."""
        return self.inputs.size + self.outputs.size


def state_space_record(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    delays: Sequence[int],
    levels: bool,
    drift_period: float | None = None,
) -> StateSpaceRecord:
    """Shift and scale the signals of records.

    Parameters
    ----------
    inputs, outputs : sequences of (N, nu) and (N, ny) arrays
    delays : sequence of int
        nk of each input.  Inputs with nk > 1 are not known at the first samples, which the
        record then leaves out.
    levels : bool
    drift_period : float, optional
        Shortest period of the drift, in samples; without one there is no drift.
    """
    shifts = [max(delay - 1, 0) for delay in delays]
    lost = max(shifts, default=0)
    shifted = [
        np.column_stack(
            [u[lost - shift : len(u) - shift, k] for k, shift in enumerate(shifts)]
            or [np.empty((len(u), 0))]
        )
        for u in inputs
    ]
    u, y = np.concatenate(shifted), np.concatenate([each[lost:] for each in outputs])
    offsets = y.mean(axis=0) if levels else np.zeros(y.shape[1])
    y_scale = np.sqrt(np.mean((y - offsets) ** 2, axis=0))
    y_scale[y_scale == 0.0] = 1.0
    u_scale = np.sqrt(np.mean(u**2, axis=0))
    u_scale[u_scale == 0.0] = 1.0
    lengths = [len(each) - lost for each in outputs]
    return StateSpaceRecord(
        inputs=np.ascontiguousarray(u / u_scale),
        outputs=np.ascontiguousarray((y - offsets) / y_scale),
        bounds=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        input_scales=u_scale,
        output_scales=y_scale,
        output_offsets=offsets,
        feedthrough=np.array([delay == 0 for delay in delays], dtype=bool),
        levels=levels,
        drift=block_diag(*(_slow_cosines(samples, drift_period) for samples in lengths)),
    )


def _slow_cosines(samples: int, shortest: float | None) -> Array:
    """Cosines over a record of periods down to the shortest, (samples, k); without a mean."""
    count = 0 if shortest is None else round(2 * samples / shortest)
    phase = np.pi * (np.arange(samples) + 0.5) / samples
    return np.cos(phase[:, None] * np.arange(1, count + 1))
