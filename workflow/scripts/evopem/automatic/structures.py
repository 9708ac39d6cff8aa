"""The choice between structures, for each purpose."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np

from evopem.automatic.candidate_checks import BY_CHANCE
from evopem.automatic.candidates import (
    BIC,
    SIMULATION_BIC,
    Candidate,
    Score,
    Scorer,
    StructureSearch,
)
from evopem.automatic.cross_validation.simulation import prediction_errors
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fold_errors import (
    CLEAR_GAIN,
    STRONG,
    Kind,
    all_as_good,
    as_good,
    coloured_bic,
    gain_of_nothing,
    may_be_chance,
    never_behind,
    not_far_behind,
    parametric,
    regularised_unless_worse,
    score_of,
    simplest,
)
from evopem.automatic.orders import refine_orders
from evopem.automatic.preparation.disturbance import follow_input
from evopem.automatic.revision_orders import with_noise_models
from evopem.config.settings import Purpose
from evopem.errors import NoModelError
from evopem.models.orders import changed
from evopem.models.polynomial import state_space_of
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT
from evopem.validation.checks.roots import INSIDE_BOUND
from evopem.validation.model_class import acts_at_once, feedback_test

Level = Literal["constant", "state"]
Likely = tuple[Candidate, str] | None  # chosen for its likelihood, and why
# Largest held-out simulation errors, against the lowest ones, of a model that is taken for its
# likelihood: where its residuals are valid, and where all its checks hold or chance allows it.
MOST_WHEN_VALID, MOST_WHEN_ALL_HOLD = 1.25, 3.0
FINALISTS, NOISES = 2, 4  # structures, and noise models, from the smallest, of the best plant
# About so many likely delays of an input are tried with the orders of a finalist.  A difference of
# BIC, not divided by the samples, is evidence for another one (Kass & Raftery 1995).
MOST_DELAYS, POSITIVE = 12, 2.0
# One-step errors over simulation errors, on held-out samples, that refute a noise model, and what
# errors that are so much larger add to the loss of an output.
HARMFUL, HALF_MORE = 1.5, 2.0 * float(np.log(1.5))
# Share of an input that past residuals explain, below which a missed nonlinearity may be the cause.
WEAK = 0.05
# The largest logarithm of a ratio of errors that standard errors of few folds may call chance.
MOST_BY_CHANCE = 1.0


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
        return "prediction" if self.purpose == "prediction" else _kind_of(self.level)


@dataclass(frozen=True)
class Comparison:
    """The models for all purposes, and what was decided on the way."""

    choices: tuple[Choice, ...]
    candidates: tuple[Candidate, ...]
    decisions: tuple[Decision, ...]

    def choice(self, purpose: Purpose) -> Choice:
        """The choice for a purpose; ``auto``, and what there is none for, is the first one."""
        return next((c for c in self.choices if c.purpose == purpose), self.choices[0])


def rivals_of(scorer: Scorer, choice: Choice, comparison: Comparison) -> tuple[Candidate, ...]:
    """The compared model of a choice, and those that its bands are to cover: as good on held-out
    samples as the best one, also where they are larger, or with no BIC clearly against them."""
    known, kind = comparison.candidates, choice.kind
    of_choice = next((c for c in known if c.name == choice.candidate.name), choice.candidate)
    best = min(known, key=score_of(kind))
    equal = [candidate for candidate in known if as_good(candidate, best, kind)]
    likely = _without_evidence(scorer, known, BIC, SIMULATION_BIC)
    return tuple(dict.fromkeys([of_choice, *equal, *likely]))


def _kind_of(level: Level) -> Kind:
    return "fitted_level" if level == "state" else "simulation"


def compare_structures(scorer: Scorer, searches: Sequence[StructureSearch]) -> Comparison:
    """Choose a model for each purpose among the candidates of all structures.

    Simulation: of the models that simulate held-out samples as well as the best one, and against
    which the BIC gives no strong evidence, the smallest one whose checks hold; the BIC is that of
    one-step errors where these are white, else of simulation errors.  Prediction: the same with
    one-step errors on held-out samples.  Modes: the lowest BIC of models with poles.  Without an
    input there is no simulation, by which :func:`_with_valid_noise` else leaves models out.  Raises
    NoModelError when no structure has a candidate.
    """
    eligible = [candidate for search in searches for candidate in _eligible(search)]
    every = [candidate for search in searches for candidate in search.candidates]
    if not every:
        if all(search.too_short for search in searches):
            raise NoModelError(
                f"the record is too short for a model of any structure: {scorer.samples} samples "
                f"for estimation carry at most {scorer.most_parameters} coefficients of polynomials"
            )
        raise NoModelError("no model of any structure was found, or rounding spoils each of them")
    scorer.remember(every)
    every += _with_noise(scorer, every)
    choices, decisions = [], []
    # Where the likeliest model is valid, nothing that only simulates better is chosen.
    for by_simulation in (False, True)[: 1 + scorer.has_input]:
        criteria = (BIC, SIMULATION_BIC) if by_simulation else (BIC,)
        scored = scorer.with_scores(parametric(eligible), criteria)
        for candidate in not_far_behind(scorer, simplest(eligible), scored):
            scorer.with_own_scores(candidate)
        candidates = every = [*dict.fromkeys(map(scorer.known, [*scored, *eligible, *every]))]
        if scorer.has_input:
            level, about_level = _level_of(every)
            kind = _kind_of(level)
            for criterion in (score_of(kind), BIC) if by_simulation else (BIC,):
                for finalist in _finalists(every, criterion):
                    every += refine_orders(scorer, _at_likely_delay(scorer, finalist), criterion)
            # What was refined may have been searched, and scored only then.
            candidates, refuted = _with_valid_noise([*dict.fromkeys(map(scorer.known, every))])
            is_fed_back, likely = _likely(scorer, candidates, kind)
            if likely:
                break
    if scorer.has_input:
        simulation, about = _for_simulation(scorer, candidates, kind, is_fed_back, likely)
        if level == "constant":
            # A level passes through 1/A: where A has roots near 1, its small error in the equation
            # is a large one in simulations.
            level, of_chosen = _level_of([simulation])
            about_level = of_chosen if level == "state" else about_level
        choices.append(Choice("simulation", scorer.on_all_samples(simulation), level))
        decisions += [about_level, *refuted, about]
    searched = parametric(candidates)
    prediction, sentence = _smallest_as_good(scorer, searched, "prediction")
    choices.append(Choice("prediction", scorer.on_all_samples(prediction), "constant"))
    modes = scorer.with_own_scores(min([c for c in searched if c.has_poles] or searched, key=BIC))
    choices.append(Choice("modes", scorer.on_all_samples(modes), "constant"))
    given = "structure for prediction", prediction, candidates, score_of("prediction")
    decisions += [
        _named(*given, "one-step error on held-out samples, %", sentence),
        _named("structure for modes", modes, candidates, BIC, "BIC"),
    ]
    return Comparison(tuple(choices), tuple(candidates), tuple(decisions))


def _eligible(search: StructureSearch) -> Sequence[Candidate]:
    """The candidates of a structure that may be chosen. Errors that are not white raise the number
    of states of the lowest BIC, but never lower it."""
    known = search.candidates
    if not known or known[0].polynomials is not None:
        return known
    return [candidate for candidate in known if candidate.order <= min(known, key=BIC).order]


def _level_of(candidates: Sequence[Candidate]) -> tuple[Level, Decision]:
    """A level of held-out samples of their own, where the best simulations gain clearly by it."""
    constant = min(candidate.scores.simulation for candidate in candidates)
    fitted = min(candidate.scores.fitted_level for candidate in candidates)
    level: Level = "state" if fitted < (1.0 - CLEAR_GAIN) * constant else "constant"
    drifts = "The level drifts: held-out samples are simulated better with a level fitted to them."
    holds = "The level of the estimation samples holds for held-out samples as well."
    sentence = drifts if level == "state" else holds
    alternatives = (Alternative("constant", constant), Alternative("state", fitted))
    criterion = "lowest simulation error on held-out samples, %"
    return level, Decision("level", level, alternatives, criterion, sentence)


def _with_valid_noise(candidates: list[Candidate]) -> tuple[list[Candidate], list[Decision]]:
    """The models whose noise model does not make errors on held-out samples half as large again.
    All where there is none.  Many coefficients, with roots of C at the bound, fit the noise of a
    short record alone."""
    kept = [c for c in candidates if not c.scores.prediction > HARMFUL * c.scores.simulation]
    if len(kept) in (0, len(candidates)):
        return candidates, []
    left_out = [(c.name, c.scores) for c in candidates if c not in kept]
    refuted = tuple(
        Alternative(name, s.prediction / s.simulation if s.simulation else np.inf)
        for name, s in left_out
    )
    sentence = (
        "Left out for every purpose: on held-out samples their one-step errors are more than"
        f" {HARMFUL:g} times those of simulation, so that their noise models fit noise alone."
    )
    criterion = "one-step error over simulation error on held-out samples"
    count = f"{len(refuted)} of {len(candidates)}"
    return kept, [Decision("refuted noise models", count, refuted, criterion, sentence)]


def _with_noise(scorer: Scorer, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best output-error model with noise models, whose orders no path from small ones comes to:
    without feedback its plant is consistent whatever the noise is (Ljung 1999, section 8.4)."""
    plants = [c for c in candidates if c.structure == "oe" and scorer.limits.allow("bj", None)]
    begun = with_noise_models(scorer, min(plants, key=SIMULATION_BIC)) if plants else iter(())
    fits = (
        scorer.candidate("bj", noisy.orders, [noisy.polynomials], False, False, True)
        for _, noisy in islice(begun, NOISES)
        if noisy.polynomials is not None
    )
    return list(filter(None, fits))


def _finalists(candidates: Sequence[Candidate], score: Score) -> list[Candidate]:
    """The best of the best structures of polynomials."""
    polynomials = [c for c in parametric(candidates) if c.polynomials is not None]
    best = {c.structure: c for c in sorted(polynomials, key=score, reverse=True)}
    return sorted(best.values(), key=score)[:FINALISTS]


def _at_likely_delay(scorer: Scorer, start: Candidate) -> Candidate:
    """A candidate, or the same with another likely delay of an input where the BIC is lower. The
    BIC of coloured residuals tells no delay."""
    is_white = scorer.checks(start).whiteness >= BY_CHANCE
    best, models = start, [start.polynomials] if start.polynomials is not None else []
    for place, likely in enumerate(scorer.likely if is_white else ()):
        for delay in likely[:: 1 + len(likely) // MOST_DELAYS]:
            orders = changed(start.orders, place, nk=delay - start.orders.nk[place])
            moved = scorer.candidate(start.structure, orders, models, False, False)
            best = min(best, moved or start, key=BIC)
    return best if start.bic - best.bic > POSITIVE / scorer.independent_samples else start


def _for_simulation(
    scorer: Scorer, candidates: Sequence[Candidate], kind: Kind, is_fed_back: bool, likely: Likely
) -> tuple[Candidate, Decision]:
    kept = candidates if likely or is_fed_back else _that_simulate(scorer, candidates)
    choice = likely or _smallest_as_good(scorer, parametric(kept), kind)
    # Under feedback models without noise have the lowest simulation errors, and a wrong response.
    if not (is_fed_back and likely):
        choice = never_behind(kept, kind, *choice, lambda c: len(scorer.checks(c).failed))
    if not is_fed_back and _misses_response(scorer, min(parametric(candidates), key=BIC)):
        choice = regularised_unless_worse(kept, kind, *choice)
    chosen, sentence = gain_of_nothing(scorer, candidates, kind, choice[0]) or choice
    subject, criterion = "structure for simulation", "simulation error on held-out samples, %"
    return chosen, _named(subject, chosen, candidates, score_of(kind), criterion, sentence)


def _likely(scorer: Scorer, candidates: Sequence[Candidate], kind: Kind) -> tuple[bool, Likely]:
    """Whether the input is fed back, and what is chosen for its likelihood."""
    searched, lowest = parametric(candidates), min(candidates, key=score_of(kind))
    is_fed_back = _is_fed_back(scorer, min(searched, key=BIC))
    return is_fed_back, _by_likelihood(scorer, searched, kind, lowest, is_fed_back)


def _that_simulate(scorer: Scorer, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The models that simulate what they are fitted to about as well as the best of those with
    scores. Others need outputs now and then, as before held-out samples; no simulation has them."""
    outputs = scorer.stretches[0].outputs.shape[1]
    lowest = min((c.simulation_bic for c in candidates if c.is_scored), default=np.inf)
    return [c for c in candidates if not c.simulation_bic > lowest + outputs * HALF_MORE]


def _by_likelihood(
    scorer: Scorer, candidates: Sequence[Candidate], kind: Kind, lowest: Candidate, fed_back: bool
) -> Likely:
    """A model by its likelihood, where it is valid; ``lowest`` simulates best of all. Maximum
    likelihood is efficient where the residuals are white and independent of the input, and unbiased
    where the input depends on them.  Simulation errors contain the noise as a whole; where it is
    narrow in frequency, they differ by chance by far more than the models do."""
    score, near = score_of(kind), _without_evidence(scorer, candidates, BIC)
    # Of a root at the bound the largest likelihood is no inner one.
    inside = [c for c in near if INSIDE_BOUND not in scorer.checks(c).failed]
    if not inside:
        return None
    likeliest = min(inside, key=BIC)
    checks, likeliest = scorer.checks(likeliest), scorer.with_own_scores(likeliest)
    inner = " inside the stability bound" if len(inside) < len(near) else ""
    near = list(map(scorer.known, inside))
    # Feedback itself is what residuals depend on the input by; it is no fault of the model.
    expected = {INDEPENDENT_OF_INPUT} if fed_back else set()
    may_be_worse = expected.issuperset(checks.failed) or may_be_chance(likeliest, lowest, kind)
    largest = MOST_WHEN_ALL_HOLD if may_be_worse else MOST_WHEN_VALID
    independent = INDEPENDENT_OF_INPUT not in checks.failed
    holds = score(likeliest) / score(lowest) < largest and checks.whiteness >= BY_CHANCE
    if not (holds and (independent or fed_back)):
        return None
    best = min(near, key=score)
    equal = [candidate for candidate in near if as_good(candidate, best, kind)]
    chosen = _smallest(scorer, equal, BIC)
    sentence = (
        f"{likeliest.name} has the lowest BIC{inner}, and its residuals are white and "
        f"{'independent of the input' if independent else 'fed back to the input'}."
    )
    if chosen is not likeliest:
        sentence += (
            f" {chosen.name}, against which the BIC gives no strong evidence, simulates held-out "
            "samples as well, and fails fewer checks or has fewer parameters."
        )
    return chosen, sentence


def _is_fed_back(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether the input depends on past residuals; a missed nonlinearity can look so, weakly."""
    errors = [prediction_errors(candidate.model, stretch) for stretch in scorer.stretches]
    parts = [
        (e, s.inputs[s.samples - len(e) :]) for e, s in zip(errors, scorer.stretches, strict=True)
    ]
    feedback = feedback_test(parts, acts_at_once(state_space_of(candidate.model)))
    weak = feedback.share < WEAK and _misses_response(scorer, candidate)
    return feedback.p_value < BY_CHANCE and not weak


def _misses_response(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether the sizes of the residuals of a model follow changes of the inputs."""
    stretch = max(scorer.stretches, key=lambda stretch: stretch.samples)
    return any(follow_input(stretch, e) for e in prediction_errors(candidate.model, stretch).T)


def _without_evidence(
    scorer: Scorer, candidates: Sequence[Candidate], *criteria: Score
) -> list[Candidate]:
    """The models against which one of some criteria gives no strong evidence."""
    left = []
    for criterion in criteria:
        most = min(map(criterion, candidates)) + STRONG / scorer.independent_samples
        left += [candidate for candidate in candidates if criterion(candidate) < most]
    return list(dict.fromkeys(left))


def _smallest(scorer: Scorer, candidates: Sequence[Candidate], criterion: Score) -> Candidate:
    """The fewest failed checks, then parameters, of those without strong evidence against them. Of
    as many parameters polynomials, whose orders may be refined one by one."""

    def rank(c: Candidate) -> tuple[float, ...]:
        return len(scorer.checks(c).failed), c.parameters, c.polynomials is None, criterion(c)

    return min(_without_evidence(scorer, candidates, criterion), key=rank)


def _smallest_as_good(
    scorer: Scorer, candidates: Sequence[Candidate], kind: Kind
) -> tuple[Candidate, str]:
    """The smallest of those that do as well on held-out samples as the best."""
    best = min(candidates, key=score_of(kind))
    does = "predicts" if kind == "prediction" else "simulates"
    errors, equal = "one-step", list(candidates)
    if np.isfinite(score_of(kind)(best)):
        equal = all_as_good(candidates, best, kind)
    if kind == "prediction":
        chosen = _smallest(scorer, equal, BIC)
    else:
        # Where the folds differ much, errors within one standard error say little: likelihoods do.
        near = [c for c in candidates if c in equal or as_good(c, best, kind, 1.0, MOST_BY_CHANCE)]
        chosen = _smallest(scorer, near, BIC)
        checks = scorer.checks(chosen)
        if checks.whiteness < BY_CHANCE or INDEPENDENT_OF_INPUT in checks.failed:
            # No model of these describes noise or plant: one-step errors say little of the latter.
            # Poles at the bound draw slow waves as long as a held-out block, and grow beyond it.
            inside = [c for c in equal if INSIDE_BOUND not in scorer.checks(c).failed] or equal
            errors, likeliest = "simulation", min(inside, key=SIMULATION_BIC)
            chosen = _smallest(scorer, inside, coloured_bic(scorer, likeliest))
    if chosen is best:
        return best, f"{best.name} {does} held-out samples with the lowest error."
    within = "two standard errors" if chosen in equal else "one standard error"
    return chosen, (
        f"{chosen.name} {does} held-out samples as well as {best.name}, within {within}:"
        " it fails the fewest checks, and is the smallest, of those against which the BIC of "
        f"{errors} errors gives no strong evidence."
    )


def _named(
    subject: str,
    chosen: Candidate,
    candidates: Sequence[Candidate],
    score: Score,
    criterion: str,
    sentence: str = "",
) -> Decision:
    best = {c.structure: c for c in [*sorted(candidates, key=score, reverse=True), chosen]}
    alternatives = tuple(Alternative(c.name, score(c)) for c in sorted(best.values(), key=score))
    sentence = sentence or f"{chosen.name} has the lowest score."
    return Decision(subject, chosen.name, alternatives, criterion, sentence)
