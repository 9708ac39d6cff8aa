"""The choice between structures, for each purpose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import log_loss
from evopem.automatic.level_decision import Level, decide_level
from evopem.automatic.orders import Candidate, Scorer, StructureSearch, refine_orders
from evopem.automatic.peer import against_peer
from evopem.automatic.simulation import prediction_errors
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT

Array = NDArray[np.float64]


def heaviness(model: PolynomialModel, stretches: Sequence[Segment]) -> float:
    """How much likelier a residual is under Laplace's distribution than under a normal one.

    The mean logarithm of the ratio, each distribution at its likeliest scale.
    """
    e = _residuals(model, stretches)
    return 0.5 * (log_loss(e, "quadratic") - log_loss(e, "absolute"))


def feedback_probability(model: PolynomialModel, stretches: Sequence[Segment]) -> float:
    """Probability that the input depends so much on past residuals by chance.

    The input is regressed on its own past without and with past residuals (an F test; Granger
    1969), in the longest stretch.
    """
    from scipy.stats import f

    stretch = max(stretches, key=lambda each: each.samples)
    e = prediction_errors(model, stretch)
    u = stretch.input[len(stretch.input) - len(e) :]
    n, lags = len(e), min(10, len(e) // 15)
    if lags < 1:
        return 1.0
    own = [np.ones(n - lags), *(u[lags - k : n - k] for k in range(1, lags + 1))]
    other = [e[lags - k : n - k] for k in range(1, lags + 1)]
    target = u[lags:]
    without = _sum_of_squares(np.column_stack(own), target)
    with_residuals = _sum_of_squares(np.column_stack([*own, *other]), target)
    freedom = len(target) - 2 * lags - 1
    if not with_residuals > 0.0 or freedom < 1:
        return 1.0
    statistic = (without - with_residuals) / lags / (with_residuals / freedom)
    return float(f.sf(statistic, lags, freedom))


def _residuals(model: PolynomialModel, stretches: Sequence[Segment]) -> Array:
    return np.concatenate([prediction_errors(model, each) for each in stretches])


def _sum_of_squares(regressors: Array, target: Array) -> float:
    e = target - regressors @ np.linalg.lstsq(regressors, target, rcond=None)[0]
    return float(e @ e)


Purpose = Literal["simulation", "prediction", "modes", "auto"]

# Models whose simulation errors are within one standard error of the lowest, and within this share,
# are as good.
AS_GOOD = 0.1
# Folds that are independent of each other, of those in all designs.
INDEPENDENT_FOLDS = 4
# Probability of feedback, or of residuals as coloured as these, by chance, from which a choice
# depends on it: far rarer than that of a failed check.
BY_CHANCE = 1e-3
# Evidence of a residual for Laplace's distribution against the normal one, as a logarithm, from
# which tails are heavy: 0.07 for Laplace's itself, -0.05 for the normal one.
HEAVY = 0.1
# Largest held-out simulation errors, against the lowest ones, of a model that is taken for its
# likelihood: where its residuals are valid, where the record was made under feedback, where all its
# checks hold, and where disturbances are heavy-tailed; those ring in simulations, and an
# output-error model takes them for the response to the input.
MOST_WHEN_VALID, MOST_UNDER_FEEDBACK = 1.25, 1.35
MOST_WHEN_ALL_HOLD = MOST_UNDER_HEAVY_TAILS = 3.0
FINALISTS = 2
# A difference of BIC, not divided by the samples, that is strong evidence (Kass & Raftery 1995),
# and the share by which a simulation error must fall to overrule a choice without strong evidence.
STRONG, CLEAR_GAIN = 6.0, 0.02


@dataclass(frozen=True)
class Choice:
    """The model for one purpose.

    Attributes
    ----------
    purpose : {"simulation", "prediction", "modes"}
    candidate : Candidate
    level : {"constant", "state"}
        Whether the level of other samples is that of the estimation samples, or belongs to the
        state that is fitted to them.
    """

    purpose: Purpose
    candidate: Candidate
    level: Level


@dataclass(frozen=True)
class Comparison:
    """The models for all purposes, and what was decided on the way."""

    choices: tuple[Choice, ...]
    candidates: tuple[Candidate, ...]
    decisions: tuple[Decision, ...]

    def choice(self, purpose: Purpose) -> Choice:
        """The choice for a purpose; ``auto`` is simulation."""
        wanted = "simulation" if purpose == "auto" else purpose
        return next(each for each in self.choices if each.purpose == wanted)


def compare_structures(scorer: Scorer, searches: Sequence[StructureSearch]) -> Comparison:
    """Choose a model for each purpose among the candidates of all structures.

    Simulation: the lowest error of simulations of held-out samples; of the models that are as good,
    the lowest BIC, of one-step errors where these are white, else of simulation errors.
    Prediction: the lowest one-step error on held-out samples.  Modes: the lowest BIC of models with
    poles.

    Parameters
    ----------
    scorer : Scorer
    searches : sequence of StructureSearch

    Raises
    ------
    ValueError
        When no structure has a candidate.
    """
    candidates = [each for search in searches for each in search.candidates]
    if not candidates:
        raise ValueError("the record is too short for a model of any structure")
    scorer.remember(candidates)
    level, about_level = decide_level(
        min(each.scores.simulation for each in candidates),
        min(each.scores.free_level for each in candidates),
    )
    score = _score_of(level)
    finalists = _best_of_structures(candidates, score)[:FINALISTS]
    for finalist in finalists:
        candidates.extend(refine_orders(scorer, finalist, score))
    candidates = list(dict.fromkeys(candidates))
    simulation, about_simulation = _for_simulation(scorer, candidates, level)
    level, about_level = _level_of(simulation, level, about_level)
    about_peer = against_peer(
        *(scorer.stretches, scorer.plan, scorer.settings.objective, simulation.name),
        *(simulation.scores, level == "state"),
    )
    prediction = min(candidates, key=lambda each: each.scores.prediction)
    with_poles = [each for each in candidates if each.orders.na + each.orders.single.nf >= 2]
    modes = min(with_poles or candidates, key=lambda each: each.bic)
    return Comparison(
        (
            Choice("simulation", scorer.on_all_samples(simulation), level),
            Choice("prediction", scorer.on_all_samples(prediction), "constant"),
            Choice("modes", scorer.on_all_samples(modes), "constant"),
        ),
        tuple(candidates),
        (
            about_level,
            about_simulation,
            _named(
                *("structure for prediction", prediction, candidates),
                *(lambda each: each.scores.prediction, "one-step error on held-out samples, %"),
            ),
            _named("structure for modes", modes, candidates, lambda each: each.bic, "BIC"),
            about_peer,
        ),
    )


def _score_of(level: Level) -> Callable[[Candidate], float]:
    if level == "state":
        return lambda each: each.scores.free_level
    return lambda each: each.scores.simulation


def _level_of(candidate: Candidate, level: Level, decision: Decision) -> tuple[Level, Decision]:
    """The level as a state after all, where the chosen model simulates clearly better with it.

    A level passes through 1/A: where A has roots near 1, its small error in the equation is a large
    one in simulations.
    """
    constant, free = candidate.scores.simulation, candidate.scores.free_level
    if level == "state" or not free < (1.0 - CLEAR_GAIN) * constant:
        return level, decision
    sentence = (
        f"{candidate.name} simulates held-out samples better when their level is fitted to them "
        "with the initial state."
    )
    alternatives = (Alternative("constant", constant), Alternative("state", free))
    return "state", replace(decision, choice="state", alternatives=alternatives, sentence=sentence)


def _best_of_structures(
    candidates: Sequence[Candidate], score: Callable[[Candidate], float]
) -> list[Candidate]:
    names = dict.fromkeys(each.structure for each in candidates)
    best = [min((c for c in candidates if c.structure == n), key=score) for n in names]
    return sorted(best, key=score)


def _for_simulation(
    scorer: Scorer, candidates: Sequence[Candidate], level: Level
) -> tuple[Candidate, Decision]:
    score = _score_of(level)
    best = min(candidates, key=score)
    chosen, sentence = (
        _under_heavy_tails(scorer, candidates, score)
        or _by_likelihood(scorer, candidates, level)
        or _by_simulation(scorer, candidates, best, level)
    )
    decision = _named(
        *("structure for simulation", chosen, candidates),
        *(score, "simulation error on held-out samples, %", sentence),
    )
    return chosen, decision


def _under_heavy_tails(
    scorer: Scorer, candidates: Sequence[Candidate], score: Callable[[Candidate], float]
) -> tuple[Candidate, str] | None:
    """The lowest BIC, where heavy-tailed disturbances pass through the poles of the plant."""
    likeliest = min(candidates, key=lambda each: each.bic)
    lowest_score = min(map(score, candidates))
    if (
        scorer.settings.objective != "absolute"
        or likeliest.orders.na == 0
        or heaviness(likeliest.model, scorer.stretches) < HEAVY
        or not score(likeliest) < MOST_UNDER_HEAVY_TAILS * lowest_score
    ):
        return None
    sentence = (
        "The disturbances are heavy-tailed and pass through the poles of the plant: simulation "
        f"errors are not robust against them. {likeliest.name} has the lowest BIC, of the absolute "
        "one-step errors."
    )
    near = [each for each in _without_evidence(scorer, candidates, likeliest) if each.orders.na]
    smallest = min(_fewest_failures(scorer, near), key=lambda each: (each.parameters, each.bic))
    if smallest is likeliest:
        return likeliest, sentence
    return smallest, (
        f"{sentence} {smallest.name}, against which the BIC gives no strong evidence, fails fewer "
        "checks or has fewer parameters."
    )


def _fewest_failures(scorer: Scorer, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those of which the fewest checks of the report fail on the estimation samples."""
    failures = [len(scorer.checks(each).failed) for each in candidates]
    return [
        each for each, number in zip(candidates, failures, strict=True) if number == min(failures)
    ]


def _without_evidence(
    scorer: Scorer, candidates: Sequence[Candidate], likeliest: Candidate
) -> list[Candidate]:
    """The models against which the BIC gives no strong evidence, the likeliest included."""
    count = scorer.independent_samples
    return [each for each in candidates if count * (each.bic - likeliest.bic) < STRONG]


def _by_likelihood(
    scorer: Scorer, candidates: Sequence[Candidate], level: Level
) -> tuple[Candidate, str] | None:
    """The model of the lowest BIC, where nothing speaks against it.

    Maximum likelihood is efficient where the residuals are white and independent of the input, and
    unbiased under feedback.  Simulation errors contain the noise as a whole; where it is narrow in
    frequency, they differ by chance by far more than the models do.
    """
    score = _score_of(level)
    likeliest = min(candidates, key=lambda each: each.bic)
    ratio = score(likeliest) / min(map(score, candidates))
    checks = scorer.checks(likeliest)
    largest = MOST_WHEN_VALID if checks.failed else MOST_WHEN_ALL_HOLD
    if not (ratio < max(largest, MOST_UNDER_FEEDBACK) and checks.whiteness >= BY_CHANCE):
        return None
    feedback = feedback_probability(likeliest.model, scorer.stretches)
    if feedback < BY_CHANCE:
        return likeliest, (
            f"The input depends on past residuals (p = {feedback:.1g}): the record was made under "
            f"feedback, where simulation errors are biased. {likeliest.name} has the lowest BIC "
            "and white residuals."
        )
    if not (ratio < largest and INDEPENDENT_OF_INPUT not in checks.failed):
        return None
    sentence = (
        f"{likeliest.name} has the lowest BIC, and its residuals are white and independent of the "
        "input."
    )
    near = _without_evidence(scorer, candidates, likeliest)
    best = min(near, key=score)
    equal = _fewest_failures(scorer, [each for each in near if as_good(each, best, level)])
    chosen = min(equal, key=lambda each: each.bic)
    if chosen is likeliest:
        return likeliest, sentence
    return chosen, (
        f"{sentence} {chosen.name}, against which the BIC gives no strong evidence, simulates "
        "held-out samples better or fails fewer checks."
    )


def _by_simulation(
    scorer: Scorer, candidates: Sequence[Candidate], best: Candidate, level: Level
) -> tuple[Candidate, str]:
    """The lowest BIC of those that simulate held-out samples as well as the best."""
    equal = [each for each in candidates if as_good(each, best, level)]
    equal = _fewest_failures(scorer, equal)
    chosen = min(equal, key=lambda each: each.bic)
    reason = "has the lowest BIC of those that fail the fewest checks, and white residuals"
    if scorer.checks(chosen).whiteness < BY_CHANCE:
        # No model of these describes the noise, so that one-step errors say little of the plant.
        chosen = min(equal, key=lambda each: each.simulation_bic)
        reason = (
            "has the lowest BIC of simulation errors of those that fail the fewest checks, whose "
            "residuals are not white"
        )
    if chosen is best:
        return best, f"{best.name} simulates held-out samples with the lowest error."
    return chosen, (
        f"{chosen.name} simulates held-out samples as well as {best.name}, within a standard error,"
        f" and {reason}."
    )


def as_good(candidate: Candidate, best: Candidate, level: Level) -> bool:
    """Whether a model simulates held-out samples as well as another.

    Within one standard error of the mean difference of the folds, and within 10 %.

    Parameters
    ----------
    candidate, best : Candidate
    level : {"constant", "state"}
    """

    def folds(each: Candidate) -> tuple[float, ...]:
        scores = each.scores
        return scores.free_level_folds if level == "state" else scores.simulation_folds

    score = _score_of(level)
    if len(folds(candidate)) != len(folds(best)) or not np.isfinite(score(candidate)):
        return candidate is best
    differences = np.subtract(folds(candidate), folds(best))
    standard_error = float(np.std(differences, ddof=1)) / np.sqrt(INDEPENDENT_FOLDS)
    difference = float(np.log(score(candidate) / score(best)))
    return difference <= min(standard_error, AS_GOOD)


def _named(
    subject: str,
    chosen: Candidate,
    candidates: Sequence[Candidate],
    score: Callable[[Candidate], float],
    criterion: str,
    sentence: str = "",
) -> Decision:
    best = {each.structure: each for each in sorted(candidates, key=score, reverse=True)}
    best[chosen.structure] = chosen
    alternatives = tuple(
        Alternative(each.name, score(each)) for each in sorted(best.values(), key=score)
    )
    sentence = sentence or f"{chosen.name} has the lowest score."
    return Decision(subject, chosen.name, alternatives, criterion, sentence)
