"""Empirical frequency responses from several inputs to several outputs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.signals.recording import Recording

Array = NDArray[np.float64]

# Averaged segments for each input, so that the spectral matrix of the inputs can be inverted.
SEGMENTS_PER_INPUT, LEAST_SEGMENTS = 4, 8


@dataclass(frozen=True, eq=False)
class MultichannelResponse:
    """Empirical responses ``S_yu S_uu^-1`` (Bendat & Piersol 2010, section 7.4)."""

    frequencies: Array  # (m,) hz
    response: NDArray[np.complex128]  # (m, ny, nu) naN where the inputs are linearly dependent
    coherence: Array  # (m, ny) multiple coherence of each output with all inputs, 0 to 1


def multichannel_response(recording: Recording, nfft: int) -> MultichannelResponse:
    """Estimate all responses at once, by averages over half-overlapping Hann segments (Welch 1967).

    A segment is of one recording; those that are shorter than it have none.

    `nfft`: Length of the transforms, an even number; longest segment.
    """
    u, y = recording.inputs, recording.outputs
    segments = max(LEAST_SEGMENTS, SEGMENTS_PER_INPUT * u.shape[1])
    longest = min(nfft, recording.longest.samples)
    length = max(min(longest, 2 * recording.samples // (segments + 1)), 8)
    while recording.is_joined and length > 8 and len(_starts(recording, length)) < segments:
        length = max(length * 7 // 8, 8)
    window = np.hanning(length)[:, None]
    starts = _starts(recording, length)

    def transformed(signals: Array) -> NDArray[np.complex128]:
        parts = [signals[first : first + length] for first in starts]
        centred = [(part - part.mean(axis=0)) * window for part in parts]
        return np.stack([np.fft.rfft(part, nfft, axis=0) for part in centred])

    inputs, outputs = transformed(u), transformed(y)
    s_uu = np.einsum("kfi,kfj->fij", inputs, inputs.conj())
    s_yu = np.einsum("kfi,kfj->fij", outputs, inputs.conj())
    s_yy = np.einsum("kfi,kfi->fi", outputs, outputs.conj()).real
    response = s_yu @ np.linalg.pinv(s_uu, rcond=1e-10, hermitian=True)
    explained = np.einsum("fij,fij->fi", response, s_yu.conj()).real
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.clip(explained / s_yy, 0.0, 1.0)
    frequencies = np.fft.rfftfreq(nfft, 1.0 / recording.sampling_rate).astype(np.float64)
    return MultichannelResponse(frequencies, response, coherence)


def _starts(recording: Recording, length: int) -> list[int]:
    """First samples of half-overlapping segments within the recordings."""
    return [
        first
        for begin, stop in pairwise(recording.bounds)
        for first in range(begin, stop - length + 1, max(length // 2, 1))
    ]
