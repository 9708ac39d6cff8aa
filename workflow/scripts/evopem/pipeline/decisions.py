"""What is known of the choice of a model: a table of candidates, and all decisions."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from evopem.automatic.candidates import Candidate, StructureSearch
from evopem.automatic.cross_validation.folds import FoldPlan
from evopem.automatic.decision import Alternative, Decision, DecisionRecord, OtherModel, Trial
from evopem.automatic.orders import DelayChoice
from evopem.automatic.preparation.plan import PreparationPlan
from evopem.automatic.revisions import Revised
from evopem.automatic.structures import Choice, Comparison
from evopem.config.structures import ORDER_NAMES
from evopem.estimation.order_candidate import Candidate as PhaseCandidate
from evopem.estimation.order_candidate import PhaseSelection
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Segment, total_samples
from evopem.signals.recording_info import RecordingInfo

COLUMNS = (
    *("step", "structure", "order", "model", "bic"),
    *("simulation_error_percent", "fitted_level_error_percent", "prediction_error_percent"),
    *("selected", "reason"),
)
_OF_CANDIDATES = ("max_pole_radius", "max_noise_zero_radius", "at_stability_bound", "pruned")
_OF_SEARCHES = (
    *("evaluations", "n_restarts", "n_confirming", "n_local_optima", "n_multistart"),
    "undiscovered_probability",
)
Row = dict[str, Any]


def rows_of_phases(selections: Iterable[PhaseSelection]) -> list[Row]:
    """The rows of ``candidates.csv``, one for each candidate of each phase."""
    return [
        _of_phase(candidate, candidate.orders == selection.orders)
        for selection in selections
        for candidate in selection.candidates
    ]


def _of_phase(candidate: PhaseCandidate, selected: bool) -> Row:
    orders = candidate.orders
    return {
        "phase": candidate.phase,
        "model": str(orders),
        **{name: getattr(orders.single, name) for name in ORDER_NAMES},
        **{name: getattr(candidate.criteria, name) for name in ("rss", "bic", "objective")},
        **{name: getattr(candidate, name) for name in _OF_CANDIDATES},
        **{name: getattr(candidate.diagnostics, name) for name in _OF_SEARCHES},
        "selected": selected,
    }


def rows_of_structures(
    searches: Sequence[StructureSearch], comparison: Comparison, revised: Revised
) -> list[Row]:
    """The same of the automatic recipe: each candidate of each structure, and revisions."""
    choice = comparison.choice(revised.choice.purpose)
    rows = [
        *_searched(searches, comparison, choice),
        *(_revision(trial, choice) for trial in revised.trials),
    ]
    return [{name: row.get(name) for name in COLUMNS} for row in rows]


def _searched(
    searches: Sequence[StructureSearch], comparison: Comparison, choice: Choice
) -> Iterator[Row]:
    """The orders of all structures, and those that were refined; not all of them are scored."""
    searched = {candidate.name for search in searches for candidate in search.candidates}
    for candidate in sorted(comparison.candidates, key=lambda c: c.name not in searched):
        row: Row = {
            "step": "order" if candidate.name in searched else "orders of each input",
            "structure": candidate.structure,
            "order": candidate.order,
            "model": candidate.name,
            "bic": candidate.bic,
            "selected": candidate.name == choice.candidate.name,
            "reason": _reason(candidate, choice),
        }
        if candidate.is_scored:
            scores = vars(candidate.scores).items()
            row |= {f"{kind}_error_percent": score for kind, score in scores}
        yield row


def _reason(candidate: Candidate, choice: Choice) -> str:
    if candidate.name == choice.candidate.name:
        return f"for {choice.purpose}: most likely of the best on held-out samples"
    if not candidate.is_scored:
        return "less likely than those that were scored, or above the order of the lowest BIC"
    if candidate.bic > choice.candidate.bic:
        return "less likely than the selected one"
    return "worse on held-out samples"


def _revision(trial: Trial, choice: Choice) -> Row:
    """A model that was tried against failed checks; one that is selected replaces the choice."""
    outcome = "fewer checks fail" if trial.taken else "no fewer checks fail, or worse errors"
    return {
        "step": "revision",
        "model": trial.model,
        f"{choice.kind}_error_percent": trial.score,
        "selected": trial.taken,
        "reason": f"{trial.revision}, as {trial.check} failed: {outcome}",
    }


def decision_record(
    files: DatasetFiles,
    prepared: PreparedData,
    searches: Sequence[StructureSearch],
    comparison: Comparison,
    revised: Revised,
    other_model: OtherModel | None,
) -> DecisionRecord:
    """All decisions of a data set, in their order."""
    folds, choice = load(FoldPlan, files.decision("folds")), revised.choice
    plan = load(PreparationPlan, files.decision("preparation"))
    delay = load(DelayChoice, files.decision("delay"))
    untold = [delay.decision.sentence] * any(len(likely) > 1 for likely in delay.likely)
    decisions: tuple[Decision, ...] = (
        *_about_channels(load(RecordingInfo, files.recording_info)),
        *plan.decisions,
        folds.decision,
        folds.repetition.decision,
        delay.decision,
        *(search.decision for search in searches),
        *comparison.decisions,
        *filter(None, [revised.search]),
    )
    return DecisionRecord(
        *(choice.purpose, decisions, revised.trials, revised.failed),
        (*_remarks(prepared.estimation.segments), *untold, *revised.statements),
        other_model,
        delay.likely,
    )


def _about_channels(recording: RecordingInfo) -> tuple[Decision, ...]:
    """How input and output were found in the file; nothing where the configuration names them."""
    roles = recording.roles
    if roles is None:
        return ()
    pairs = (f"{roles.input} to {roles.output}", f"{roles.output} to {roles.input}")
    test = roles.test
    scores = (test.forward, test.backward) if test else (np.nan, np.nan)
    criterion = (
        f"p-value of the first one's past in predictions of the second, {test.lags} lags"
        if test
        else "names of the channels"
    )
    alternatives = tuple(map(Alternative, pairs, scores))
    return (Decision("channels", pairs[0], alternatives, criterion, roles.sentence),)


def _remarks(stretches: Sequence[Segment]) -> tuple[str, ...]:
    """What the model comes from, where its samples have breaks."""
    longest = max(stretch.samples for stretch in stretches)
    recordings = len({stretch.recording for stretch in stretches})
    levels = " and a level for each recording" if recordings > 1 else ""
    sentence = (
        f"The {total_samples(stretches)} estimation samples are {len(stretches)} stretches with"
        f" breaks between them, of {recordings} recording{'s' * (recordings > 1)}: one model comes"
        f" from all, with an initial state for each stretch{levels}. The spectrum is of the longest"
        f" stretch ({longest} samples)."
    )
    return (sentence,) * (len(stretches) > 1)
