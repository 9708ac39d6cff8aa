"""Acting on residuals and roots: a failed check has revisions, and each trial is kept."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from evopem.automatic.candidates import BIC, SIMULATION_BIC, Candidate, Scorer
from evopem.automatic.decision import Decision, Trial
from evopem.automatic.fold_errors import STRONG, as_good, score_of
from evopem.automatic.orders import with_white_noise
from evopem.automatic.revision_orders import (
    DELAY,
    LENGTH,
    MOST_TRIALS,
    REVISIONS,
    TOLERATED,
    earlier_delays,
    with_noise_models,
)
from evopem.automatic.structures import Choice
from evopem.validation.checks.residuals import WHITE
from evopem.validation.held_out_tests import SIGNIFICANCE


@dataclass(frozen=True)
class Revised:
    """The choice after all revisions and a search, what was tried, and what stays failed."""

    choice: Choice
    trials: tuple[Trial, ...]
    failed: tuple[str, ...]
    statements: tuple[str, ...]  # of what stays failed: what was tried, and why it stays
    # Whether the noise model was fitted to errors of simulation of a plant estimated without one.
    plant_kept: bool = False
    search: Decision | None = None  # of the model of this choice, once it is searched


def act_on_checks(scorer: Scorer, choice: Choice, searched: Sequence[Candidate] = ()) -> Revised:
    """Apply revisions until the checks hold, nothing helps, or the budget ends.

    Cancelling roots, roots at the bound and, last, more coefficients than the input excites: fewer
    poles and zeros.  First coefficients of B that are not significant: a longer delay; last ones: a
    shorter B.  Coloured residuals: a noise model of larger order.  Residuals that depend on past
    inputs: more coefficients of B.  In state space: earlier delays, larger orders, and other
    structures with a noise model, of those that were ``searched``.
    """
    first = current = choice.candidate
    scorer.remember([current, *searched])
    left = MOST_TRIALS
    trials: list[Trial] = []
    tried: list[tuple[str, Candidate]] = []
    for checks, *of_forms in REVISIONS:
        revisions = of_forms[first.polynomials is None]
        failed = tuple(check for check in checks if check in _failures(scorer, current))
        best = current
        listed = revisions(scorer, current, searched) if failed and revisions else iter(())
        for name, candidate_of in islice(listed, left):
            left -= 1
            candidate = candidate_of(best)
            if candidate is None:
                continue
            if taken := _is_better(scorer, candidate, best):
                candidate = scorer.with_own_scores(candidate)
                taken = _is_allowed(scorer, candidate, first, choice)
            trials.append(_trial(scorer, " and ".join(failed), name, candidate, choice, taken))
            tried += [(check, candidate) for check in failed]
            if taken:
                best = candidate
                if not _failures(scorer, best).intersection(failed):
                    break
        current = best
    kept = choice.purpose == "simulation" and _has_coloured_plant(scorer, current)
    if kept:
        current, kept = _with_another_noise_model(scorer, current, choice, trials)
    remaining = scorer.checks(current).failed
    statements = tuple(
        _statement(scorer, check, current, [c for name, c in tried if name == check], choice)
        for check in remaining
    )
    if not kept:
        current = scorer.on_all_samples(current)
    return Revised(replace(choice, candidate=current), tuple(trials), remaining, statements, kept)


def _failures(scorer: Scorer, candidate: Candidate) -> set[str]:
    """What revisions are for: coloured residuals of a model without a noise model as well."""
    checks = scorer.checks(candidate)
    late = checks.earlier_delays and earlier_delays(scorer, candidate) != candidate.delays
    further = {DELAY: checks.later or late, LENGTH: checks.shorter}
    further[WHITE] = _has_coloured_plant(scorer, candidate)
    return {*checks.failed, *(name for name, fails in further.items() if fails)}


def _is_better(scorer: Scorer, candidate: Candidate, best: Candidate) -> bool:
    """Whether some of the failed checks hold and the others hold still, or the BIC is lower."""
    failed, known = (set(scorer.checks(model).failed) for model in (candidate, best))
    return failed < known or (failed == known and candidate.bic < best.bic)


def _is_allowed(scorer: Scorer, candidate: Candidate, first: Candidate, choice: Choice) -> bool:
    """Whether the error for the purpose stays. Within one standard error, where fewer checks fail
    or the BIC is lower."""
    score = score_of(choice.kind)
    as_before = score(candidate) <= (1.0 + TOLERATED) * score(first)
    if choice.purpose != "simulation":
        return as_before
    gains = len(scorer.checks(candidate).failed) < len(scorer.checks(first).failed)
    gains |= candidate.bic < first.bic
    # Of white residuals the BIC tells what the data know of the plant.
    is_white = scorer.checks(first).whiteness >= SIGNIFICANCE
    most = STRONG / scorer.independent_samples if is_white else TOLERATED
    criterion = BIC if is_white else SIMULATION_BIC
    likely = criterion(candidate) <= criterion(first) + most
    return likely and (as_before or (gains and as_good(candidate, first, choice.kind, 1.0)))


def _statement(
    scorer: Scorer, check: str, current: Candidate, tried: list[Candidate], choice: Choice
) -> str:
    """Why a check stays failed, in a sentence."""
    score = score_of(choice.kind)
    holding = [candidate for candidate in tried if check not in scorer.checks(candidate).failed]
    if holding:
        best = min(map(scorer.with_own_scores, holding), key=score)
        others = sorted(set(scorer.checks(best).failed) - set(scorer.checks(current).failed))
        fails = f", and {' and '.join(f'“{failing}”' for failing in others)} fails"
        return (
            f"“{check}” holds for {best.name}, which was not taken: its error on held-out samples"
            f" is {score(best):.3g} %, now {score(current):.3g} %{fails if others else ''}."
        )
    if not tried:
        return f"“{check}” failed, and no revision was tried for it."
    models = f"any of the {len(tried)} models that were" if len(tried) > 1 else "the one that was"
    return f"“{check}” did not hold for {models} tried."


def _trial(
    scorer: Scorer, check: str, revision: str, candidate: Candidate, choice: Choice, taken: bool
) -> Trial:
    checks, score = scorer.checks(candidate), score_of(choice.kind)(candidate)
    return Trial(
        check, revision, candidate.name, score, checks.whiteness, checks.correlation, taken
    )


def _has_coloured_plant(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether residuals of polynomials are coloured, and the plant has poles of its own."""
    if candidate.polynomials is None:
        return False
    own_poles = any(candidate.orders.nf) and candidate.orders.na == 0
    return own_poles and scorer.checks(candidate).whiteness < SIGNIFICANCE


def _with_another_noise_model(
    scorer: Scorer, candidate: Candidate, choice: Choice, trials: list[Trial]
) -> tuple[Candidate, bool]:
    """The plant with the smallest noise model that makes the residuals white, else with none. And
    whether its plant stays as it was estimated without the noise model. A noise model that does
    not describe the noise makes standard errors wrong; those of an output-error model take the
    colour of its residuals into account."""
    # The plant's last fit comes first: it is not changed afterwards.
    plant = scorer.on_all_samples(candidate)
    known = set(scorer.checks(plant).failed)
    for n, described in with_noise_models(scorer, plant):
        failed = set(scorer.checks(described).failed)
        taken = WHITE not in failed and failed <= known
        revision = f"noise model of order {n} for the errors of simulation, plant kept"
        trials.append(_trial(scorer, WHITE, revision, described, choice, taken))
        if taken:
            return described, True
    if candidate.structure == "oe":
        return candidate, False
    alone = with_white_noise(scorer, candidate)
    if alone is None:
        return candidate, False
    taken = _is_better(scorer, alone, candidate) and _is_allowed(scorer, alone, candidate, choice)
    trials.append(_trial(scorer, WHITE, "no noise model", alone, choice, taken))
    return (alone if taken else candidate), False
