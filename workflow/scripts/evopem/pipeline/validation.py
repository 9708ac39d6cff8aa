"""Validation: residual tests, errors, evidence for each mode, decisions; tables and summary."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evopem.arrays import one_blas_thread
from evopem.automatic.candidates import Candidate, StructureSearch
from evopem.automatic.cross_validation.folds import FoldPlan
from evopem.automatic.decision import Alternative, Decision, DecisionRecord, OtherModel, Trial
from evopem.automatic.orders import DelayChoice
from evopem.automatic.preparation.plan import PreparationPlan
from evopem.automatic.revisions import Revised
from evopem.automatic.structures import Choice, Comparison
from evopem.automatic.varying import Varying
from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings, Purpose
from evopem.config.structures import ORDER_NAMES, plant_order
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import Candidate as PhaseCandidate
from evopem.estimation.order_candidate import PhaseSelection
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import delete_results
from evopem.files.json_form import load, load_shared, save
from evopem.models.mode_matching import OrderModel, OrderModels
from evopem.pipeline.planning.stages import results_of
from evopem.report.verdict_file import verdict_file
from evopem.results.dataset import read_results
from evopem.results.fleet import summarize
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording import Segment, total_samples
from evopem.signals.recording_info import RecordingInfo
from evopem.validation.likely_models import beside_rival
from evopem.validation.mode_evidence import ModeTable, with_noise_modes
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import modes_of, validate, validation_errors


def complete_results(
    files: DatasetFiles,
    settings: DatasetSettings,
    phases: tuple[str, ...],
    structures: tuple[str, ...],
    phase: str | None,
    others: tuple[Purpose, ...],
) -> None:
    """Validate the model, and write what is known of the data set: tables, decisions, summary.

    ``phases`` and ``structures`` that were searched; ``phase``: the one over whose models the modes
    are compared, None for the automatic recipe, where these are the models of all orders of the
    chosen structure, and without any structure for a model alone; ``others``: the purposes whose
    models are kept beside the chosen one, or none.
    """
    record, info = load(ModelRecord, files.model), load(RecordingInfo, files.recording_info)
    prepared = load_prepared(files.prepared, files.transforms)
    selections = {phase: load(PhaseSelection, files.phase(phase)) for phase in phases}
    searches = [load_shared(StructureSearch, files.search(structure)) for structure in structures]
    varying = load(Varying, files.varying) if settings.varying else None
    revised, all_decisions = None, None
    if phase is not None:
        order, models = _of_phase(record, selections[phase])
        rows = rows_of_phases(selections.values())
    elif not structures:
        order, rows = record.plant_states, [{"model": record.text, "bic": record.bic}]
        models = _among({}, order, record)
    else:
        comparison = load_shared(Comparison, files.decision("comparison"))
        revised = load(Revised, files.decision("revisions"))
        choice, rows = revised.choice, rows_of_structures(searches, comparison, revised)
        other_model = _errors_of_other(files, prepared, others[0]) if others else None
        all_decisions = decision_record(files, prepared, searches, comparison, revised, other_model)
        save(all_decisions, files.decisions)
        order, models = choice.candidate.order, _of_orders(files, choice.candidate, record)
    with one_blas_thread():
        validation, tables = validate(
            *(record.model, prepared, record.search.settings.objective),
            *(models, order, settings.spectrum),
            fit_level=record.level_of_simulation == "state",
            tests=varying.tests if varying else None,
        )
        if revised is not None:
            choices = [choice, *map(comparison.choice, others)]
            modes = _beside_rivals(validation.modes, record, files, prepared, choices)
            validation = replace(validation, modes=modes)
    save(validation, files.validation)
    write_table(files.candidates, {name: [row[name] for row in rows] for name in rows[0]})
    modes = with_noise_modes(validation.modes, record.noise_modes, len(record.input_names))
    write_table(files.modes, modes.rows(record.input_names, record.output_names))
    for name, table in vars(tables).items():
        write_table(getattr(files, name), table)
    known = {"settings": settings, "recording_info": info, "prepared": prepared, "model": record}
    known |= {"validation": validation, "validation_tables": tables, "decisions": all_decisions}
    known |= {"phases": selections, "searches": tuple(searches), "revised": revised}
    results = read_results(files, varying=varying, **known)
    summary = summarize(results.evidence, varying.moves if varying else None)
    save(summary, files.summary)
    # What other settings left, and an archive, whose contents are written anew.
    left = {*files.read_again()}.difference(results_of(settings, files, with_report=True))
    delete_results(files.folder, {Path(path).name for path in left})
    write_text(files.config, yaml_text(settings))
    save(verdict_file(results, summary, files), files.verdict)


def _errors_of_other(files: DatasetFiles, prepared: PreparedData, purpose: str) -> OtherModel:
    """What the model for another purpose reaches on the validation samples."""
    record = load(ModelRecord, files.other_model(purpose))
    fitted_level = record.level_of_simulation == "state"
    with one_blas_thread():
        held_out = held_out_stretches(record.model, prepared, fitted_level)
        return OtherModel(purpose, record.text, *validation_errors(held_out, fitted_level))


def _of_orders(files: DatasetFiles, chosen: Candidate, record: ModelRecord) -> list[OrderModel]:
    """A model among those of all orders of its structure."""
    path = files.models_of_orders(chosen.structure)
    known = load(OrderModels, path).models if Path(path).exists() else ()
    return _among({model.order: model for model in known}, chosen.order, record)


def _among(models: dict[int, OrderModel], order: int, record: ModelRecord) -> list[OrderModel]:
    model = record.model if record.orders is not None else record.plant
    models[order] = OrderModel.of(order, record.bic, model, record.modes)
    return [models[order] for order in sorted(models)]


def _beside_rivals(
    table: ModeTable,
    chosen: ModelRecord,
    files: DatasetFiles,
    prepared: PreparedData,
    choices: Sequence[Choice],
) -> ModeTable:
    """The modes of the first choice beside those of models for other purposes, if both have poles.

    A finite response is chosen where the data call for none.
    """
    of_choice, fit_level = choices[0].candidate, chosen.level_of_simulation == "state"
    seen = {of_choice.name}
    for choice in reversed(choices):
        rival = choice.candidate
        if rival.name in seen or not (of_choice.has_poles and rival.has_poles):
            continue
        seen.add(rival.name)
        record = load(ModelRecord, files.other_model(choice.purpose))
        if record.text == chosen.text:  # it serves in place of one that no descent ends at
            continue
        gain = prepared.estimation.samples * (of_choice.bic - rival.bic)
        beside = modes_of(_of_orders(files, rival, record), rival.order, prepared, fit_level)
        table = beside_rival(table, beside, record.text, gain)
    return table


def _of_phase(record: ModelRecord, selection: PhaseSelection) -> tuple[int, list[OrderModel]]:
    """The plant order of the model, and the likeliest model of each plant order of a phase."""
    name = plant_order(record.structure)
    best: dict[int, OrderModel] = {}
    for candidate in selection.candidates:
        order = getattr(candidate.orders.single, name)
        if order not in best or candidate.criteria.bic < best[order].bic:
            best[order] = OrderModel.of(order, candidate.criteria.bic, candidate.model)
    order = getattr(record.polynomials.orders.single, name)
    return order, _among(best, order, record)


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
        _row(candidate, candidate.orders == selection.orders)
        for selection in selections
        for candidate in selection.candidates
    ]


def _row(candidate: PhaseCandidate, selected: bool) -> Row:
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
        f"{choice.kind}_error_percent": trial.score if np.isfinite(trial.score) else None,
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
        purpose=choice.purpose,
        decisions=decisions,
        trials=revised.trials,
        failed=revised.failed,
        remarks=(*_remarks(prepared.estimation.segments), *untold, *revised.statements),
        other_model=other_model,
        likely_delays=delay.likely,
    )


def _about_channels(recording: RecordingInfo) -> tuple[Decision, ...]:
    """How input and output were found in the file; nothing where the configuration names them."""
    roles = recording.roles
    if roles is None:
        return ()
    pairs = (f"{roles.input} to {roles.output}", f"{roles.output} to {roles.input}")
    scores, measure = (np.nan, np.nan), "names of the channels"
    if test := roles.test:
        scores = test.forward, test.backward
        measure = f"p-value of the first one's past in predictions of the second, {test.lags} lags"
    alternatives = tuple(map(Alternative, pairs, scores))
    return (Decision("channels", pairs[0], alternatives, measure, roles.sentence),)


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
