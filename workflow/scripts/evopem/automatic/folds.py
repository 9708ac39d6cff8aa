"""Scores of models on held-out samples of the estimation part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import FOLD_STAGES, FitSettings, fit
from evopem.automatic.repetition import Repetition, decide_repetition
from evopem.automatic.response_parts import REASON, response_parts
from evopem.automatic.simulation import errors_simulated_on, prediction_errors
from evopem.automatic.stretches import Fold, folds_of
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment, total_samples

Array = NDArray[np.float64]

# Designs of folds: number of folds, and blocks of each.  Long blocks show errors of the gain and of
# slow poles, many folds leave more samples to fit, interleaved blocks compare like with like.
DESIGNS = ((2, 1), (5, 1), (2, 3))
# For records whose excitation moves over the bands, such as a chirp.
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
    """What models of all structures are compared on.

    Attributes
    ----------
    designs : tuple of (int, int)
        How held-out samples are divided: folds, and blocks of each fold.
    decision : Decision
    repetition : Repetition
        How many of the samples are independent.
    by_energy : bool
        Whether the folds divide the energy of the response to a single blow.
    """

    designs: tuple[tuple[int, int], ...]
    decision: Decision
    repetition: Repetition
    by_energy: bool = False


@dataclass(frozen=True)
class HeldOutScores:
    """Errors on held-out samples, relative to the output's deviation from its mean, in percent.

    Root mean square errors for the quadratic objective, mean absolute ones for the absolute; the
    geometric mean over the designs of folds.  Simulations run on from the samples before
    (:func:`.errors_simulated_on`); sums are divided by the samples less what was fitted to them.

    Attributes
    ----------
    simulation : float
        With the level of the training samples.
    free_level : float
        With a level that is fitted to the held-out samples.
    prediction : float
        One step ahead.
    simulation_folds, free_level_folds : tuple of float
        Logarithms of the errors of each fold of each design.
    """

    simulation: float
    free_level: float
    prediction: float
    simulation_folds: tuple[float, ...]
    free_level_folds: tuple[float, ...]

    def __post_init__(self) -> None:
        # JSON has no infinity: what could not be computed comes back as NaN, which has no order.
        for name in ("simulation", "free_level", "prediction"):
            if np.isnan(getattr(self, name)):
                object.__setattr__(self, name, np.inf)

    @staticmethod
    def none() -> HeldOutScores:
        """Scores of a model that could not be fitted."""
        return HeldOutScores(np.inf, np.inf, np.inf, (), ())


def decide_folds(stretches: Sequence[Segment]) -> FoldPlan:
    """Choose the designs of folds whose parts have common input spectra, and judge repetitions.

    Parameters
    ----------
    stretches : sequence of Segment
    """
    samples = total_samples(stretches)
    possible = [d for d in DESIGNS if samples >= d[0] * d[1] * SHORTEST_BLOCK] or [(2, 1)]
    overlaps = {
        d: _overlap(folds_of(stretches, *d, 1)) for d in dict.fromkeys([*DESIGNS, *possible])
    }
    kept = [d for d in possible if overlaps[d] >= LEAST_OVERLAP]
    of_response = [d for d in OF_RESPONSE if _response_edges(stretches, d[0]) is not None]
    alternatives = tuple(Alternative(_name(d), 1.0 - overlaps[d]) for d in overlaps)
    if of_response:
        kept = of_response
        sentence = REASON
    elif kept:
        sentence = "The parts of the record have common input spectra, so the folds are comparable."
    else:
        kept = [d for d in INTERLEAVED if samples >= d[0] * d[1] * SHORTEST_BLOCK] or [(2, 1)]
        sentence = (
            "The parts of the record excite different bands, as a chirp does: the folds are "
            "interleaved stretches."
        )
    return FoldPlan(
        tuple(kept),
        Decision(
            *("folds", " and ".join(_name(d) for d in kept), alternatives),
            "share of a held-out part's input spectrum that the training part lacks",
            sentence,
        ),
        decide_repetition(stretches),
        bool(of_response),
    )


def _response_edges(stretches: Sequence[Segment], count: int) -> list[int] | None:
    """Ends of the parts of the response to a single blow; None for other records."""
    inputs, outputs = (
        np.concatenate([getattr(each, name) for each in stretches])[:, None]
        for name in ("input", "output")
    )
    return response_parts(inputs, outputs, count, SHORTEST_BLOCK)


def held_out_scores(
    stretches: Sequence[Segment],
    plan: FoldPlan,
    model: PolynomialModel,
    settings: FitSettings,
) -> HeldOutScores:
    """Fit a model's orders to the training part of each fold and score it on the rest.

    Parameters
    ----------
    stretches : sequence of Segment
    plan : FoldPlan
    model : PolynomialModel
        Fitted to all stretches; the descents start there.
    settings : FitSettings
    """

    def refitted(training: Sequence[Segment]) -> PolynomialModel:
        return fit(
            *(training, model.orders, settings, [model]), *(False, model.structure, FOLD_STAGES)
        ).model

    return scores_of(stretches, plan, refitted, settings.objective == "absolute")


def scores_of(
    stretches: Sequence[Segment],
    plan: FoldPlan,
    estimate: Callable[[Sequence[Segment]], PolynomialModel],
    absolute: bool,
) -> HeldOutScores:
    """Score what a method estimates from the training part of each fold on the rest.

    Parameters
    ----------
    stretches : sequence of Segment
    plan : FoldPlan
    estimate : callable
        From the training part to a model; it may raise ValueError or LinAlgError.
    absolute : bool
        Whether errors are absolute instead of squared.
    """
    output = np.concatenate([each.output for each in stretches])
    scale = float(np.mean(np.abs(output - output.mean())) if absolute else np.std(output)) or 1.0
    shortest = min(SHORTEST_BLOCK, total_samples(stretches) // 4)
    logarithms, of_folds = [], []
    for folds, blocks in plan.designs:
        of_design = []
        edges = _response_edges(stretches, folds) if plan.by_energy else None
        for fold in folds_of(stretches, folds, blocks, shortest, edges):
            try:
                found = estimate(fold.training)
            except (ValueError, np.linalg.LinAlgError):
                return HeldOutScores.none()
            parts = zip(fold.before, fold.held_out, strict=True)
            of_design.append(np.sum([_errors_on(found, *part, absolute) for part in parts], axis=0))
        sums, counts = np.sum(of_design, axis=0)
        if not (counts > 0).all():
            return HeldOutScores.none()
        logarithms.append(_logarithms(sums, counts, scale, absolute))
        of_folds += [_logarithms(errors[0], errors[1], scale, absolute) for errors in of_design]
    simulation, free_level, prediction = 100.0 * np.exp(np.mean(logarithms, axis=0))
    by_kind = np.transpose(of_folds)
    return HeldOutScores(
        float(simulation),
        float(free_level),
        float(prediction),
        tuple(map(float, by_kind[0])),
        tuple(map(float, by_kind[1])),
    )


def _logarithms(sums: Array, counts: Array, scale: float, absolute: bool) -> Array:
    """Logarithms of root mean squares or mean absolute values, relative to a scale and bounded."""
    with np.errstate(all="ignore"):
        means = sums / counts
        ratios = (means if absolute else np.sqrt(means)) / scale
    return np.log(np.clip(np.nan_to_num(ratios, nan=LARGEST_ERROR), 1e-12, LARGEST_ERROR))


def _errors_on(model: PolynomialModel, before: Segment, stretch: Segment, absolute: bool) -> Array:
    """Sums of squared or absolute errors of the three kinds, and samples less what was fitted."""

    def total(errors: Array) -> float:
        return float(np.sum(np.abs(errors)) if absolute else errors @ errors)

    n = stretch.samples
    sums, counts = np.zeros(3), np.zeros(3)
    for kind, free_level in enumerate((False, True)):
        errors = errors_simulated_on(model, before, stretch, free_level, absolute)
        sums[kind], counts[kind] = total(errors), len(errors) - int(free_level)
    errors = prediction_errors(model, stretch)
    remaining = len(errors) - model.orders.single.nf - model.orders.noise_states
    if remaining > n // 4:
        sums[2], counts[2] = total(errors), remaining
    return np.array([sums, counts])


def _overlap(folds: Sequence[Fold]) -> float:
    """Smallest share of a held-out input spectrum that the training part has as well."""
    return min(
        float(np.minimum(_spectrum(fold.held_out), _spectrum(fold.training)).sum())
        for fold in folds
    )


def _spectrum(stretches: Sequence[Segment]) -> Array:
    """Power of the input in equally wide bands, summing to 1."""
    power = np.zeros(BANDS)
    mean = np.mean(np.concatenate([each.input for each in stretches])) if stretches else 0.0
    for each in stretches:
        if each.samples > 2:
            line = np.abs(np.fft.rfft((each.input - mean) * np.hanning(each.samples))) ** 2
            band = np.minimum(np.arange(len(line)) * BANDS // len(line), BANDS - 1)
            power += np.bincount(band, line, BANDS)
    total = power.sum()
    return power / total if total > 0 else np.full(BANDS, 1.0 / BANDS)


def _name(design: tuple[int, int]) -> str:
    folds, blocks = design
    return f"{folds} folds of {blocks} block{'s' if blocks > 1 else ''}"
