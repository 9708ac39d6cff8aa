"""Errors on the folds: which differences are chance, and what no choice may fall behind."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from evopem.automatic.candidates import BIC, GAIN, SIMULATION_BIC, Candidate, Score, Scorer
from evopem.automatic.cross_validation.folds import held_out_scores
from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.config.structures import REGULARISED
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.correlation import independent_share
from evopem.signals.recording import Segment

Kind = Literal["simulation", "fitted_level", "prediction"]
# Models within so many standard errors of the lowest error, and within this share, are as good.
STANDARD_ERRORS, AS_GOOD = 2.0, 0.1
# Most folds that are independent of each other, of those in all designs.
INDEPENDENT_FOLDS = 4
LARGER_BY_CHANCE = 0.025  # probability of a larger mean difference of the folds
# Share by which a simulation error must fall to overrule a choice without strong evidence.
CLEAR_GAIN = 0.02
# A difference of BIC, not divided by the samples, that is strong evidence (Kass & Raftery 1995).
STRONG = 6.0
TWICE = 2.0 * float(np.log(2.0))  # what twice the error adds to the loss of an output
# Orders of noise models without an input: AR, and ARMA of as many coefficients of each.
ALONE = (1, 2, 3, 4, 8)
# Coefficients of B of models with the same noise, of which the input may make one likelier.
BESIDE = (1, 2, 4)


def score_of(kind: Kind) -> Score:
    """The error of a candidate on held-out samples."""
    return lambda candidate: float(getattr(candidate.scores, kind))


def as_good(
    candidate: Candidate,
    best: Candidate,
    kind: Kind,
    standard_errors: float = STANDARD_ERRORS,
    share: float = AS_GOOD,
) -> bool:
    """Whether a model does as well on held-out samples as another: within some standard errors of
    the mean difference of the folds and a share, or within ``GAIN``."""
    score = score_of(kind)
    if not np.isfinite(score(candidate)):
        return candidate is best
    largest = max(GAIN, min(standard_errors * standard_error(candidate, best, kind), share))
    return float(np.log(score(candidate) / score(best))) <= largest


def all_as_good(candidates: Sequence[Candidate], best: Candidate, kind: Kind) -> list[Candidate]:
    """The models that do as well as the best one. Standard errors of few folds are uncertain: where
    a model is told apart, so are larger ones of larger errors, however much their folds differ."""
    score, equal = score_of(kind), [c for c in candidates if as_good(c, best, kind)]
    apart = [(c.parameters, score(c)) for c in candidates if c not in equal]
    return [c for c in equal if not any(p <= c.parameters and e < score(c) for p, e in apart)]


def is_clearly_better(candidate: Candidate, rival: Candidate, kind: Kind) -> bool:
    """Whether an error is lower than that of a rival by 2 % and by a standard error."""
    gain = float(np.log(score_of(kind)(rival) / score_of(kind)(candidate)))
    return gain > max(CLEAR_GAIN, standard_error(rival, candidate, kind))


def standard_error(candidate: Candidate, best: Candidate, kind: Kind) -> float:
    """Of the logarithm of the ratio of the errors of two models, from the folds; or infinite."""
    folds = [getattr(model.scores, f"{kind}_folds") for model in (candidate, best)]
    if len(folds[0]) != len(folds[1]) or len(folds[0]) < 2:
        return np.inf
    spread = float(np.std(np.subtract(*folds), ddof=1))
    return spread / float(np.sqrt(min(len(folds[0]), INDEPENDENT_FOLDS)))


def may_be_chance(candidate: Candidate, best: Candidate, kind: Kind) -> bool:
    """Whether chance of 2.5 % makes errors so much larger (Student 1908); False of one fold."""
    freedom = min(len(getattr(best.scores, f"{kind}_folds")), INDEPENDENT_FOLDS) - 1
    error = standard_error(candidate, best, kind)
    logarithm = np.log(score_of(kind)(candidate) / score_of(kind)(best))
    return bool(np.isfinite(error) and logarithm < -stdtrit(freedom, LARGER_BY_CHANCE) * error)


def coloured_bic(scorer: Scorer, candidate: Candidate) -> Score:
    """The BIC of simulation errors that count as the independent ones they are (Bartlett 1946)."""
    stretch, samples = max(scorer.stretches, key=lambda s: s.samples), scorer.independent_samples
    e = errors_simulated_on(candidate.model, None, stretch, True, scorer.absolute)
    share = min(map(independent_share, e.T))

    def score(rival: Candidate) -> float:
        loss = rival.simulation_bic - scorer.penalty(rival.parameters)
        penalty = rival.parameters * np.log(max(share * samples, 2.0)) / samples
        return float(share * loss + penalty)

    return score if np.isfinite(share) else SIMULATION_BIC


def parametric(candidates: Sequence[Candidate]) -> Sequence[Candidate]:
    """The candidates but regularised responses, which have to be clearly better than the others."""
    return [c for c in candidates if c.structure not in REGULARISED] or candidates


def simplest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """A gain, output-error models of first and second order, the likeliest ARX model and the
    regularised responses of all lengths: what a chosen model must not fall behind."""
    kept = [c for c in candidates if (c.structure, c.order) in (("fir", 1), ("oe", 1), ("oe", 2))]
    kept += sorted((c for c in candidates if c.structure == "arx"), key=BIC)[:1]
    return kept + [c for c in candidates if c.structure in REGULARISED]


def not_far_behind(
    scorer: Scorer, candidates: Sequence[Candidate], scored: Sequence[Candidate]
) -> list[Candidate]:
    """Gains, and those that simulate what they are fitted to with less than twice the error of
    the best of others, which are scored."""

    def loss(candidate: Candidate) -> float:
        return candidate.simulation_bic - scorer.penalty(candidate.parameters)

    most = loss(min(scored, key=score_of("fitted_level"))) + TWICE if scored else np.inf
    return [c for c in candidates if c.structure == "fir" or not loss(c) > most]


def gain_of_nothing(
    scorer: Scorer, candidates: Sequence[Candidate], kind: Kind, chosen: Candidate
) -> tuple[Candidate, str] | None:
    """A gain, where the response of a chosen model to the inputs does not differ from zero: it does
    not simulate held-out samples clearly better than a constant, and no candidate has strong
    evidence against all noise models without an input, beyond what the likeliest of as many has by
    chance, nor has the likeliest of these with an input."""
    gain = next((c for c in simplest(candidates) if c.structure == "fir" and c.is_scored), None)
    model = gain.polynomials if gain is not None else None
    if gain is None or model is None:
        return None

    def constants_of(parts: Sequence[Sequence[Segment]]) -> list[PolynomialModel]:
        centre = np.median if scorer.absolute else np.mean
        levels = [float(centre(np.concatenate([s.output for s in part]))) for part in parts]
        nothing = tuple(map(np.zeros_like, model.B))
        return [replace(model, B=nothing, level=level) for level in levels]

    of_constant = held_out_scores(scorer.stretches, scorer.plan, constants_of, scorer.absolute)
    if is_clearly_better(chosen, replace(gain, scores=of_constant), kind):
        return None
    outputs = [Segment(s.inputs[:, :0], s.outputs, s.recording) for s in scorer.stretches]
    alone = Scorer(outputs, scorer.plan, scorer.settings)
    of_noise = [Orders(na=n, nc=nc) for n in ALONE for nc in (0, n)]
    noise = [alone.candidate("arma", orders, scored=False) for orders in of_noise]
    likeliest = min((model for model in noise if model is not None), key=BIC, default=None)
    if likeliest is None:
        return None
    o, nk = likeliest.orders, gain.orders.nk
    beside = [Orders(na=o.na, nb=(n,) * len(nk), nc=o.nc, nk=nk) for n in BESIDE]
    driven = [scorer.candidate(orders.structure, orders, scored=False) for orders in beside]
    rivals = [*candidates, *filter(None, driven)]
    evidence = scorer.independent_samples * (likeliest.bic - min(map(BIC, rivals)))
    if evidence > STRONG + 2.0 * np.log(len(candidates)):
        return None
    return gain, (
        f"{chosen.name} does not simulate held-out samples clearly better than a constant, and no"
        " model is clearly likelier than noise alone: the input explains nothing that differs"
        f" from zero, and {gain.name} stands for its response."
    )


def never_behind(
    candidates: Sequence[Candidate],
    kind: Kind,
    chosen: Candidate,
    sentence: str,
    failures: Callable[[Candidate], int],
) -> tuple[Candidate, str]:
    """The best of the simplest models, where it does clearly better than what was chosen. One with
    more ``failures`` of checks only where the choice would not count as as good: models whose noise
    moves the plant's states know more of them than others where a simulation begins."""
    score = score_of(kind)
    best = min([c for c in simplest(candidates) if c.is_scored], key=score, default=chosen)
    if best is chosen or not is_clearly_better(best, chosen, kind):
        return chosen, sentence
    near = np.log(score(chosen) / score(best)) <= AS_GOOD
    if near and failures(best) > failures(chosen):
        return chosen, sentence
    return best, (
        f"{best.name}, one of the simplest models, simulates held-out samples with"
        f" {score(best):.3g} % instead of the {score(chosen):.3g} % of {chosen.name}: better by"
        " more than a standard error."
    )


def regularised_unless_worse(
    candidates: Sequence[Candidate], kind: Kind, chosen: Candidate, sentence: str
) -> tuple[Candidate, str]:
    """The best regularised response, unless what was chosen does clearly better. Where no linear
    model describes the system, none has its orders.  Of one fold 2 % are clear."""
    responses = [c for c in candidates if c.structure in REGULARISED and c.is_scored]
    best, score = min(responses, key=score_of(kind), default=chosen), score_of(kind)
    most = max(CLEAR_GAIN, np.nan_to_num(standard_error(chosen, best, kind), posinf=0.0))
    if best is chosen or np.log(score(best) / score(chosen)) > most:
        return chosen, sentence
    return best, (
        "The sizes of residuals follow the input, which points to a nonlinear system: orders of a"
        f" linear model mean little. {best.name} has none, and simulates not clearly worse"
        f" than {chosen.name}."
    )
