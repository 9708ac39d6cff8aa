"""Choice of state-space models: level, form with weighting of the outputs, and order.

Errors on held-out samples decide between models whose errors differ by more than these errors vary
from fold to fold.  Between all others the likelihood does, which uses every sample at once; for
simulation between models of one form, since it is that of one-step errors, which a form with a
better noise model lowers without a better plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.level_decision import Level, decide_level
from evopem.automatic.variant_search import Variant, VariantSearch
from evopem.config.settings import AutomaticSettings

Array = NDArray[np.float64]
Purpose = Literal["simulation", "prediction"]
Kind = Literal["simulation", "free_level", "prediction"]

# Models whose errors are within this share of the lowest, or within one standard error of it over
# at least so many folds, are equally good by held-out samples.
MARGIN, FEWEST_FOLDS = 0.05, 3
# A level that is fitted to held-out samples, too, has to gain this share.
CLEAR_GAIN = 0.05


@dataclass(frozen=True)
class ModelChoice:
    """The model for one purpose.

    Attributes
    ----------
    purpose : {"simulation", "prediction"}
    variant : Variant
    order : int
    level : {"constant", "state"}
        Whether simulations of other samples have the level of the estimation samples, or fit one
        along with the initial state.
    """

    purpose: Purpose
    variant: Variant
    order: int
    level: Level


@dataclass(frozen=True)
class StateSpaceChoice:
    """The models that are estimated, and the decisions that led to them.

    Attributes
    ----------
    model : ModelChoice
        For the purpose of the configuration.
    other : ModelChoice, optional
        For the other one of simulation and prediction; None without inputs.
    decisions : tuple of Decision
    """

    model: ModelChoice
    other: ModelChoice | None
    decisions: tuple[Decision, ...]


def choose(searches: Sequence[VariantSearch], choices: AutomaticSettings) -> StateSpaceChoice:
    """Choose variant and order for each purpose.

    Parameters
    ----------
    searches : sequence of VariantSearch
    choices : AutomaticSettings

    Raises
    ------
    ValueError
        When no variant has a model.
    """
    possible = [each for each in searches if each.orders]
    if not possible:
        raise ValueError("no model could be estimated")
    has_input = any(np.isfinite(each.simulation).any() for each in possible) or any(
        each.variant.form == "ss_oe" for each in possible
    )
    if not has_input:
        model, decisions = _best_for("prediction", possible, "constant")
        return StateSpaceChoice(model, None, decisions)
    level, about_level = decide_level(
        min(_lowest(each, "simulation") for each in possible),
        min(_lowest(each, "free_level") for each in possible),
        CLEAR_GAIN,
    )
    found = {
        "simulation": _best_for("simulation", possible, level),
        "prediction": _best_for("prediction", possible, level),
    }
    own, other = ("simulation", "prediction")
    if choices.purpose == "prediction":
        own, other = other, own
    decisions = (about_level, *found[own][1], *found[other][1])
    return StateSpaceChoice(found[own][0], found[other][0], decisions)


@dataclass(frozen=True)
class _Candidate:
    """One order of one variant, with what it is chosen by.

    Attributes
    ----------
    score : float
        Error on held-out samples, infinite where there is none.
    of_folds : (folds,) array
        The same on each fold.
    """

    variant: Variant
    order: int
    score: float
    of_folds: Array
    coloured_bic: float


def _best_for(
    purpose: Purpose, searches: Sequence[VariantSearch], level: Level
) -> tuple[ModelChoice, tuple[Decision, ...]]:
    """The most likely of the models that held-out samples cannot tell from the best one.

    Of its form, for simulation.
    """
    kind = scores_of(purpose, level)
    candidates = _candidates(searches, kind)
    best = min(candidates, key=lambda each: each.score)
    near = [each for each in candidates if _as_good(each, best)]
    # Where no score is known, the likelihood alone decides.
    if purpose == "simulation" and np.isfinite(best.score):
        near = [each for each in near if each.variant.form == best.variant.form]
    own = min(near, key=lambda each: each.coloured_bic)
    what = "one-step error" if purpose == "prediction" else "simulation error"
    unit = f"{what} on held-out samples, %"
    forms = tuple(Alternative(each.variant.name, _lowest(each, kind)) for each in searches)
    searched = next(each for each in searches if each.variant == own.variant)
    orders = tuple(map(Alternative, map(str, searched.orders), getattr(searched, kind)))
    models = "models of this form" if purpose == "simulation" else "models"
    reason = (
        f"{len(near)} {models} are as good on held-out samples, within {100 * MARGIN:g} % of the"
        " lowest error or its standard error over the folds. The most likely one of them is taken,"
        " by BIC with the colour of the errors."
        if len(near) > 1
        else f"All other {models} are worse on held-out samples by more than the standard error."
    )
    choice = ModelChoice(purpose, own.variant, own.order, level)
    return choice, (
        Decision(f"form and weighting for {purpose}", own.variant.name, forms, unit, reason),
        Decision(
            *(f"order for {purpose}", str(own.order), orders, unit),
            "Decided along with the form, up to the order of the lowest BIC,"
            f" {searched.orders[-1]}.",
        ),
    )


def scores_of(purpose: Purpose, level: Level) -> Kind:
    """The errors on held-out samples that decide for a purpose."""
    if purpose == "prediction":
        return "prediction"
    return "free_level" if level == "state" else "simulation"


def _candidates(searches: Sequence[VariantSearch], kind: Kind) -> list[_Candidate]:
    return [
        _Candidate(
            search.variant,
            order,
            score if np.isfinite(score) else np.inf,
            np.array([getattr(fold, kind)[place] for fold in search.folds]),
            search.coloured_bic[place],
        )
        for search in searches
        for place, (order, score) in enumerate(
            zip(search.orders, getattr(search, kind), strict=True)
        )
    ]


def _as_good(candidate: _Candidate, best: _Candidate) -> bool:
    """Whether held-out samples cannot tell a model from the best one.

    The errors of both are compared on the same folds, which differ more from each other than the
    models do (the rule of one standard error: Breiman, Friedman, Olshen & Stone 1984, section
    3.4.3).
    """
    if candidate.score <= (1.0 + MARGIN) * best.score:
        return True
    folds = len(best.of_folds)
    if folds < FEWEST_FOLDS or not np.isfinite(candidate.score):
        return False
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(candidate.of_folds / best.of_folds)
        error = float(np.std(ratios, ddof=1) / np.sqrt(folds))
        return bool(np.log(candidate.score / best.score) <= error)


def _lowest(search: VariantSearch, kind: Kind) -> float:
    """The lowest score of a variant; infinite where none is known."""
    scores = np.array(getattr(search, kind), dtype=float)
    known = scores[np.isfinite(scores)]
    return float(known.min()) if known.size else np.inf
