"""Decimation: the rate of the samples from which a model is estimated."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, lowest
from evopem.automatic.fit import FOLD_STAGES, FitSettings, fit
from evopem.automatic.folds import SHORTEST_BLOCK
from evopem.automatic.simulation import simulated
from evopem.automatic.stretches import folds_of
from evopem.errors import InputError
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples
from evopem.signals.spectral.frequency_response import multitaper_frequency_response

Array = NDArray[np.float64]

# Decimation is tried where this share of the output's power lies below 1 / OVERSAMPLED of the
# sampling rate, by factors that leave LEAST_SAMPLES samples.
POWER_SHARE, OVERSAMPLED = 0.999, 8.0
BANDS = 20
# Bands in which the coherence is judged, and the share of lines that exceed its limit by chance.
COHERENCE_BANDS, COHERENT_BY_CHANCE = 40, 0.01
FACTORS = (2, 4, 5, 8, 10, 16, 20)
LEAST_SAMPLES = 200
# Decimation must pay: relative gain of the simulation error.
LEAST_GAIN = 0.05
PROBES, MOST_FACTORS = (2, 4, 6), 3
# Samples of a long record on which factors are compared.
MOST_DECIMATED = 20_000


def decide_decimation(stretches: Sequence[Segment]) -> tuple[int, Decision]:
    """Decimation by the error of simulations on held-out samples, at the recorded rate."""
    criterion = "simulation error on held-out samples at the recorded rate, % of the output"
    edge = power_edge(stretches)
    samples = total_samples(stretches)
    largest = 1.0 / (OVERSAMPLED / 2.0 * max(edge, 1e-9))
    factors = [f for f in FACTORS if f <= largest and samples / f >= LEAST_SAMPLES]
    coherent = coherence_edge(stretches) if factors else 0.0
    if factors and factors[0] * coherent > 0.5:
        sentence = (
            f"Input and output are coherent up to {coherent:.3g} of the sampling rate, though "
            f"{100 * POWER_SHARE:g} % of the output's power lie below {edge:.3g} of it: a lower "
            "rate would lose dynamics."
        )
        return not_decimated(sentence, criterion)
    factors = [f for f in factors if f * coherent <= 0.5][-MOST_FACTORS:]
    if not factors:
        sentence = (
            f"{100 * POWER_SHARE:g} % of the output's power reach up to {edge:.3g} of the sampling "
            "rate: the record is not oversampled."
        )
        return not_decimated(sentence, criterion)
    alternatives = [Alternative(str(f), _decimated_error(stretches, f)) for f in (1, *factors)]
    found = (
        f"{100 * POWER_SHARE:g} % of the output's power lie below {edge:.3g} of the sampling rate."
    )
    return best_factor(alternatives, found, criterion)


def not_decimated(sentence: str, criterion: str) -> tuple[int, Decision]:
    """No decimation, without a comparison."""
    return 1, Decision("decimation", "1", (Alternative("1", np.nan),), criterion, sentence)


def best_factor(
    alternatives: Sequence[Alternative], found: str, criterion: str
) -> tuple[int, Decision]:
    """The factor of the lowest error, where it pays.

    Parameters
    ----------
    alternatives : sequence of Alternative
        Factors with their errors, 1 the first.
    found : str
        Why the record may be decimated.
    criterion : str
    """
    chosen = lowest(alternatives, LEAST_GAIN)
    sentence = f"{found} A factor of {chosen.name} simulates held-out samples best."
    return int(chosen.name), Decision(
        "decimation", chosen.name, tuple(alternatives), criterion, sentence
    )


def power_edge(stretches: Sequence[Segment]) -> float:
    """Frequency below which nearly all power of the output lies, as a share of the rate.

    The lowest of ``BANDS`` bands is taken for a floor of white noise, and left out of all.
    """
    longest = max(stretches, key=lambda each: each.samples)
    y = longest.output - longest.output.mean()
    power = np.abs(np.fft.rfft(y * np.hanning(len(y)))) ** 2
    bands = np.array_split(power, min(BANDS, len(power)))
    floor = min(float(np.mean(band)) for band in bands)
    above = np.cumsum(power - floor)
    reached = np.flatnonzero(above >= POWER_SHARE * above[-1])
    return float(reached[0] / len(y)) if len(reached) else 0.5


def coherence_edge(stretches: Sequence[Segment]) -> float:
    """Upper end of the highest band where input and output are coherent, as a share of the rate.

    A band is coherent where more than half of its lines exceed what independent signals exceed in
    1 %.  An output that drifts has nearly all its power far below the frequencies of
    its modes; coherence does not depend on power.  0 where no band is coherent.
    """
    longest = max(stretches, key=lambda each: each.samples)
    try:
        found = multitaper_frequency_response(
            longest.input - longest.input.mean(),
            longest.output - longest.output.mean(),
            1.0,
            nfft=max(8192, 1 << (longest.samples - 1).bit_length()),
        )
    except InputError:
        return 0.0
    above = found.coherence > found.coherence_limit(COHERENT_BY_CHANCE)
    bands = np.array_split(above, COHERENCE_BANDS)
    coherent = [number for number, band in enumerate(bands, 1) if np.mean(band) > 0.5]
    return 0.5 * max(coherent, default=0) / COHERENCE_BANDS


def _decimated_error(stretches: Sequence[Segment], factor: int) -> float:
    """Best error of a few output-error and ARX models at a lower rate; what is lost is added."""
    lower = [
        Segment(decimated(s.input, factor), decimated(s.output, factor), s.recording)
        for s in stretches
    ]
    lost = sum(float(np.sum((s.output - smoothed(s.output, factor)) ** 2)) for s in stretches)
    total = sum(float(np.sum((s.output - s.output.mean()) ** 2)) for s in stretches)
    settings = FitSettings()
    best = np.inf
    for n in PROBES:
        for orders in (Orders(nb=n, nf=n, nk=0), Orders(na=n, nb=n, nk=0)):
            squares, reference = 0.0, 0.0
            for fold in folds_of(lower, 2, 1, SHORTEST_BLOCK):
                try:
                    model = fit(fold.training, orders, settings, stages=FOLD_STAGES).model
                except (ValueError, np.linalg.LinAlgError):
                    squares = np.inf
                    break
                for held in fold.held_out:
                    squares += float(np.sum((simulated(model, held) - held.output) ** 2))
                    reference += float(np.sum((held.output - held.output.mean()) ** 2))
            if np.isfinite(squares) and reference > 0.0:
                best = min(best, squares / reference)
    return float(100.0 * np.sqrt(best + lost / total))


def decimated(signal: Array, factor: int) -> Array:
    """A signal at a lower rate, by a zero-phase FIR filter; (ceil(N / factor),)."""
    from scipy.signal import decimate

    if factor == 1:
        return signal
    mean = float(np.mean(signal))
    lower: Array = decimate(signal - mean, factor, ftype="fir", zero_phase=True)
    return lower + mean


def smoothed(signal: Array, factor: int) -> Array:
    """What a decimated signal still holds, at the original rate."""
    if factor == 1:
        return signal
    from scipy.interpolate import make_interp_spline

    lower = decimated(signal, factor)
    times = np.arange(len(lower)) * factor
    spline: Callable[[Array], Array] = make_interp_spline(times, lower, k=3)
    inside = np.minimum(np.arange(len(signal)), times[-1])
    return np.asarray(spline(inside.astype(float)))
