"""A lower sampling rate, with a linear-phase filter against aliasing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import Recording

PASS_BAND = 0.9
"""Upper edge of the pass band, as a share of the new Nyquist frequency."""
STOP_BAND_DB = 90.0
"""Design attenuation (dB) from the new Nyquist frequency on; 80 dB are promised."""
LARGEST_FACTOR = 10_000
"""Largest numerator or denominator of the ratio of the two rates."""


def resample_recording(recording: Recording, sampling_rate: float, source: str) -> Recording:
    """Bring all channels of a recording to a lower sampling rate.

    They pass the same filter (see `resample_signal`), so their relations, delay included,
    are unchanged below the pass band's edge. An equal rate returns the recording as it is.
    """
    old = recording.sampling_rate
    if not (np.isfinite(sampling_rate) and sampling_rate > 0):
        raise InputError(
            source, f"{sampling_rate} Hz is not a sampling rate", "give a positive number"
        )
    if sampling_rate > old:
        raise InputError(
            source,
            f"{sampling_rate:g} Hz is above the recording's {old:g} Hz and would add an empty band",
            "choose a lower rate or leave the key out",
        )
    ratio = Fraction(sampling_rate / old).limit_denominator(LARGEST_FACTOR)
    if ratio == 1:
        return recording
    if ratio == 0 or abs(float(ratio) * old / sampling_rate - 1.0) > 1e-9:
        raise InputError(
            source,
            f"{sampling_rate!r} Hz and the recording's {old!r} Hz are not in the ratio of whole"
            f" numbers up to {LARGEST_FACTOR}",
            "choose a rate that divides more evenly",
        )
    return replace(
        recording,
        inputs=resample_signal(recording.inputs, ratio),
        outputs=resample_signal(recording.outputs, ratio),
        sampling_rate=float(sampling_rate),
    )


def resample_signal(signal: NDArray[np.float64], ratio: Fraction) -> NDArray[np.float64]:
    """Resample one signal by a rational ratio below one.

    The filter is a Kaiser-windowed linear-phase FIR: pass band to 0.9 of the new Nyquist
    frequency, at least 80 dB down from the new Nyquist frequency on. Sample 0 stays at
    time 0 (the filter's delay is taken out). Beyond its ends the signal is continued by
    odd reflection, which keeps its level and slope; within half the filter's length of
    either end (about 60 new samples) the values rest on that continuation.

    The signal is (N,) or (N, channels), of which ceil(N * ratio) samples are left; `ratio` is the
    new rate over the old one, below 1.
    """
    from scipy.signal import resample_poly

    if signal.ndim == 2:
        resampled = [resample_signal(np.ascontiguousarray(each), ratio) for each in signal.T]
        samples = -(-len(signal) * ratio.numerator // ratio.denominator)
        return np.column_stack([np.empty((samples, 0)), *resampled])
    coefficients = anti_alias_filter(ratio)
    return resample_poly(
        signal,
        ratio.numerator,
        ratio.denominator,
        window=coefficients,
        padtype="antireflect",
    )


def anti_alias_filter(ratio: Fraction) -> NDArray[np.float64]:
    """Kaiser FIR at the intermediate rate (old rate times numerator), unit gain at zero.

    Kaiser, J. F. (1974), "Nonrecursive digital filter design using the I0-sinh window".
    """
    from scipy.signal import firwin, kaiserord

    # The new Nyquist frequency, as a share of the intermediate rate's own.
    nyquist = 1.0 / ratio.denominator
    length, beta = kaiserord(STOP_BAND_DB, (1.0 - PASS_BAND) * nyquist)
    length |= 1  # an odd length has a whole-sample delay, which can be taken out exactly
    return firwin(length, 0.5 * (1.0 + PASS_BAND) * nyquist, window=("kaiser", beta))
