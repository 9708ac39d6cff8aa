"""Acting on residuals and roots: each failed check has its remedy, each trial is recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from evopem.automatic.fit import FitSettings, fit, log_loss
from evopem.automatic.level_decision import Level
from evopem.automatic.orders import Candidate, Scorer
from evopem.automatic.record import Trial
from evopem.automatic.simulation import simulated
from evopem.automatic.structures import AS_GOOD, Choice, as_good
from evopem.automatic.trials import DELAY, TOLERATED, Attempt, Budget, tried_in_turn
from evopem.config.structures import ORDER_NAMES
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples
from evopem.validation.checks.check import SIGNIFICANCE
from evopem.validation.checks.excitation import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import DISTINCT, INSIDE_BOUND

# Poles and zeros that are left out where some cancel, most poles without zeros, and most roots that
# become those of D.
FEWER_ROOTS, MOST_POLES_ALONE, MOST_MOVED = (1, 2, 3, 4, 6, 8), 2, 2
NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)
LENGTH = "Length of B"
"""The check that the last coefficients of B are significant."""

OrdersOfRemedy = tuple[str, str, Orders]
"""What a remedy is called, and the structure and orders that it tries."""


def _later(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for more in (1, 2, 3):
        if o.single.nb > more:
            changed = {"nk": o.single.nk + more, "nb": o.single.nb - more}
            yield f"delay of {o.single.nk + more}", candidate.structure, _changed(o, **changed)


def _shorter(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for fewer in (1, 2, 3):
        if o.single.nb > fewer:
            yield (
                *(f"{fewer} coefficients of B less", candidate.structure),
                _changed(o, nb=o.single.nb - fewer),
            )


def _fewer_roots(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    name = "nf" if o.single.nf else "na"
    for fewer in FEWER_ROOTS:
        if not (getattr(o.single, name) > fewer and o.single.nb > fewer):
            continue
        changed = {name: getattr(o.single, name) - fewer, "nb": o.single.nb - fewer}
        if name == "na" and fewer <= MOST_MOVED:
            # What A and B have in common belongs to D: A D y = B D u + C e.
            moved = changed | {"nd": o.nd + fewer}
            structure = "ararmax" if o.nc else "ararx"
            yield f"{fewer} common roots of A and B moved to D", structure, _changed(o, **moved)
        yield f"{fewer} pole and zero less", candidate.structure, _changed(o, **changed)
        if fewer <= MOST_POLES_ALONE:
            del changed["nb"]
            yield f"{fewer} pole less", candidate.structure, _changed(o, **changed)


def _further_noise(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for n in NOISE_ORDERS:
        if o.single.nf and n > min(o.nc, o.nd):
            yield f"noise model of order {n}", "bj", _changed(o, nc=n, nd=n)
        elif o.na and n > o.nc:
            structure = "ararmax" if o.nd else "armax"
            yield f"C of order {n}", structure, _changed(o, nc=n)
        elif not o.na and not o.single.nf:
            yield f"A and C of order {n}", "armax", _changed(o, na=n, nc=n)


def _longer_b(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for more in (1, 2, 4, 8):
        yield (
            f"{more} coefficients of B more",
            candidate.structure,
            _changed(o, nb=o.single.nb + more),
        )


def _changed(orders: Orders, **changes: int) -> Orders:
    """Other orders, of the smallest structure that has them."""
    given = {name: getattr(orders.single, name) for name in ORDER_NAMES}
    return Orders(**(given | changes))


# Checks, and what is tried while some of them fail, in this order.
REMEDIES = (
    ((DISTINCT, INSIDE_BOUND, EXCITATION_ADEQUATE), _fewer_roots),
    ((DELAY,), _later),
    ((LENGTH,), _shorter),
    ((WHITE,), _further_noise),
    ((INDEPENDENT_OF_INPUT,), _longer_b),
)


MOST_TRIALS = 12


@dataclass(frozen=True)
class Remedied:
    """The choice after all remedies, what was tried, and what stays failed.

    Attributes
    ----------
    choice : Choice
    trials : tuple of Trial
    failed : tuple of str
    statements : tuple of str
        One sentence for each of these: what was tried, and why it stays failed.
    plant_kept : bool
        Whether the noise model was fitted to the errors of simulation of a plant that stays as it
        was estimated without one.
    """

    choice: Choice
    trials: tuple[Trial, ...]
    failed: tuple[str, ...]
    statements: tuple[str, ...]
    plant_kept: bool = False


def act_on_checks(scorer: Scorer, choice: Choice) -> Remedied:
    """Apply remedies until the checks hold, nothing helps, or the budget ends.

    Cancelling roots, roots at the bound, and more coefficients than the input excites: fewer poles
    and zeros.  First coefficients of B that are not significant: a longer delay; last ones: a
    shorter B.  Coloured residuals: a noise model of growing order.  Residuals that depend on past
    inputs: more coefficients of B.

    Parameters
    ----------
    scorer : Scorer
    choice : Choice
    """
    first = current = choice.candidate
    scorer.remember([current])
    budget = Budget(MOST_TRIALS)
    trials: list[Trial] = []
    tried: list[tuple[str, Candidate]] = []
    for checks, remedies in REMEDIES:
        found = _failures(scorer, current)
        failed = tuple(check for check in checks if check in found)
        if not failed:
            continue
        current, attempts = _remedied(
            *(scorer, choice, first, current, failed, budget.of(remedies(current)))
        )
        trials += [each.trial for each in attempts]
        tried += [(check, each.model) for each in attempts for check in failed]
    kept = choice.purpose == "simulation" and _has_coloured_plant(scorer, current)
    if kept:
        current, kept = _with_another_noise_model(scorer, current, choice, trials)
    remaining = scorer.checks(current).failed
    statements = tuple(
        _statement(scorer, check, current, [each for name, each in tried if name == check], choice)
        for check in remaining
    )
    if not kept:
        current = scorer.on_all_samples(current)
    return Remedied(replace(choice, candidate=current), tuple(trials), remaining, statements, kept)


def _remedied(
    scorer: Scorer,
    choice: Choice,
    first: Candidate,
    current: Candidate,
    failed: tuple[str, ...],
    remedies: Iterable[OrdersOfRemedy],
) -> tuple[Candidate, list[Attempt[Candidate]]]:
    """The model after remedies for some failed checks, until all of these hold."""

    def attempt(remedy: OrdersOfRemedy, best: Candidate) -> Attempt[Candidate] | None:
        name, structure, orders = remedy
        candidate = scorer.candidate(structure, orders, [best.model, current.model])
        if candidate is None:
            return None
        taken = _is_better(scorer, candidate, best)
        taken = taken and _is_allowed(scorer, candidate, first, choice)
        named = " and ".join(failed)
        return Attempt(candidate, _trial(scorer, named, name, candidate, choice, taken))

    def suffices(candidate: Candidate) -> bool:
        return not _failures(scorer, candidate).intersection(failed)

    return tried_in_turn(remedies, current, attempt, suffices)


def _failures(scorer: Scorer, candidate: Candidate) -> set[str]:
    """What there are remedies for: coloured residuals of a model without a noise model as well."""
    found = scorer.checks(candidate)
    failed = {*found.failed} | ({DELAY} if found.later else set())
    failed |= {LENGTH} if found.shorter else set()
    return failed | ({WHITE} if _has_coloured_plant(scorer, candidate) else set())


def _is_better(scorer: Scorer, candidate: Candidate, best: Candidate) -> bool:
    """Whether some of the failed checks hold and the others hold still, or the BIC is lower."""
    found, known = (set(scorer.checks(each).failed) for each in (candidate, best))
    return found < known or (found == known and candidate.bic < best.bic)


def _is_allowed(scorer: Scorer, candidate: Candidate, first: Candidate, choice: Choice) -> bool:
    """Whether the error for the purpose stays.

    Within a standard error, where fewer checks fail or the BIC is lower.
    """
    gains = len(scorer.checks(candidate).failed) < len(scorer.checks(first).failed)
    gains |= candidate.bic < first.bic
    if choice.purpose != "simulation":
        return _score(candidate, choice) <= (1.0 + TOLERATED) * _score(first, choice)
    largest = 2.0 * AS_GOOD if gains else TOLERATED
    if candidate.simulation_bic > first.simulation_bic + largest:
        return False
    as_before = _score(candidate, choice) <= (1.0 + TOLERATED) * _score(first, choice)
    return as_before or (gains and as_good(candidate, first, choice.level))


def _statement(
    scorer: Scorer,
    check: str,
    current: Candidate,
    tried: list[Candidate],
    choice: Choice,
) -> str:
    """Why a check stays failed, in a sentence."""
    holding = [each for each in tried if check not in scorer.checks(each).failed]
    if holding:
        best = min(holding, key=lambda each: _score(each, choice))
        others = sorted(set(scorer.checks(best).failed) - set(scorer.checks(current).failed))
        return (
            f"“{check}” holds for {best.name}, whose error on held-out samples is"
            f" {_score(best, choice):.3g} % instead of {_score(current, choice):.3g} %"
            + (
                f", and of which {' and '.join(f'“{each}”' for each in others)} fails"
                * bool(others)
            )
            + "."
        )
    if not tried:
        return f"“{check}” failed, and no remedy for it was tried."
    causes = CAUSES
    if scorer.plan.repetition.independent < 1.0:
        causes = CAUSES | {WHITE: REPEATED, INDEPENDENT_OF_INPUT: REPEATED}
    models = f"any of the {len(tried)} models that were" if len(tried) > 1 else "the one that was"
    because = f": {causes[check]}" if check in causes else ""
    return f"“{check}” did not hold for {models} tried{because}."


def _trial(
    scorer: Scorer, check: str, remedy: str, candidate: Candidate, choice: Choice, taken: bool
) -> Trial:
    found, score = scorer.checks(candidate), _score(candidate, choice)
    return Trial(
        check, remedy, candidate.name, score, found.whiteness, found.correlation, bool(taken)
    )


def _has_coloured_plant(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether the residuals are coloured and the plant has poles of its own."""
    orders = candidate.orders
    return (
        orders.single.nf > 0
        and orders.na == 0
        and scorer.checks(candidate).whiteness < SIGNIFICANCE
    )


def _with_another_noise_model(
    scorer: Scorer, candidate: Candidate, choice: Choice, trials: list[Trial]
) -> tuple[Candidate, bool]:
    """The plant with a noise model that makes the residuals white, else with none.

    A noise model that does not describe the noise makes standard errors wrong; those of an
    output-error model take the colour of its residuals into account.

    Returns
    -------
    Candidate, bool
        The model, and whether its plant stays as it was estimated without the noise model.
    """
    # The plant's last fit comes first: it is not changed afterwards.
    plant = scorer.on_all_samples(candidate)
    described = _with_own_noise_model(scorer, plant, choice, trials)
    if described is not plant:
        return described, True
    if candidate.structure == "oe":
        return candidate, False
    o = candidate.orders
    orders = Orders(nb=o.single.nb, nf=o.single.nf, nk=o.single.nk)
    alone = scorer.candidate("oe", orders, [candidate.model])
    if alone is None:
        return candidate, False
    taken = _is_better(scorer, alone, candidate) and _is_allowed(scorer, alone, candidate, choice)
    trials.append(_trial(scorer, WHITE, "no noise model", alone, choice, taken))
    return (alone if taken else candidate), False


def _with_own_noise_model(
    scorer: Scorer, candidate: Candidate, choice: Choice, trials: list[Trial]
) -> Candidate:
    """The same plant with a noise model that is fitted to its errors of simulation.

    Simulations stay as they are, predictions gain.  The smallest order whose residuals are white;
    the plant as it was where there is none.
    """
    level = candidate.model.level
    errors = [
        Segment(
            np.zeros(each.samples), each.output - simulated(candidate.model, each), each.recording
        )
        for each in scorer.stretches
    ]
    count = total_samples(errors)
    for n in NOISE_ORDERS:
        orders = Orders(na=n, nc=n)
        if candidate.parameters + orders.parameters > scorer.most_parameters:
            break
        try:
            noise = fit(errors, orders, FitSettings(scorer.settings.objective, level=False))
        except (ValueError, np.linalg.LinAlgError):
            continue
        parameters = candidate.orders.single.nb + candidate.orders.single.nf + orders.parameters + 1
        loss = log_loss(noise.residuals_from(), scorer.settings.objective)
        model = replace(
            candidate.model,
            C=noise.model.C,
            D=noise.model.A,
            level=level,
            noise_variance=noise.model.noise_variance,
            structure="bj",
        )
        if not scorer.limits.allow("bj", model.orders):
            continue
        found = replace(
            candidate,
            structure="bj",
            orders=model.orders,
            parameters=parameters,
            bic=float(loss + parameters * np.log(count) / count),
            model=model,
        )
        failed = set(scorer.checks(found).failed)
        taken = WHITE not in failed and failed <= set(scorer.checks(candidate).failed)
        remedy = f"noise model of order {n} for the errors of simulation, plant kept"
        trials.append(_trial(scorer, WHITE, remedy, found, choice, taken))
        if taken:
            return found
    return candidate


def _score(candidate: Candidate, choice: Choice) -> float:
    if choice.purpose == "prediction":
        return candidate.scores.prediction
    level: Level = choice.level
    return candidate.scores.free_level if level == "state" else candidate.scores.simulation


# Why a check fails, where no remedy makes it hold.
CAUSES = {
    WHITE: "the noise of this record is none of a linear filter of these orders",
    INDEPENDENT_OF_INPUT: "the response is not linear, the input depends on the output, or another"
    " input acts",
    INSIDE_BOUND: "the record is too short to tell a drift from an integrator",
    EXCITATION_ADEQUATE: "the input excites fewer directions than any model needs that is as good",
}
REPEATED = (
    "the residuals repeat with the input, so that they are a nonlinear response to it more than"
    " noise, and a linear model of any order leaves them"
)
