"""How well inputs excite a model, and whether both parts of a split have power alike."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array, Flags
from evopem.config.structures import REGULARISED
from evopem.models.orders import Orders
from evopem.signals.spectra import multitaper_spectrum

# An eigenvalue of the input's covariance this far below the largest counts as not excited:
# there the input is 40 dB weaker than where it is strongest.
EXCITED = 1e-4
# Where the relative power density of one part is this many times that of the other, the other has
# none: 20 dB.  By chance, with 14 degrees of freedom each, one frequency in 10^9 shows that.
NO_POWER = 100.0
# Share of the validation input's power outside the estimation input's bands from which on the
# validation is not comparable.
LARGEST_SHARE = 0.05
TIME_HALFBANDWIDTH = 4.0
# Shortest part whose spectrum is estimated, and longest segment.
FEWEST_SAMPLES = 64
LONGEST_SEGMENT = 8192


def excitation_order(inputs: ArrayLike, largest: int) -> int:
    """Number of directions of the past of an input, (N,), that it excites, out of ``largest``.

    Eigenvalues of its covariance above 10⁻⁴ of the biggest: persistent excitation of that order in
    practice (Ljung 1999, chapter 13).
    """
    u = np.asarray(inputs, dtype=float)
    if u.size < largest or largest < 1 or np.ptp(u) == 0:
        return 0
    u = u - u.mean()
    # Whole windows only: zeros before the record would look like excitation.
    past = np.lib.stride_tricks.sliding_window_view(u, largest)
    eigenvalues = np.linalg.eigvalsh(past.T @ past)
    return int(np.count_nonzero(eigenvalues > EXCITED * eigenvalues[-1]))


@dataclass(frozen=True)
class SplitSpectra:
    """How far the validation input has power where the estimation input has none."""

    # Share of the validation input's power in bands without power in the estimation input, 0 to 1;
    # NaN where a part is too short or constant
    share_outside: float
    # Share of the estimation input's power in bands without power in the validation input
    share_untested: float
    # The bands of ``share_outside``, with at least a hundredth of the power each
    bands_hz: tuple[tuple[float, float], ...]
    resolution_hz: float  # of both spectra
    # Whether ``share_outside`` is at most :data:`LARGEST_SHARE`; None where it is not known
    comparable: bool | None


def needed_excitation(orders: Orders) -> list[int]:
    """The order of excitation that the plant of each input asks for.

    The coefficients of a regularised response have a prior beside what the input excites: 0.
    """
    if orders.structure in REGULARISED:
        return [0] * orders.inputs
    return [orders.na + nf + nb for nf, nb in zip(orders.nf, orders.nb, strict=True)]


def split_spectra(
    estimation: ArrayLike, validation: ArrayLike, sampling_rate: float
) -> SplitSpectra:
    """Compare the input's multitaper spectra in the estimation and the validation part.

    Averages over segments as long as the shorter part, scaled to unit power.
    """
    parts = [np.asarray(part, dtype=float) for part in (estimation, validation)]
    length = min(LONGEST_SEGMENT, *(part.size for part in parts))
    if length < FEWEST_SAMPLES or any(not np.ptp(part) > 0.0 for part in parts):
        return SplitSpectra(math.nan, math.nan, (), math.nan, None)
    first, second = (_relative_density(part, length) for part in parts)
    frequencies = np.asarray(np.fft.rfftfreq(length, 1.0 / sampling_rate), np.float64)
    outside = second > NO_POWER * first
    share = float(second[outside].sum())
    return SplitSpectra(
        share_outside=share,
        share_untested=float(first[first > NO_POWER * second].sum()),
        bands_hz=_bands(frequencies, outside, second),
        resolution_hz=2.0 * TIME_HALFBANDWIDTH * sampling_rate / length,
        comparable=share <= LARGEST_SHARE,
    )


def _relative_density(signal: Array, length: int) -> Array:
    """Mean multitaper density of segments of one length, which may overlap, scaled to sum 1."""
    count = -(-signal.size // length)
    starts = np.linspace(0, signal.size - length, count).round().astype(int)
    density = np.zeros(length // 2 + 1)
    for start in starts:
        segment = signal[start : start + length]
        if np.ptp(segment) > 0.0:
            density += multitaper_spectrum(segment, 1.0, TIME_HALFBANDWIDTH, length).density
    return density / density.sum()


def _bands(frequencies: Array, inside: Flags, power: Array) -> tuple[tuple[float, float], ...]:
    """Ranges of neighbouring frequencies with at least a hundredth of the power."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    return tuple(
        (float(frequencies[begin]), float(frequencies[end - 1]))
        for begin, end in edges.reshape(-1, 2)
        if power[begin:end].sum() >= 0.01
    )
