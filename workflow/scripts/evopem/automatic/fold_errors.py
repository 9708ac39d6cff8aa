"""Errors on the folds: which differences are chance, and what no choice may fall behind."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from evopem.automatic.candidates import BIC, SIMULATION_BIC, Candidate, Score
from evopem.config.structures import REGULARISED

Kind = Literal["simulation", "fitted_level", "prediction"]
# Models within so many standard errors of the lowest error, and within this share, are as good.
STANDARD_ERRORS, AS_GOOD = 2.0, 0.1
# Folds that are independent of each other, of those in all designs.
INDEPENDENT_FOLDS = 4
# Share by which a simulation error must fall to overrule a choice without strong evidence.
CLEAR_GAIN = 0.02


def score_of(kind: Kind) -> Score:
    """The error of a candidate on held-out samples."""
    return lambda candidate: float(getattr(candidate.scores, kind))


def as_good(
    candidate: Candidate, best: Candidate, kind: Kind, standard_errors: float = STANDARD_ERRORS
) -> bool:
    """Whether a model does as well on held-out samples as another.

    Within some standard errors of the mean difference of the folds, and within 10 %.
    """
    score = score_of(kind)
    if not np.isfinite(score(candidate)):
        return candidate is best
    largest = min(standard_errors * standard_error(candidate, best, kind), AS_GOOD)
    return float(np.log(score(candidate) / score(best))) <= largest


def standard_error(candidate: Candidate, best: Candidate, kind: Kind) -> float:
    """Of the logarithm of the ratio of the errors of two models, from the folds; or infinite."""
    folds = [getattr(model.scores, f"{kind}_folds") for model in (candidate, best)]
    if len(folds[0]) != len(folds[1]) or len(folds[0]) < 2:
        return np.inf
    return float(np.std(np.subtract(*folds), ddof=1)) / float(np.sqrt(INDEPENDENT_FOLDS))


def parametric(candidates: Sequence[Candidate]) -> Sequence[Candidate]:
    """The candidates but regularised responses, which have to be clearly better than the others."""
    return [c for c in candidates if c.structure not in REGULARISED] or candidates


def simplest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """A gain, output-error models of first and second order, the likeliest ARX model and the
    likeliest regularised response: what a chosen model must not fall behind."""
    kept = [c for c in candidates if (c.structure, c.order) in (("fir", 1), ("oe", 1), ("oe", 2))]
    # One-step errors of responses of different lengths begin at different samples.
    criteria = {"arx": BIC, **dict.fromkeys(REGULARISED, SIMULATION_BIC)}
    for structure, criterion in criteria.items():
        kept += sorted((c for c in candidates if c.structure == structure), key=criterion)[:1]
    return kept


def never_behind(
    candidates: Sequence[Candidate],
    kind: Kind,
    chosen: Candidate,
    sentence: str,
    failures: Callable[[Candidate], int],
) -> tuple[Candidate, str]:
    """The best of the simplest models, where it does clearly better than what was chosen.

    One with more ``failures`` of checks only where the choice would not count as as good: models
    whose noise moves the plant's states know more of them than others where a simulation begins.
    """
    score = score_of(kind)
    best = min(simplest(candidates), key=score, default=chosen)
    gain = float(np.log(score(chosen) / score(best)))
    if best is chosen or not gain > max(CLEAR_GAIN, standard_error(chosen, best, kind)):
        return chosen, sentence
    if gain <= AS_GOOD and failures(best) > failures(chosen):
        return chosen, sentence
    return best, (
        f"{best.name}, one of the simplest models, simulates held-out samples with"
        f" {score(best):.3g} % instead of the {score(chosen):.3g} % of {chosen.name}: better by"
        " more than a standard error."
    )
