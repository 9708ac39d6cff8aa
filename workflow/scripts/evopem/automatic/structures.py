"""The choice between structures, for each purpose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from evopem.automatic.candidates import Candidate, Scorer, StructureSearch
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.held_out.folds import HeldOutScores
from evopem.automatic.held_out.level_decision import Level, decide_level
from evopem.automatic.noise_properties import feedback_probability, heaviness
from evopem.automatic.orders import refine_orders
from evopem.automatic.subspace_comparison import with_subspace_estimate
from evopem.errors import NoModelError
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT

Purpose = Literal["simulation", "prediction", "modes", "auto"]
Kind = Literal["simulation", "fitted_level", "prediction"]
Score = Callable[[Candidate], float]

# Models whose errors are within one standard error of the lowest, and within this share, are as
# good.
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

    The level of other samples is that of the estimation samples, ``constant``, or belongs to the
    ``state`` that is fitted to them.
    """

    purpose: Purpose
    candidate: Candidate
    level: Level

    @property
    def kind(self) -> Kind:
        """The errors on held-out samples that decide."""
        return kind_of(self.purpose, self.level)


@dataclass(frozen=True)
class Comparison:
    """The models for all purposes, and what was decided on the way."""

    choices: tuple[Choice, ...]
    candidates: tuple[Candidate, ...]
    decisions: tuple[Decision, ...]

    def choice(self, purpose: Purpose) -> Choice:
        """The choice for a purpose; ``auto``, and what there is none for, is the first one."""
        return next((each for each in self.choices if each.purpose == purpose), self.choices[0])


def kind_of(purpose: Purpose, level: Level) -> Kind:
    """The errors on held-out samples that decide for a purpose."""
    if purpose == "prediction":
        return "prediction"
    return "fitted_level" if level == "state" else "simulation"


def score_of(kind: Kind) -> Score:
    """The error of a candidate on held-out samples."""
    return lambda each: float(getattr(each.scores, kind))


def compare_structures(scorer: Scorer, searches: Sequence[StructureSearch]) -> Comparison:
    """Choose a model for each purpose among the candidates of all structures.

    Simulation: the lowest error of simulations of held-out samples; of the models that are as good,
    the lowest BIC, of one-step errors where these are white, else of simulation errors.
    Prediction: the same with one-step errors on held-out samples.  Modes: the lowest BIC of models
    with poles.  Without an input there is no simulation.

    Raises NoModelError when no structure has a candidate.
    """
    candidates = [each for search in searches for each in search.candidates]
    if not candidates:
        raise NoModelError("the record is too short for a model of any structure")
    scorer.remember(candidates)
    if not scorer.has_input:
        prediction, about_prediction = _for_prediction(scorer, candidates)
        modes, about_modes = _for_modes(candidates)
        choices = (
            Choice("prediction", prediction, "constant"),
            Choice("modes", modes, "constant"),
        )
        return Comparison(choices, tuple(candidates), (about_prediction, about_modes))
    level, about_level = decide_level(
        min(each.scores.simulation for each in candidates),
        min(each.scores.fitted_level for each in candidates),
        CLEAR_GAIN,
    )
    score = score_of(kind_of("simulation", level))
    for finalist in _finalists(scorer, candidates, score):
        candidates.extend(refine_orders(scorer, finalist, score))
    candidates = list(dict.fromkeys(candidates))
    simulation, about_simulation = _for_simulation(scorer, candidates, level)
    level, about_level = _level_of(simulation, level, about_level)
    prediction, about_prediction = _for_prediction(scorer, candidates)
    modes, about_modes = _for_modes(candidates)
    decisions = [about_level, about_simulation, about_prediction, about_modes]
    if scorer.is_single:
        about = with_subspace_estimate(
            *(scorer.stretches, scorer.plan, scorer.settings.objective, simulation.name),
            *(simulation.scores, level == "state"),
        )
        decisions.append(about)
    return Comparison(
        (
            Choice("simulation", scorer.on_all_samples(simulation), level),
            Choice("prediction", scorer.on_all_samples(prediction), "constant"),
            Choice("modes", scorer.on_all_samples(modes), "constant"),
        ),
        tuple(candidates),
        tuple(decisions),
    )


def _level_of(candidate: Candidate, level: Level, decision: Decision) -> tuple[Level, Decision]:
    """The level as a state after all, where the chosen model simulates clearly better with it.

    A level passes through 1/A: where A has roots near 1, its small error in the equation is a large
    one in simulations.
    """
    constant, fitted = candidate.scores.simulation, candidate.scores.fitted_level
    if level == "state" or not fitted < (1.0 - CLEAR_GAIN) * constant:
        return level, decision
    sentence = (
        f"{candidate.name} simulates held-out samples better when their level is fitted to them "
        "with the initial state."
    )
    alternatives = (Alternative("constant", constant), Alternative("state", fitted))
    return "state", replace(decision, choice="state", alternatives=alternatives, sentence=sentence)


def _finalists(scorer: Scorer, candidates: Sequence[Candidate], score: Score) -> list[Candidate]:
    """The best of the best structures; of several inputs the best polynomials as well."""
    names = dict.fromkeys(each.structure for each in candidates)
    best = sorted(
        (min((c for c in candidates if c.structure == n), key=score) for n in names), key=score
    )
    finalists = best[:FINALISTS]
    if not scorer.is_single:
        finalists += [each for each in best[FINALISTS:] if each.polynomials is not None][:1]
    return finalists


def _for_prediction(scorer: Scorer, candidates: Sequence[Candidate]) -> tuple[Candidate, Decision]:
    best = min(candidates, key=score_of("prediction"))
    chosen, sentence = _likeliest_as_good(scorer, candidates, best, "prediction")
    return chosen, _named(
        *("structure for prediction", chosen, candidates, score_of("prediction")),
        *("one-step error on held-out samples, %", sentence),
    )


def _for_modes(candidates: Sequence[Candidate]) -> tuple[Candidate, Decision]:
    with_poles = [each for each in candidates if each.has_poles]
    modes = min(with_poles or candidates, key=lambda each: each.bic)
    return modes, _named("structure for modes", modes, candidates, lambda each: each.bic, "BIC")


def _for_simulation(
    scorer: Scorer, candidates: Sequence[Candidate], level: Level
) -> tuple[Candidate, Decision]:
    kind = kind_of("simulation", level)
    best = min(candidates, key=score_of(kind))
    chosen, sentence = (
        _under_heavy_tails(scorer, candidates, score_of(kind))
        or _by_likelihood(scorer, candidates, kind)
        or _likeliest_as_good(scorer, candidates, best, kind)
    )
    decision = _named(
        *("structure for simulation", chosen, candidates),
        *(score_of(kind), "simulation error on held-out samples, %", sentence),
    )
    return chosen, decision


def _under_heavy_tails(
    scorer: Scorer, candidates: Sequence[Candidate], score: Score
) -> tuple[Candidate, str] | None:
    """The lowest BIC, where heavy-tailed disturbances pass through the poles of the plant."""
    likeliest = min(candidates, key=lambda each: each.bic)
    lowest_score = min(map(score, candidates))
    if (
        scorer.settings.objective != "absolute"
        or not _passes_through_plant(likeliest)
        or heaviness(likeliest.model, scorer.stretches) < HEAVY
        or not score(likeliest) < MOST_UNDER_HEAVY_TAILS * lowest_score
    ):
        return None
    sentence = (
        "The disturbances are heavy-tailed and pass through the poles of the plant: simulation "
        f"errors are not robust against them. {likeliest.name} has the lowest BIC, of the absolute "
        "one-step errors."
    )
    near = _without_evidence(scorer, candidates, likeliest)
    near = [each for each in near if _passes_through_plant(each)]
    smallest = min(_fewest_failures(scorer, near), key=lambda each: (each.parameters, each.bic))
    if smallest is likeliest:
        return likeliest, sentence
    return smallest, (
        f"{sentence} {smallest.name}, against which the BIC gives no strong evidence, fails fewer "
        "checks or has fewer parameters."
    )


def _passes_through_plant(candidate: Candidate) -> bool:
    """Whether noise and input have poles in common."""
    if candidate.polynomials is None:
        return candidate.structure == "ss"
    return candidate.orders.na > 0


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
    scorer: Scorer, candidates: Sequence[Candidate], kind: Kind
) -> tuple[Candidate, str] | None:
    """The model of the lowest BIC, where nothing speaks against it.

    Maximum likelihood is efficient where the residuals are white and independent of the input, and
    unbiased under feedback.  Simulation errors contain the noise as a whole; where it is narrow in
    frequency, they differ by chance by far more than the models do.
    """
    score = score_of(kind)
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
    equal = _fewest_failures(scorer, [each for each in near if as_good(each, best, kind)])
    chosen = min(equal, key=lambda each: each.bic)
    if chosen is likeliest:
        return likeliest, sentence
    return chosen, (
        f"{sentence} {chosen.name}, against which the BIC gives no strong evidence, simulates "
        "held-out samples better or fails fewer checks."
    )


def _likeliest_as_good(
    scorer: Scorer, candidates: Sequence[Candidate], best: Candidate, kind: Kind
) -> tuple[Candidate, str]:
    """The lowest BIC of those that do as well on held-out samples as the best."""
    does = "predicts" if kind == "prediction" else "simulates"
    equal = list(candidates)
    if np.isfinite(score_of(kind)(best)):
        equal = [each for each in candidates if as_good(each, best, kind)]
    equal = _fewest_failures(scorer, equal)
    chosen = min(equal, key=lambda each: each.bic)
    reason = "has the lowest BIC of those that fail the fewest checks, and white residuals"
    if kind != "prediction" and scorer.checks(chosen).whiteness < BY_CHANCE:
        # No model of these describes the noise, so that one-step errors say little of the plant.
        chosen = min(equal, key=lambda each: each.simulation_bic)
        reason = (
            "has the lowest BIC of simulation errors of those that fail the fewest checks, whose "
            "residuals are not white"
        )
    if chosen is best:
        return best, f"{best.name} {does} held-out samples with the lowest error."
    return chosen, (
        f"{chosen.name} {does} held-out samples as well as {best.name}, within a standard error,"
        f" and {reason}."
    )


def as_good(
    candidate: Candidate, best: Candidate, kind: Kind, standard_errors: float = 1.0
) -> bool:
    """Whether a model does as well on held-out samples as another.

    Within some standard errors of the mean difference of the folds, and within 10 %.
    """

    def folds(scores: HeldOutScores) -> tuple[float, ...]:
        return tuple(getattr(scores, f"{kind}_folds"))

    score, both = score_of(kind), (folds(candidate.scores), folds(best.scores))
    if len(both[0]) != len(both[1]) or not np.isfinite(score(candidate)):
        return candidate is best
    largest = AS_GOOD
    if len(both[0]) > 1:
        deviation = float(np.std(np.subtract(*both), ddof=1))
        largest = min(standard_errors * deviation / np.sqrt(INDEPENDENT_FOLDS), AS_GOOD)
    return float(np.log(score(candidate) / score(best))) <= largest


def _named(
    subject: str,
    chosen: Candidate,
    candidates: Sequence[Candidate],
    score: Score,
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
