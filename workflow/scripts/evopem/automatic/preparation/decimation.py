"""Decimation: the rate of the samples from which a model is estimated."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.automatic.cross_validation.folds import SHORTEST_BLOCK
from evopem.automatic.cross_validation.simulation import Model, errors_simulated_on
from evopem.automatic.cross_validation.stretches import SHORTEST_STRETCH, folds_of
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import FOLD_STAGES, CommonSettings, fit, fits_in_state_space
from evopem.errors import InputError, NoModelError
from evopem.estimation.delays import likely_delays, longest_delay
from evopem.models.orders import Orders
from evopem.signals.recording import Recording, Segment, total_samples
from evopem.signals.spectra import frequency_response

# Decimation is tried where this share of the output's power lies below 1 / OVERSAMPLED of the
# sampling rate, by factors that leave LEAST_SAMPLES samples.
POWER_SHARE, OVERSAMPLED = 0.999, 8.0
BANDS = 20
# Bands in which the coherence is judged, and the share of lines that exceed its limit by chance.
COHERENCE_BANDS, COHERENT_BY_CHANCE = 40, 0.01
FACTORS = (2, 4, 5, 8, 10, 16, 20)
LEAST_SAMPLES = 200
LEAST_GAIN = 0.05  # of the simulation error: decimation must pay
PROBES, MOST_FACTORS = (2, 4, 6), 3
MOST_DECIMATED = 20_000  # samples of a long record on which factors are compared

CRITERION = "simulation error on held-out samples at the recorded rate, % of the outputs"


def decide_decimation(stretches: Sequence[Segment]) -> tuple[int, Decision]:
    """Decimation by the error of simulations on held-out samples, at the recorded rate.

    Each recording keeps a stretch that is long enough.
    """
    edge = power_edge(stretches)
    below = f"{100 * POWER_SHARE:g} % of the power of each output lie below {edge:.3g}"
    longest = dict.fromkeys((stretch.recording for stretch in stretches), 0)
    for stretch in stretches:
        longest[stretch.recording] = max(longest[stretch.recording], stretch.samples)
    largest = min(
        2.0 / (OVERSAMPLED * max(edge, 1e-9)),
        total_samples(stretches) / LEAST_SAMPLES,
        min(longest.values()) / SHORTEST_STRETCH,
    )
    factors = [factor for factor in FACTORS if factor <= largest]
    coherent = coherence_edge(stretches) if factors and stretches[0].has_input else 0.0
    kept = [factor for factor in factors if factor * coherent <= 0.5][-MOST_FACTORS:]
    if not factors:
        sentence = f"{below} of the sampling rate: the record is not oversampled."
    elif not stretches[0].has_input:
        kept = []
        sentence = "Without an input the rate is kept: modes are not distinguished from noise."
    elif not kept:
        sentence = (
            f"Inputs and outputs are coherent up to {coherent:.3g} of the sampling rate, though"
            f" {below} of it: a lower rate would lose dynamics."
        )
    if not kept:
        return 1, Decision("decimation", "1", (Alternative("1", np.nan),), CRITERION, sentence)
    nk = (0,) * stretches[0].inputs.shape[1]
    alternatives = [Alternative(str(f), _decimated_error(stretches, f, nk)) for f in (1, *kept)]
    best = min(alternative.score for alternative in alternatives)
    within = (a for a in alternatives if a.score <= (1.0 + LEAST_GAIN) * best)
    chosen = next(within, alternatives[0])
    sentence = (
        f"{below} of the sampling rate. A factor of {chosen.name} simulates held-out samples best."
    )
    if chosen is not alternatives[0] and not _is_confirmed(stretches, int(chosen.name)):
        chosen = alternatives[0]
        sentence += " Models with the delays of the inputs do not gain by it: the rate is kept."
    about = Decision("decimation", chosen.name, tuple(alternatives), CRITERION, sentence)
    return int(chosen.name), about


def power_edge(stretches: Sequence[Segment]) -> float:
    """Frequency below which nearly all power of each output lies, as a share of the rate.

    The lowest of ``BANDS`` bands is taken for a floor of white noise, and left out of all.
    """
    longest, edges = max(stretches, key=lambda stretch: stretch.samples), []
    for y in longest.outputs.T:
        power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(len(y)))) ** 2
        floor = min(map(np.mean, np.array_split(power, min(BANDS, len(power)))))
        above = np.cumsum(power - floor)
        reached = np.flatnonzero(above >= POWER_SHARE * above[-1])
        edges.append(float(reached[0] / len(y)) if len(reached) else 0.5)
    return max(edges)


def coherence_edge(stretches: Sequence[Segment]) -> float:
    """Upper end of the highest band where an output is coherent with the inputs, of the rate.

    A band is coherent where more than half of its lines exceed what independent signals exceed in
    1 %.  An output that drifts has nearly all its power far below the frequencies of
    its modes; coherence does not depend on power.  0 where no band is coherent.
    """
    longest = max(stretches, key=lambda stretch: stretch.samples)
    nfft = max(8192, 1 << (longest.samples - 1).bit_length())
    try:
        response = frequency_response(Recording(longest.inputs, longest.outputs, 1.0), nfft=nfft)
    except InputError:
        return 0.0
    above = response.coherence > response.coherence_limit(COHERENT_BY_CHANCE)[:, None]
    bands = np.array_split(above, COHERENCE_BANDS)
    coherent = [number for number, band in enumerate(bands, 1) if band.mean(axis=0).max() > 0.5]
    return 0.5 * max(coherent, default=0) / COHERENCE_BANDS


def _is_confirmed(stretches: Sequence[Segment], factor: int) -> bool:
    """Whether a lower rate gains by models that have the delays of the inputs. A few coefficients
    do not reach behind a long delay, which is shorter at a lower rate."""
    limits = [(0, longest_delay(stretches))] * stretches[0].inputs.shape[1]
    nk = tuple(likely.delay for likely in likely_delays(stretches, limits))
    recorded, lower = (_decimated_error(stretches, f, nk) for f in (1, factor))
    return lower < recorded


def _decimated_error(stretches: Sequence[Segment], factor: int, nk: tuple[int, ...]) -> float:
    """Best error of a few models at a lower rate; what the filter takes is added, in percent."""
    lower = [decimated_stretch(stretch, factor) for stretch in stretches]
    lost = sum(np.sum((s.outputs - smoothed(s.outputs, factor)) ** 2, axis=0) for s in stretches)
    total = sum(
        np.sum((stretch.outputs - stretch.outputs.mean(axis=0)) ** 2, axis=0)
        for stretch in stretches
    )
    least = _least_error(lower, tuple(delay // factor for delay in nk))
    return float(100.0 * np.sqrt(np.mean(least + lost / total)))


def _least_error(stretches: Sequence[Segment], nk: tuple[int, ...]) -> Array:
    """Mean square errors of the best of a few models on held-out halves, relative, (l,)."""
    folds = folds_of(tuple(stretches), 2, 1, SHORTEST_BLOCK)
    held_out = [stretch for fold in folds for stretch in fold.held_out]
    power = np.mean(np.concatenate([y.outputs - y.outputs.mean(axis=0) for y in held_out]) ** 2, 0)
    errors: dict[str, list[Array]] = defaultdict(list)
    for fold in folds:
        for name, model in _probes(fold.training, nk):
            parts = zip(fold.before, fold.held_out, strict=True)
            left = [errors_simulated_on(model, *part) for part in parts]
            errors[name].append(np.mean(np.concatenate(left) ** 2, axis=0) / power)
    means = [np.mean(error, axis=0) for error in errors.values() if len(error) == len(folds)]
    return min(means, key=np.mean, default=np.full(len(power), np.inf))


def _probes(training: Sequence[Segment], nk: tuple[int, ...]) -> Iterator[tuple[str, Model]]:
    """Output-error models, and of one output ARX models, as far as the samples carry them."""
    if training[0].outputs.shape[1] > 1:
        with suppress(NoModelError):  # a stretch may be shorter than the delays
            fits = fits_in_state_space(training, "ss_oe", PROBES, nk, CommonSettings())
            yield from ((str(n), fitted.model) for n, fitted in fits)
        return
    for n in PROBES:
        nb = (n,) * len(nk)
        for orders in (Orders(nb=nb, nf=nb, nk=nk), Orders(na=n, nb=nb, nk=nk)):
            with suppress(NoModelError):
                yield str(orders), fit(training, orders, stages=FOLD_STAGES).model


def decimated_stretch(stretch: Segment, factor: int) -> Segment:
    """All channels of a stretch at a lower rate."""
    inputs, outputs = decimated(stretch.inputs, factor), decimated(stretch.outputs, factor)
    return Segment(inputs, outputs, stretch.recording, stretch.first // factor)


def decimated(signals: Array, factor: int) -> Array:
    """Signals, (N, channels), at a lower rate, by a zero-phase FIR filter."""
    if factor == 1 or signals.shape[1] == 0:
        return signals[::factor]
    mean = signals.mean(axis=0)
    lower: Array = scipy.signal.decimate(
        signals - mean, factor, ftype="fir", zero_phase=True, axis=0
    )
    return lower + mean


def smoothed(signals: Array, factor: int) -> Array:
    """What decimated signals still hold, at the original rate."""
    if factor == 1:
        return signals
    lower = decimated(signals, factor)
    times = np.arange(len(lower)) * factor
    spline: Callable[[Array], Array] = scipy.interpolate.make_interp_spline(times, lower, k=3)
    inside = np.minimum(np.arange(len(signals)), times[-1])
    return np.asarray(spline(inside.astype(float)))
