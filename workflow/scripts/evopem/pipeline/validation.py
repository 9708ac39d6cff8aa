"""Validation: residual tests, errors, evidence for each mode; tables and summary."""

from pathlib import Path

from evopem.automatic.candidates import StructureSearch
from evopem.automatic.decision import OtherModel
from evopem.automatic.revisions import Revised
from evopem.automatic.structures import Comparison
from evopem.automatic.varying import Varying
from evopem.blas_threads import one_blas_thread
from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings
from evopem.config.structures import plant_order
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import delete_results
from evopem.files.json_form import load, save
from evopem.models.mode_matching import OrderModel, OrderModels
from evopem.pipeline.decisions import decision_record, rows_of_phases, rows_of_structures
from evopem.pipeline.planning.stages import results_of
from evopem.report.verdict_file import verdict_file
from evopem.results.dataset import read_results
from evopem.results.fleet import summarize
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording_info import RecordingInfo
from evopem.validation.mode_evidence import with_noise_modes
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import validate, validation_errors


def complete_results(
    files: DatasetFiles,
    settings: DatasetSettings,
    phases: tuple[str, ...],
    structures: tuple[str, ...],
    phase: str | None,
    others: tuple[str, ...],
) -> None:
    """Validate the model, and write what is known of the data set: tables, decisions, summary.

    ``phases`` and ``structures`` that were searched; ``phase``: the one over whose models the modes
    are compared, None for the automatic recipe, where these are the models of all orders of the
    chosen structure, and without any structure for a model alone; ``others``: the purpose whose
    model is kept beside the chosen one, or none.
    """
    record, info = load(ModelRecord, files.model), load(RecordingInfo, files.recording_info)
    prepared = load_prepared(files.prepared, files.transforms)
    selections = {phase: load(PhaseSelection, files.phase(phase)) for phase in phases}
    searches = [load(StructureSearch, files.search(structure)) for structure in structures]
    varying = load(Varying, files.varying) if settings.varying else None
    revised, all_decisions = None, None
    if phase is not None:
        order, models = _of_phase(record, selections[phase])
        rows = rows_of_phases(selections.values())
    elif not structures:
        order, models, rows = record.plant_states, {}, [{"model": record.text, "bic": record.bic}]
    else:
        comparison = load(Comparison, files.decision("comparison"))
        revised = load(Revised, files.decision("revisions"))
        choice, rows = revised.choice, rows_of_structures(searches, comparison, revised)
        other_model = _errors_of_other(files, prepared, others[0]) if others else None
        all_decisions = decision_record(files, prepared, searches, comparison, revised, other_model)
        save(all_decisions, files.decisions)
        path, order = files.models_of_orders(choice.candidate.structure), choice.candidate.order
        order_models = load(OrderModels, path).models if Path(path).exists() else ()
        models = {model.order: model for model in order_models}
    model = record.model if record.orders is not None else record.plant
    models[order] = OrderModel.of(order, record.bic, model, record.modes)
    with one_blas_thread():
        validation, tables = validate(
            record.model,
            prepared,
            record.search.settings.objective,
            [models[model] for model in sorted(models)],
            order,
            settings.spectrum,
            fit_level=record.level_of_simulation == "state",
            tests=varying.tests if varying else None,
        )
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


def _of_phase(record: ModelRecord, selection: PhaseSelection) -> tuple[int, dict[int, OrderModel]]:
    """The plant order of the model, and the likeliest model of each plant order of a phase."""
    name = plant_order(record.structure)
    best: dict[int, OrderModel] = {}
    for candidate in selection.candidates:
        order = getattr(candidate.orders.single, name)
        if order not in best or candidate.criteria.bic < best[order].bic:
            best[order] = OrderModel.of(order, candidate.criteria.bic, candidate.model)
    return getattr(record.polynomials.orders.single, name), best
