"""Acting on failed checks of a model of several channels after its global search.

Remedies are the models of larger orders and of other forms that the search over orders has left,
with their errors on held-out samples, and earlier delays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from evopem.automatic.record import Trial
from evopem.automatic.searched_forms import SearchedForms
from evopem.automatic.state_space_choice import ModelChoice
from evopem.automatic.state_space_chosen import ChosenModel
from evopem.automatic.trials import DELAY, TOLERATED, Attempt, Budget, tried_in_turn
from evopem.automatic.variant_search import VariantSearch
from evopem.config.structures import OF_SIMULATION
from evopem.errors import InputError
from evopem.estimation.multi_input.order_limits import OrderLimits
from evopem.models.state_space import StateSpaceModel
from evopem.validation.checks.check import SIGNIFICANCE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import INSIDE_BOUND
from evopem.validation.checks.state_space import coloured_outputs, dependent_pairs
from evopem.validation.multichannel import validate_multichannel
from evopem.validation.residual_tests import correlation_with_input

# Checks that hold or fail by the residuals and roots of a model.
OF_RESIDUALS = (DELAY, WHITE, INDEPENDENT_OF_INPUT, INSIDE_BOUND)


@dataclass(frozen=True)
class Judgement:
    """What the checks say of a model on its estimation samples.

    Attributes
    ----------
    failed : frozenset of str
    whiteness : float
        Lowest p-value of the outputs.
    correlation : float
        Largest cross-correlation of residuals and an input, in its 95 % bounds.
    delays : tuple of int
        The delays, or earlier ones where residuals depend on samples of an input before them.
    """

    failed: frozenset[str]
    whiteness: float
    correlation: float
    delays: tuple[int, ...]


def judge(model: StateSpaceModel, at_bound: bool, forms: SearchedForms) -> Judgement:
    """The checks of a model by its residuals of the estimation samples.

    Parameters
    ----------
    model : StateSpaceModel
        With its noise model.
    at_bound : bool
        Whether a root lies at the largest radius allowed.
    forms : SearchedForms
        Behind it.
    """
    estimation = forms.estimation
    validation, _ = validate_multichannel(model, estimation, fitted=model.order)
    delays = _earlier_delays(model, forms)
    failed = {
        DELAY: delays != forms.delays,
        WHITE: bool(np.any(model.K)) and bool(coloured_outputs(validation)),
        INDEPENDENT_OF_INPUT: bool(dependent_pairs(validation)),
        INSIDE_BOUND: at_bound,
    }
    return Judgement(
        frozenset(name for name, fails in failed.items() if fails),
        min(each.ljung_box_p for each in validation.outputs),
        max((each.max_in_bounds for each in validation.pairs), default=0.0),
        delays,
    )


def _earlier_delays(model: StateSpaceModel, forms: SearchedForms) -> tuple[int, ...]:
    """The delays, earlier where residuals depend on samples of an input before its delay.

    A dependence on later samples is one of the response, and no fault of the delay.
    """
    estimation, delays = forms.estimation, forms.delays
    limits = OrderLimits.of(forms.ranges, estimation.input_names).nk if delays else ()
    least = [each[0] if each else 0 for each in limits]
    tested = model.outputs * sum(np.subtract(delays, least))
    if tested == 0:
        return delays
    allowed = float(ndtri(1 - SIGNIFICANCE / (2 * tested)) / ndtri(0.975))
    residuals = np.concatenate(
        [
            model.residuals(u, y, model.prediction_state(u, y))
            for u, y in zip(estimation.segment_inputs, estimation.segment_outputs, strict=True)
        ]
    )
    earlier = list(delays)
    for column, (delay, lowest) in enumerate(zip(delays, least, strict=True)):
        for e in residuals.T:
            u = estimation.inputs[:, column]
            found = correlation_with_input(e, u, max(delay, 1), estimation.bounds)
            large = np.abs(found.values) > allowed * found.bound95
            before = found.lag[large & (found.lag >= lowest) & (found.lag < delay)]
            earlier[column] = min([earlier[column], *before.tolist()])
    return tuple(earlier)


Log = Callable[[str], None]

# Larger orders of the same form, and models in all, that are tried.
LARGER_ORDERS, MOST_TRIALS = 2, 6


@dataclass(frozen=True)
class RemedyRecord:
    """The choice after all remedies, and what was tried.

    Attributes
    ----------
    choice : ModelChoice
    trials : tuple of Trial
    failed : tuple of str
        Checks that stay failed on the estimation samples.
    """

    choice: ModelChoice
    trials: tuple[Trial, ...]
    failed: tuple[str, ...]

    @property
    def statements(self) -> tuple[str, ...]:
        """What was tried and what stays failed, in sentences."""
        sentences = []
        if self.trials:
            remedies = " and ".join(dict.fromkeys(each.remedy for each in self.trials))
            taken = [each.model for each in self.trials if each.taken]
            outcome = f"{taken[-1]} was taken" if taken else "no model of these was taken"
            checks = dict.fromkeys(each.check for each in self.trials)
            sentences.append(
                f"After the global search {' and '.join(checks)} failed on the estimation samples;"
                f" {remedies} was tried ({len(self.trials)} in all), and {outcome}."
            )
        sentences += [f"“{name}” stays failed." for name in self.failed]
        return tuple(sentences)


@dataclass(frozen=True, eq=False)
class RemediedModel:
    """The model after all remedies, and the record of these."""

    model: ChosenModel
    record: RemedyRecord


@dataclass(frozen=True, eq=False)
class _Judged:
    """A model with its choice, what it is estimated from, and what its checks say."""

    forms: SearchedForms
    choice: ModelChoice
    model: ChosenModel
    checks: Judgement

    @classmethod
    def of(cls, forms: SearchedForms, choice: ModelChoice, model: ChosenModel) -> _Judged:
        return cls(forms, choice, model, judge(model.model, model.at_bound, forms))

    @property
    def score(self) -> float:
        return self.forms.score(self.choice)

    @property
    def name(self) -> str:
        polynomials = self.model.polynomials
        if polynomials is not None:
            return str(polynomials.orders)
        return f"{self.choice.variant.form}, {self.choice.order} states"

    def trial(self, check: str, remedy: str, taken: bool) -> Trial:
        return Trial(
            *(check, remedy, self.name, self.score),
            *(self.checks.whiteness, self.checks.correlation, taken),
        )


def act_on_checks(
    forms: SearchedForms, choice: ModelChoice, log: Log | None = None
) -> RemediedModel:
    """Search the chosen model globally, and try remedies for the checks that fail then.

    Parameters
    ----------
    forms : SearchedForms
    choice : ModelChoice
    log : callable, optional

    Raises
    ------
    InputError
        When no model of the chosen order meets the constraints.
    ValueError
        When the record is too short.
    """
    first = _Judged.of(forms, choice, forms.searched(choice, log=log))
    current, attempts = _with_other_model(first, log)
    remaining = tuple(name for name in OF_RESIDUALS if name in current.checks.failed)
    record = RemedyRecord(current.choice, tuple(each.trial for each in attempts), remaining)
    return RemediedModel(current.model, record)


def _with_other_model(first: _Judged, log: Log | None) -> tuple[_Judged, list[Attempt[_Judged]]]:
    """The first remedy that is taken, or the model itself: each one is searched globally."""
    return tried_in_turn(
        Budget(MOST_TRIALS).of(_remedies(first)),
        first,
        lambda remedy, best: _attempt(remedy, best, log),
        lambda _: True,
    )


def _attempt(
    remedy: tuple[str, tuple[int, ...], ModelChoice], first: _Judged, log: Log | None
) -> Attempt[_Judged] | None:
    """What a remedy gives; None where no model can be estimated.

    It is taken where fewer checks fail, no other one does, and the error on held-out samples grows
    by no more than :data:`.TOLERATED`: before its global search, and after it.
    """
    name, delays, choice = remedy
    try:
        forms = first.forms
        if delays != forms.delays:
            forms = forms.with_delays(delays, choice)
        other = _Judged.of(forms, choice, forms.as_searched(choice))
        taken = _is_better(other, first)
        if taken:
            other = _Judged.of(forms, choice, forms.searched(choice, log=log))
            taken = _is_better(other, first)
    except (InputError, ValueError):
        return None
    failed = " and ".join(name for name in OF_RESIDUALS if name in first.checks.failed)
    return Attempt(other, other.trial(failed, name, taken))


def _is_better(other: _Judged, first: _Judged) -> bool:
    fewer = other.checks.failed < first.checks.failed
    return fewer and other.score <= (1.0 + TOLERATED) * first.score


def _remedies(first: _Judged) -> Iterator[tuple[str, tuple[int, ...], ModelChoice]]:
    """Remedy, delays and choice of each model that may be better; none where no check fails."""
    forms, choice, failed = first.forms, first.choice, first.checks.failed
    if DELAY in failed:
        yield "earlier delays", first.checks.delays, choice
    orders = forms.search_of(choice.variant).orders
    if INSIDE_BOUND in failed:
        for order in [k for k in orders if k < choice.order][-1:]:
            yield "smaller order", forms.delays, replace(choice, order=order)
    if failed.intersection((WHITE, INDEPENDENT_OF_INPUT)):
        for order in [k for k in orders if k > choice.order][:LARGER_ORDERS]:
            yield "larger order", forms.delays, replace(choice, order=order)
    if not failed - {DELAY}:
        return
    for search in _others(forms.searches, choice):
        order = search.orders[int(np.argmin(search.coloured_bic))]
        yield "other form", forms.delays, replace(choice, variant=search.variant, order=order)


def _others(searches: Sequence[VariantSearch], choice: ModelChoice) -> list[VariantSearch]:
    """The searches of other forms with a noise model, the most likely one first."""
    others = [each for each in searches if each.orders and each.variant != choice.variant]
    with_noise = [each for each in others if each.variant.form not in OF_SIMULATION]
    return sorted(with_noise, key=lambda each: min(each.coloured_bic))
