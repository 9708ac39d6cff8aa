"""Preparation of recordings, decided: start, gaps, decimation, objective."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, given_by_configuration, lowest
from evopem.automatic.drift import decide_differences, differenced
from evopem.automatic.fit import FOLD_STAGES, FitSettings, fit, log_loss
from evopem.automatic.folds import SHORTEST_BLOCK
from evopem.automatic.orders import MOST_SAMPLES
from evopem.automatic.simulation import simulated
from evopem.automatic.stretches import first_samples, folds_of
from evopem.automatic.transforms import TransformPlan
from evopem.errors import InputError
from evopem.estimation.criteria import power_of_two_scale
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import PolynomialOrders
from evopem.signals.recording import MAX_DESIGNED_LEVELS, Recording
from evopem.signals.spectral.frequency_response import multitaper_frequency_response
from evopem.signals.stretches import Stretch, total_samples

Array = NDArray[np.float64]

# A stretch shorter than this is of no use.
SHORTEST_STRETCH = 20
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
# Samples that are kept of a rest before the first change: they tell the level of the rest.
KEPT_REST = 10
# Samples at a limit of the output, against those at the levels beside it.
CLIPPED_RATIO, CLIPPED_RUN, MOST_CLIPPED = 10.0, 5, 0.3
# Equal samples in sequence that stand still, the largest share of them, and the largest share of
# other samples that repeat the one before in a record where standing still means something.
STUCK_RUN, MOST_STUCK, REPEATED = 15, 0.5, 0.01
# Orders of the ARX models whose residuals decide between the objectives, as far as there are
# SAMPLES_PER_ORDER samples for each, and how much likelier Laplace's distribution must be than the
# normal one for the absolute objective, as a logarithm.
OBJECTIVE_ORDERS, SAMPLES_PER_ORDER = (2, 4, 8, 12, 16), 25
LEAST_EVIDENCE = 3.0


@dataclass(frozen=True)
class GivenPreparation:
    """What a configuration decides of the preparation; None is left to the recording.

    Attributes
    ----------
    start : int, optional
        First sample kept of each recording.
    factor : int, optional
        Decimation factor.
    differences : int, optional
        Further differences of both channels.
    objective : {"absolute", "quadratic"}, optional
    box_cox : bool
        Whether the configuration says what is done.
    """

    start: int | None = None
    factor: int | None = None
    differences: int | None = None
    objective: str | None = None
    box_cox: bool = False


@dataclass(frozen=True)
class PreparationPlan:
    """What is done to recordings, before anything is estimated.

    Attributes
    ----------
    starts : tuple of int
        First sample kept of each recording.
    factor : int
        Decimation factor.
    clipped : tuple of float
        Limits of the output, whose samples are breaks: lowest and highest, infinite for none.
    objective : {"absolute", "quadratic"}
    input_offset, output_offset : float
        Means of the estimation samples, after differences, taken from all samples.
    input_scale, output_scale : float
        Powers of two by which the samples are divided.
    decisions : tuple of Decision
    stuck : bool
        Whether stretches in which the output stands still are breaks.
    transforms : TransformPlan
        What is done to the recordings before everything else.
    differences : int
        How often both channels are differenced, after decimation.
    """

    starts: tuple[int, ...]
    factor: int
    clipped: tuple[float, float]
    objective: str
    input_offset: float
    output_offset: float
    input_scale: float
    output_scale: float
    decisions: tuple[Decision, ...]
    stuck: bool = False
    transforms: TransformPlan = field(default_factory=TransformPlan)
    differences: int = 0

    def __post_init__(self) -> None:
        # JSON has no infinity: no limit comes back as NaN.
        low, high = self.clipped
        limits = (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)
        object.__setattr__(self, "clipped", limits)


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """Stretches ready for estimation, and how they came about.

    Attributes
    ----------
    stretches : tuple of Stretch
    sampling_rate : float
        Hz, after decimation.
    plan : PreparationPlan
    """

    stretches: tuple[Stretch, ...]
    sampling_rate: float
    plan: PreparationPlan

    @property
    def settings(self) -> FitSettings:
        """What all fits have in common."""
        return FitSettings(self.plan.objective)

    def in_its_units(self, model: PolynomialModel) -> PolynomialModel:
        """A model of the scaled stretches in the units of the recording, less the offsets."""
        return replace(
            model,
            b=model.b * (self.plan.output_scale / self.plan.input_scale),
            level=model.level * self.plan.output_scale,
            noise_variance=model.noise_variance * self.plan.output_scale**2,
            sampling_rate=self.sampling_rate,
        )


def decide_preparation(
    recordings: Sequence[Recording],
    given: GivenPreparation = GivenPreparation(),
) -> PreparationPlan:
    """Decide how recordings of one system are prepared.

    Parameters
    ----------
    recordings : sequence of Recording
        Samples that are not finite are breaks.
    given : GivenPreparation
        What is not decided here.

    Raises
    ------
    InputError
        When no stretch without breaks is long enough, or the sampling rates differ.
    """
    rates = {each.sampling_rate for each in recordings}
    if len(rates) != 1:
        raise InputError(
            "recordings",
            f"their sampling rates differ: {', '.join(f'{rate:g} Hz' for rate in sorted(rates))}",
            "give recordings of one rate",
        )
    if given.start is None:
        starts, about_start = _decide_starts(recordings)
    else:
        starts = (given.start,) * len(recordings)
        about_start = given_by_configuration("start", str(given.start))
    clipped, about_clipping = _decide_clipping(recordings, starts)
    stuck, about_stuck = _decide_stuck(recordings, starts)
    plan = PreparationPlan(starts, 1, clipped, "quadratic", 0.0, 0.0, 1.0, 1.0, (), stuck)
    stretches = _raw_stretches(recordings, plan)
    if not stretches:
        raise InputError(
            "recordings",
            f"no stretch has {SHORTEST_STRETCH} samples without a gap",
            "give a longer recording, or one with fewer missing samples",
        )
    u = np.concatenate([each.input for each in stretches])
    y = np.concatenate([each.output for each in stretches])
    for name, signal in (("input", u), ("output", y)):
        if np.ptp(signal) == 0.0:
            raise InputError(
                name,
                f"every sample is {signal[0]:g}, so there is nothing to identify",
                "choose a channel that varies",
            )
    plan = replace(
        plan,
        input_offset=float(u.mean()),
        output_offset=float(y.mean()),
        input_scale=power_of_two_scale(u - u.mean()),
        output_scale=power_of_two_scale(y - y.mean()),
    )
    if given.factor is None:
        stretches = list(first_samples(prepare(recordings, plan).stretches, MOST_DECIMATED))
        factor, about_factor = _decide_decimation(stretches)
    else:
        factor, about_factor = given.factor, given_by_configuration("decimation", str(given.factor))
    plan = replace(plan, factor=factor)
    if given.differences is None:
        stretches = list(first_samples(prepare(recordings, plan).stretches, MOST_DECIMATED))
        differences, about_differences = decide_differences(stretches)
    else:
        differences = given.differences
        about_differences = given_by_configuration("differences", str(differences))
    if differences:
        plan = _centred(recordings, replace(plan, differences=differences))
    if given.objective is None:
        stretches = list(first_samples(prepare(recordings, plan).stretches, MOST_SAMPLES))
        objective, about_objective = _decide_objective(stretches)
    else:
        objective = given.objective
        about_objective = given_by_configuration("objective", objective)
    decisions = (
        *(about_start, about_clipping, about_factor, about_differences),
        *(about_objective, about_stuck),
    )
    return replace(plan, objective=objective, decisions=decisions)


def stretches_as_recorded(
    recordings: Sequence[Recording], start: int | None
) -> tuple[list[Stretch], list[int]]:
    """The stretches of recordings before any decision on their rate, and where each begins.

    Parameters
    ----------
    recordings : sequence of Recording
    start : int, optional
        First sample kept, where it is given.

    Raises
    ------
    InputError
        When no stretch without breaks is long enough.
    """
    plan = decide_preparation(recordings, GivenPreparation(start, 1, 0, "quadratic"))
    begins = [
        begin
        for recording, first in zip(recordings, plan.starts, strict=True)
        for begin, _ in kept_ranges(recording, first, plan)
    ]
    return _raw_stretches(recordings, plan), begins


def _centred(recordings: Sequence[Recording], plan: PreparationPlan) -> PreparationPlan:
    """A plan with the means and scales of the signals that it prepares."""
    unchanged = replace(
        plan, input_offset=0.0, output_offset=0.0, input_scale=1.0, output_scale=1.0
    )
    stretches = prepare(recordings, unchanged).stretches
    u = np.concatenate([each.input for each in stretches])
    y = np.concatenate([each.output for each in stretches])
    return replace(
        plan,
        input_offset=float(u.mean()),
        output_offset=float(y.mean()),
        input_scale=power_of_two_scale(u - u.mean()),
        output_scale=power_of_two_scale(y - y.mean()),
    )


def prepare(recordings: Sequence[Recording], plan: PreparationPlan) -> PreparedRecord:
    """Apply a plan to the recordings that it was made for.

    Parameters
    ----------
    recordings : sequence of Recording
    plan : PreparationPlan
    """
    return PreparedRecord(
        tuple(_scaled(each, plan) for each in _raw_stretches(recordings, plan)),
        recordings[0].sampling_rate / plan.factor,
        plan,
    )


def prepare_validation(recording: Recording, plan: PreparationPlan) -> tuple[Stretch, ...]:
    """Apply a plan to another recording, whose first samples are kept.

    Parameters
    ----------
    recording : Recording
    plan : PreparationPlan
    """
    others = replace(plan, starts=(0,), clipped=(-np.inf, np.inf), stuck=False)
    return prepare((recording,), others).stretches


def undifferenced(plan: PreparationPlan) -> PreparationPlan:
    """The same preparation without its differences, and without means."""
    return replace(plan, differences=0, input_offset=0.0, output_offset=0.0)


def decimated(signal: Array, factor: int) -> Array:
    """A signal at a lower rate, by a zero-phase FIR filter; (ceil(N / factor),)."""
    from scipy.signal import decimate

    if factor == 1:
        return signal
    mean = float(np.mean(signal))
    lower: Array = decimate(signal - mean, factor, ftype="fir", zero_phase=True)
    return lower + mean


def _scaled(stretch: Stretch, plan: PreparationPlan) -> Stretch:
    lower = Stretch(
        decimated(stretch.input, plan.factor),
        decimated(stretch.output, plan.factor),
        stretch.recording,
    )
    lower = differenced(lower, plan.differences)
    return Stretch(
        (lower.input - plan.input_offset) / plan.input_scale,
        (lower.output - plan.output_offset) / plan.output_scale,
        stretch.recording,
    )


def _raw_stretches(recordings: Sequence[Recording], plan: PreparationPlan) -> list[Stretch]:
    """Samples between breaks, in recorded units and at the recorded rate."""
    found = []
    for number, (recording, start) in enumerate(zip(recordings, plan.starts, strict=True)):
        for begin, end in kept_ranges(recording, start, plan):
            kept = slice(begin, end)
            found.append(Stretch(recording.input[kept], recording.output[kept], number))
    return found


def kept_ranges(recording: Recording, start: int, plan: PreparationPlan) -> list[tuple[int, int]]:
    """First sample of each stretch that is long enough and the one after its last.

    At the recorded rate.

    Parameters
    ----------
    recording : Recording
    start : int
        First sample kept.
    plan : PreparationPlan
    """
    u, y = recording.input, recording.output
    low, high = plan.clipped
    good = np.isfinite(u) & np.isfinite(y)
    good[good] &= (y[good] > low) & (y[good] < high)
    good[:start] = False
    if plan.stuck:
        good &= ~_standing_still(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    least = SHORTEST_STRETCH * plan.factor
    ranges = [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
    return [(begin, end) for begin, end in ranges if end - begin >= least]


def _decide_starts(recordings: Sequence[Recording]) -> tuple[tuple[int, ...], Decision]:
    """Leave out leading samples in which neither signal has begun to change."""
    starts = []
    for each in recordings:
        u, y = each.input, each.output
        still = (u == u[0]) & (y == y[0])
        still |= ~(np.isfinite(u) & np.isfinite(y))
        leading = int(np.argmin(still)) if not still.all() else 0
        kept = max(leading - KEPT_REST, 0)
        starts.append(kept if np.isfinite(y[kept:leading]).all() else leading)
    alternatives = (
        Alternative("0", 0.0),
        *(Alternative(str(start), float(start)) for start in sorted(set(starts)) if start),
    )
    sentence = (
        "Samples before the first change of either signal are left out."
        if any(starts)
        else "The record begins with its first sample; the transient belongs to the estimated "
        "initial state."
    )
    choice = ", ".join(map(str, starts))
    return tuple(starts), Decision(
        "start", choice, alternatives, "leading samples without any change", sentence
    )


def _decide_clipping(
    recordings: Sequence[Recording], starts: Sequence[int]
) -> tuple[tuple[float, float], Decision]:
    """Breaks at a limit of the output where far more samples lie than beside it."""
    # A rest before the first change is not clipped.
    outputs = [
        each.output[start + KEPT_REST if start else 0 :]
        for each, start in zip(recordings, starts, strict=True)
    ]
    y = np.concatenate([each[np.isfinite(each)] for each in outputs])
    levels, counts = np.unique(y, return_counts=True)
    limits, alternatives = [-np.inf, np.inf], [Alternative("none", 0.0)]
    if levels.size > MAX_DESIGNED_LEVELS:
        for side, order in ((0, 1), (1, -1)):
            near = counts[::order][:6]
            share = near[0] / y.size
            ratio = float(near[0] / np.mean(near[1:]))
            runs = max(_longest_run(each, levels[::order][0]) for each in outputs)
            if ratio > CLIPPED_RATIO and runs >= CLIPPED_RUN and share < MOST_CLIPPED:
                limits[side] = float(levels[::order][0])
                alternatives.append(Alternative(f"at {limits[side]:g}", share))
    found = len(alternatives) > 1
    sentence = (
        "Samples at a limit of the output, many in sequence, are clipped: they become breaks."
        if found
        else "No limit of the output holds more samples than the levels beside it."
    )
    choice = " and ".join(each.name for each in alternatives[1:]) if found else "none"
    decision = Decision(
        *("clipping", choice, tuple(alternatives), "share of samples at the limit", sentence)
    )
    return (limits[0], limits[1]), decision


def _decide_stuck(recordings: Sequence[Recording], starts: Sequence[int]) -> tuple[bool, Decision]:
    """Breaks where the output repeats one value for long, in a record without other repetitions."""
    outputs = [each.output[start:] for each, start in zip(recordings, starts, strict=True)]
    still = np.concatenate([_standing_still(y) for y in outputs])
    repeated = np.concatenate([np.append(y[1:] == y[:-1], False) for y in outputs])
    share, others = float(np.mean(still)), float(np.mean(repeated & ~still))
    found = 0.0 < share < MOST_STUCK and others < REPEATED
    sentence = (
        "The output stands still for long stretches of a record without other repetitions: they "
        "become breaks."
        if found
        else "No stretch in which the output stands still is distinguished from the rest."
    )
    alternatives = (Alternative("no", others), Alternative("yes", share))
    criterion = "share of samples that repeat the one before: scattered ones, in long stretches"
    choice = "yes" if found else "no"
    return found, Decision("stuck samples", choice, alternatives, criterion, sentence)


def _standing_still(signal: Array) -> NDArray[np.bool_]:
    """Samples in runs of at least ``STUCK_RUN`` equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(signal) != 0.0) + 1, [len(signal)]])
    lengths = np.diff(edges)
    return np.repeat(lengths >= STUCK_RUN, lengths)


def _longest_run(signal: Array, value: float) -> int:
    at = np.concatenate([[0], (signal == value).astype(int), [0]])
    edges = np.flatnonzero(np.diff(at))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _decide_decimation(stretches: Sequence[Stretch]) -> tuple[int, Decision]:
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
        return 1, Decision("decimation", "1", (Alternative("1", np.nan),), criterion, sentence)
    factors = [f for f in factors if f * coherent <= 0.5][-MOST_FACTORS:]
    if not factors:
        sentence = (
            f"{100 * POWER_SHARE:g} % of the output's power reach up to {edge:.3g} of the sampling "
            "rate: the record is not oversampled."
        )
        return 1, Decision("decimation", "1", (Alternative("1", np.nan),), criterion, sentence)
    alternatives = [Alternative(str(f), _decimated_error(stretches, f)) for f in (1, *factors)]
    chosen = lowest(alternatives, LEAST_GAIN)
    sentence = (
        f"{100 * POWER_SHARE:g} % of the output's power lie below {edge:.3g} of the sampling rate."
        f" A factor of {chosen.name} simulates held-out samples best."
    )
    return int(chosen.name), Decision(
        "decimation", chosen.name, tuple(alternatives), criterion, sentence
    )


def power_edge(stretches: Sequence[Stretch]) -> float:
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


def coherence_edge(stretches: Sequence[Stretch]) -> float:
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


def _decimated_error(stretches: Sequence[Stretch], factor: int) -> float:
    """Best error of a few output-error and ARX models at a lower rate; what is lost is added."""
    lower = [
        Stretch(decimated(s.input, factor), decimated(s.output, factor), s.recording)
        for s in stretches
    ]
    lost = sum(float(np.sum((s.output - smoothed(s.output, factor)) ** 2)) for s in stretches)
    total = sum(float(np.sum((s.output - s.output.mean()) ** 2)) for s in stretches)
    settings = FitSettings()
    best = np.inf
    for n in PROBES:
        for orders in (PolynomialOrders(nb=n, nf=n, nk=0), PolynomialOrders(na=n, nb=n, nk=0)):
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


def _decide_objective(stretches: Sequence[Stretch]) -> tuple[str, Decision]:
    """The objective whose distribution of residuals is the likelier one.

    Least squares is the maximum-likelihood estimate for normal residuals, least absolute deviations
    that for residuals of Laplace's distribution.  Both are fitted to ARX models, which whiten the
    residuals; each objective is represented by the order at which it is likeliest.
    """
    criterion = "negative log-likelihood of a residual by its BIC"
    likelihoods = {
        objective: _arx_likelihood(stretches, objective) for objective in ("quadratic", "absolute")
    }
    alternatives = tuple(Alternative(name, value) for name, value in likelihoods.items())
    samples = total_samples(stretches)
    evidence = samples * (likelihoods["quadratic"] - likelihoods["absolute"])
    objective = "absolute" if evidence > LEAST_EVIDENCE else "quadratic"
    sentence = (
        "The residuals of ARX models are likelier to have Laplace's distribution than a normal one:"
        " a few large ones stand out, and the absolute objective is used."
        if objective == "absolute"
        else "The residuals of ARX models are not likelier to have Laplace's distribution than a"
        " normal one: outliers do not call for the absolute objective."
    )
    return objective, Decision("objective", objective, alternatives, criterion, sentence)


def _arx_likelihood(stretches: Sequence[Stretch], objective: str) -> float:
    """Lowest negative log-likelihood of a residual over ARX orders, with the penalty of BIC."""
    samples = total_samples(stretches)
    orders = [n for n in OBJECTIVE_ORDERS if n * SAMPLES_PER_ORDER <= samples] or [1]
    settings, lowest_value = FitSettings(objective), np.inf
    for n in orders:
        try:
            found = fit(stretches, PolynomialOrders(na=n, nb=n + 1), settings)
        except (ValueError, np.linalg.LinAlgError):
            continue
        residuals = np.concatenate(found.residuals)
        count = len(residuals)
        value = 0.5 * (
            log_loss(residuals, objective) + found.parameters * np.log(count) / max(count, 1)
        )
        lowest_value = min(lowest_value, value)
    return lowest_value
