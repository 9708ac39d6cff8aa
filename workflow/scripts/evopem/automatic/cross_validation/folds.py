"""Scores of models on held-out samples, of which those under a repeated input count once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice

import numpy as np
from scipy.special import ndtri

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import (
    Model,
    errors_with_levels,
    prediction_errors,
)
from evopem.automatic.cross_validation.stretches import (
    LEAST_POWER,
    REASON,
    Fold,
    folds_of,
    is_large,
    response_parts,
)
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import likeliest_arx
from evopem.errors import NoModelError
from evopem.signals.recording import Segment, total_samples
from evopem.signals.spectra import LONGEST_LAG, cross_correlation, repetition_lag
from evopem.validation.held_out_tests import whitened

# Orders of the ARX models whose residuals are judged, with SAMPLES_PER_ORDER samples for each.
ARX_ORDERS, SAMPLES_PER_ORDER = (2, 4, 8, 12, 16), 25
# A correlation of this many standard errors is significant (1 %).
SIGNIFICANT = 2.6
# Probability that any lag far back is significant by chance; the most coefficients of regularised
# responses of all inputs, whose cost grows with their cube; the share of the samples between two
# breaks that they may take for their past.
LATE_BY_CHANCE, LONGEST_RESPONSE, LONGEST_PAST = 1e-3, 250, 0.7


@dataclass(frozen=True)
class Repetition:
    """How far residuals repeat with the input."""

    # samples after which the input repeats, as it is or with the opposite sign; 0 for none
    lag: int
    correlation: float  # of residuals whole lags apart, with the sign of the input's
    # share of the samples that are independent: ``1 / (1 + 2 r sum_k (1 - k lag / N))`` with that
    # correlation r (the design effect; Kish 1965)
    independent: float
    decision: Decision


def decide_repetition(stretches: Sequence[Segment]) -> Repetition:
    """Judge the residuals of ARX models of the longest stretch."""
    stretch = max(stretches, key=lambda stretch: stretch.samples)
    if stretch.inputs.shape[1] != 1 or stretch.outputs.shape[1] != 1:
        return _repetition(0, 0.0, 1.0, "Of several channels every sample counts.")
    lag = repetition_lag(stretch.input)
    if lag == 0:
        return _repetition(0, 0.0, 1.0, "The input does not repeat: every sample counts.")
    correlation = repeated_correlation(arx_residuals(stretch), stretch.input, lag)
    n = stretch.samples
    if not correlation > SIGNIFICANT / np.sqrt(n - lag):
        return _repetition(
            *(lag, correlation, 1.0),
            f"The input repeats after {lag} samples; the residuals do not: every sample counts.",
        )
    pairs = float(np.sum(1.0 - lag * np.arange(1, -(-n // lag)) / n))
    independent = 1.0 / (1.0 + 2.0 * pairs * correlation)
    return _repetition(
        *(lag, correlation, independent),
        f"The input repeats after {lag} samples, and so do the residuals (correlation"
        f" {correlation:.2f}): they are caused by the input, in a way that no linear model"
        f" describes. Repetitions add little information, so that {n} samples count as"
        f" {round(independent * n)} in the BIC.",
    )


def _repetition(lag: int, correlation: float, independent: float, sentence: str) -> Repetition:
    alternatives = (Alternative("repeated", correlation), Alternative("all", 0.0))
    choice = "all" if independent == 1.0 else f"{100.0 * independent:.0f} %"
    decision = Decision(
        *("independent samples", choice, alternatives),
        *("correlation of residuals where the input repeats", sentence),
    )
    return Repetition(lag, correlation, independent, decision)


def repeated_correlation(residuals: Array, signal: Array, lag: int) -> float:
    """Mean correlation of residuals 1, 2, ... lags apart, each with the sign of the input's.

    The residuals, (M,), are those of the last M samples of the input, (N,).
    """
    e = residuals - residuals.mean()
    u = (signal - signal.mean())[-len(e) :]
    power = float(e @ e) / len(e)
    if not power > 0.0:
        return 0.0
    multiples = range(lag, int(LONGEST_LAG * len(e)) + 1, lag)
    correlations = [
        float(np.sign(u[k:] @ u[:-k])) * float(e[k:] @ e[:-k]) / ((len(e) - k) * power)
        for k in multiples
    ]
    return float(np.mean(correlations)) if correlations else 0.0


def arx_residuals(stretch: Segment) -> Array:
    """Residuals of the ARX model of the lowest BIC, (M,), of the last M samples."""
    first, n = max(ARX_ORDERS), stretch.samples
    orders = [order for order in ARX_ORDERS if n >= max(order * SAMPLES_PER_ORDER, 3 * first)]
    likeliest = likeliest_arx([stretch], orders, first)
    if likeliest is None:
        return np.asarray(stretch.output[first:] - stretch.output[first:].mean())
    return likeliest.residuals


def late_response(stretches: Sequence[Segment], folds: int, delay: int) -> int:
    """Coefficients of a response that comes back far after its beginning; 0 for most records.

    What an ARX model leaves of the longest stretch is correlated with the input, both whitened
    (Haugh 1976): the last significant lag after the delay, of those that so many folds carry, and
    as many more as such a model describes.  Later samples of an input that repeats are earlier ones
    too.
    """
    stretch, order = max(stretches, key=lambda stretch: stretch.samples), max(ARX_ORDERS)
    longest = int(LONGEST_PAST * total_samples(stretches)) // folds - delay
    longest = min(LONGEST_RESPONSE, longest, stretch.samples - delay) - order
    single = stretch.inputs.shape[1] == stretch.outputs.shape[1] == 1
    if not single or longest <= order or repetition_lag(stretch.input):
        return 0
    stretch = Segment(stretch.inputs[: stretch.samples - delay], stretch.outputs[delay:])
    e, u = arx_residuals(stretch), stretch.input
    e, u = whitened(e), whitened(u)
    n = min(len(e), len(u))
    if not np.ptp(e[-n:]) > 0.0 < np.ptp(u[-n:]):
        return 0
    lags = np.arange(order + 1, min(longest, n // 2))
    errors = cross_correlation(e[-n:], u[-n:], n // 2)[n // 2 + lags] * n / np.sqrt(n - lags)
    late = lags[np.abs(errors) > -ndtri(LATE_BY_CHANCE / 2.0 / max(len(lags), 1))]
    return int(late[-1]) + order if len(late) else 0


# Designs of folds: number of folds, and blocks of each.  Long blocks show errors of the gain and of
# slow poles, many folds leave more samples to fit, interleaved blocks compare like with like.
DESIGNS = ((2, 1), (5, 1), (2, 3))
# Each fold is a fit of every candidate.  For that reason alone several channels, whose fits take
# longer, have five of them in place of nine, and two where the record is large as well.
OF_SEVERAL, OF_LARGE = ((5, 1),), ((2, 1),)
OF_TIME = " Of several channels, whose fits take longer, there are fewer."
MOVING = (
    "The parts of the record excite different bands, as a chirp does, or an input rests in some of"
    " them: they are interleaved."
)
# For records whose excitation moves over the bands, such as a chirp, or pauses.
INTERLEAVED = ((2, 3), (2, 6))
# For the response to a single blow.
OF_RESPONSE = ((2, 1), (5, 1))
SHORTEST_BLOCK = 25
# Least share of a part's input spectrum that the rest of the record must have as well.
LEAST_OVERLAP = 0.4
BANDS = 24
# Errors beyond this, in standard deviations of the output, are all the same: useless.
LARGEST_ERROR = 1e3


@dataclass(frozen=True)
class FoldPlan:
    """What models of all structures are compared on."""

    designs: tuple[tuple[int, int], ...]  # folds, and blocks of each fold
    decision: Decision
    repetition: Repetition  # how many of the samples are independent
    by_energy: bool = False  # whether the folds divide the energy of the response to a single blow
    late_response: int = 0  # coefficients of a response that comes back far after its beginning
    shortest: float = SHORTEST_BLOCK  # samples of a block, and before it, at least


@dataclass(frozen=True)
class HeldOutScores:
    """Errors on held-out samples in percent of the outputs' deviation from their means.

    Root mean square errors for the quadratic objective, mean absolute ones for the absolute; the
    geometric mean over the designs of folds of the mean over the outputs.  Simulations run on from
    the samples before (:func:`.errors_simulated_on`), with the level of the training samples, or
    with one that is fitted to the held-out samples; predictions are one step ahead.  Sums are
    divided by the samples less the level that was fitted to them.  Infinite where there is none.
    """

    simulation: float = np.inf
    fitted_level: float = np.inf
    prediction: float = np.inf
    simulation_folds: tuple[float, ...] = ()  # logarithms of the errors of each fold
    fitted_level_folds: tuple[float, ...] = ()
    prediction_folds: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        # JSON has no infinity: what could not be computed comes back as NaN, which has no order.
        for name in KINDS:
            if np.isnan(getattr(self, name)):
                object.__setattr__(self, name, np.inf)


KINDS = ("simulation", "fitted_level", "prediction")
"""The errors on held-out samples, as attributes of the scores."""


def decide_folds(stretches: Sequence[Segment], delay: int = 0) -> FoldPlan:
    """Choose the designs of folds whose parts have common input spectra, and judge repetitions.

    Blocks are longer than the longest ``delay`` and a late response: training parts between them
    are fitted as well.
    """
    samples = total_samples(stretches)
    late = late_response(stretches, max(folds for folds, blocks in DESIGNS if blocks == 1), delay)
    shortest = max(SHORTEST_BLOCK + delay, (late + delay) / LONGEST_PAST)
    channels = stretches[0].inputs.shape[1], stretches[0].outputs.shape[1]
    designs: tuple[tuple[int, int], ...] = DESIGNS
    if channels != (1, 1):
        designs = OF_LARGE if is_large(stretches) else OF_SEVERAL

    def possible(some: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
        return [d for d in some if samples >= d[0] * d[1] * shortest] or [(2, 1)]

    overlaps = {
        d: _overlap(folds_of(tuple(stretches), *d, shortest=1))
        for d in dict.fromkeys([*designs, *possible(designs)])
    }
    kept = [d for d in possible(designs) if overlaps[d] >= LEAST_OVERLAP]
    parts = () if kept else OF_RESPONSE
    of_response = [d for d in parts if _response_edges(stretches, d[0]) is not None]
    sentence = "The parts of the record have common input spectra, so the folds are comparable."
    sentence += OF_TIME * (channels != (1, 1))
    back = late + delay - max(ARX_ORDERS)
    sentence += f" The output still depends on the input {back} samples before." * (late > 0)
    if not kept:
        sentence = REASON if of_response else MOVING
    kept = kept or of_response or possible(INTERLEAVED)
    about = Decision(
        *("folds", " and ".join(map(_name, kept))),
        tuple(Alternative(_name(d), 1.0 - overlaps[d]) for d in overlaps),
        "share of a held-out part's input spectrum outside that of the training part",
        sentence,
    )
    repetition = decide_repetition(stretches)
    return FoldPlan(tuple(kept), about, repetition, bool(of_response), late, shortest)


def _response_edges(stretches: Sequence[Segment], count: int) -> tuple[int, ...] | None:
    """Ends of the parts of the response to a single blow; None for other records."""
    inputs, outputs = (
        np.concatenate([getattr(stretch, name) for stretch in stretches])
        for name in ("inputs", "outputs")
    )
    return response_parts(inputs, outputs, count, SHORTEST_BLOCK)


def held_out_scores(
    stretches: Sequence[Segment],
    plan: FoldPlan,
    estimate: Callable[[Sequence[Sequence[Segment]]], Sequence[Model]],
    absolute: bool,
) -> HeldOutScores:
    """Score what a method estimates from the training parts of all folds on what each leaves.

    ``estimate`` may raise NoModelError; errors are absolute instead of squared with ``absolute``.
    """
    outputs = np.concatenate([stretch.outputs for stretch in stretches])
    centred = outputs - outputs.mean(axis=0)
    scale = np.mean(np.abs(centred), axis=0) if absolute else np.std(outputs, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    designs = _scored_folds(tuple(stretches), plan)
    try:
        models = iter(estimate([training for scored in designs for training, _ in scored]))
    except NoModelError:
        return HeldOutScores()
    logarithms, of_folds = [], []
    for scored in designs:
        of_design = [
            np.sum([_errors_on(model, *part, absolute) for part in parts], axis=0)
            for (_, parts), model in zip(scored, islice(models, len(scored)), strict=True)
        ]
        sums, counts = np.sum(of_design, axis=0)
        if not (counts[2] > 0).all():
            return HeldOutScores()
        logarithms.append(_logarithms(sums, counts, scale, absolute))
        of_folds += [_logarithms(errors[0], errors[1], scale, absolute) for errors in of_design]
    simulation, fitted_level, prediction = 100.0 * np.exp(np.mean(logarithms, axis=0))
    by_kind = [tuple(map(float, row)) for row in np.transpose(of_folds)]
    if not stretches[0].has_input:
        simulation = fitted_level = np.inf
    return HeldOutScores(float(simulation), float(fitted_level), float(prediction), *by_kind)


@lru_cache(maxsize=2)  # all candidates of a record are scored on the same parts
def _scored_folds(
    stretches: tuple[Segment, ...], plan: FoldPlan
) -> list[list[tuple[tuple[Segment, ...], list[tuple[Segment, Segment]]]]]:
    """Of each design: training parts of its folds, and scored samples behind those before them."""
    shortest, designs = min(SHORTEST_BLOCK, total_samples(stretches) // 4), []
    for design in plan.designs:
        edges = _response_edges(stretches, design[0]) if plan.by_energy else None
        folds = folds_of(stretches, *design, shortest, edges, plan.shortest)
        # The beginning of a recording determines state and level poorly.
        has_past = any(before.samples for fold in folds for before in fold.before)
        scored = []
        for fold in folds:
            parts = list(zip(fold.before, fold.held_out, strict=True))
            parts = [part for part in parts if part[0].samples or not has_past]
            # A rest of a stretch tells little, and fewer samples before than a delay no state.
            parts = [p for p in parts if min(s.samples for s in p) >= plan.shortest] or parts
            scored += [(fold.training, parts)] if parts else []
        designs.append(scored)
    return designs


def _logarithms(sums: Array, counts: Array, scale: Array, absolute: bool) -> Array:
    """Logarithms of the errors of each kind, (3,), mean over the outputs, bounded."""
    with np.errstate(all="ignore"):
        means = sums / counts
        ratios = (means if absolute else np.sqrt(means)) / scale
    ratios = np.clip(np.nan_to_num(ratios, nan=LARGEST_ERROR), 1e-12, LARGEST_ERROR)
    return np.log(ratios.mean(axis=1))


def _errors_on(model: Model, before: Segment, stretch: Segment, absolute: bool) -> Array:
    """Sums of squared or absolute errors, and samples less what was fitted, (2, 3, l)."""

    def total(errors: Array) -> Array:
        return np.asarray(np.sum(np.abs(errors) if absolute else errors**2, axis=0))

    sums, counts = np.zeros((2, 3, stretch.outputs.shape[1]))
    with np.errstate(all="ignore"):
        if stretch.has_input:
            given = model, before, stretch, (False, True), absolute
            for fitted, errors in enumerate(errors_with_levels(*given)):
                sums[fitted], counts[fitted] = total(errors), len(errors) - fitted
        errors = prediction_errors(model, stretch, before)
        if len(errors) > stretch.samples // 4:
            sums[2], counts[2] = total(errors), len(errors)
    return np.array([sums, counts])


def _overlap(folds: Sequence[Fold]) -> float:
    """Smallest share of a held-out input spectrum that the training part has as well. 0 where an
    input nearly rests in the training part, as all inputs do after a single blow."""
    return min(
        float(np.minimum(_spectrum(fold.held_out), _spectrum(fold.training)).sum())
        * (not _rests(fold))
        for fold in folds
    )


def _rests(fold: Fold) -> bool:
    """Whether the training part has hardly any power of an input that the held-out part has."""
    if not fold.training:
        return False
    parts = [np.concatenate([s.inputs for s in part]) for part in (fold.training, fold.held_out)]
    mean = np.concatenate(parts).mean(axis=0)
    of_training, of_held_out = (((u - mean) ** 2).mean(axis=0) for u in parts)
    return bool((of_training < LEAST_POWER * of_held_out).any())


def _spectrum(stretches: Sequence[Segment]) -> Array:
    """Power of the inputs in equally wide bands, (m, BANDS), each input with the same share of 1.
    Of the outputs, where there is no input."""
    if not stretches:
        return np.full((1, BANDS), 1.0 / BANDS)
    driven = stretches[0].has_input
    signals = [stretch.inputs if driven else stretch.outputs for stretch in stretches]
    mean, power = np.mean(np.concatenate(signals), axis=0), np.zeros((signals[0].shape[1], BANDS))
    for signal in signals:
        if len(signal) > 2:
            windowed = (signal - mean) * np.hanning(len(signal))[:, None]
            lines = np.abs(np.fft.rfft(windowed, axis=0)) ** 2
            band = np.minimum(np.arange(len(lines)) * BANDS // len(lines), BANDS - 1)
            power += [np.bincount(band, line, BANDS) for line in lines.T]
    totals = power.sum(axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        shares = np.where(totals > 0, power / totals, 1.0 / BANDS)
    return np.asarray(shares / len(shares))


def _name(design: tuple[int, int]) -> str:
    folds, blocks = design
    return f"{folds} folds of {blocks} block{'s' if blocks > 1 else ''}"
