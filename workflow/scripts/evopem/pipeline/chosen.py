"""The chosen model, searched globally: its covariance, modes and frequency response."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

from evopem.automatic.candidates import Scorer
from evopem.automatic.chosen import estimate_choice, select_structure, window_of
from evopem.automatic.chosen import estimate_chosen as search_chosen
from evopem.automatic.decision import Decision
from evopem.automatic.fit import FitSettings as CommonSettings
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord
from evopem.automatic.remedies import Remedied
from evopem.automatic.state_space import weighting_of
from evopem.automatic.structures import Choice, Comparison, Purpose
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import (
    AutomaticSettings,
    FitSettings,
    Objective,
    ScoringWindow,
    SearchSettings,
)
from evopem.config.structures import OF_SIMULATION
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import LevelOfSimulation, ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.polynomial import save_model_mat
from evopem.models.response_tables import (
    frequency_response_table,
    time_response_table,
)
from evopem.pipeline.structures import errors_name_dataset, load_record, load_scorer
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared

Log = Callable[[str], None]


def estimate_chosen(
    files: DatasetFiles,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    log: Log | None = None,
) -> None:
    """Describe all candidates of one channel, and search the chosen orders globally."""
    record = load_record(files)
    data = load_prepared(files.prepared, files.transforms).estimation
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    chosen = comparison.choice(settings.purpose).candidate
    about = next(each for each in comparison.decisions if each.choice == chosen.name)
    scorer = load_scorer(files, settings, fits)
    own = replace(search, objective=cast("Objective", record.plan.objective))
    with one_blas_thread():
        structures = select_structure(
            comparison.candidates, chosen, about.sentence, record, data, scorer.window
        )
        selection, about_search = search_chosen(
            *(remedied.choice, scorer, record, data, own, remedied.plant_kept, log)
        )
    save(structures, files.phase(structures.phase))
    save(selection, files.phase(selection.phase))
    save(about_search, files.decision("search"))


def estimate_channels(
    files: DatasetFiles,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    fit: FitSettings,
    log: Log | None = None,
) -> ModelRecord:
    """Search the chosen model of several channels globally, and add its noise model.

    Raises InputError when the record is too short, or no model of the order meets the constraints.
    """
    choice = load(Remedied, files.decision("remedies")).choice
    record, about = record_of_channels(files, choice, search, settings, fits, fit, log)
    save(about, files.decision("search"))
    return record


def record_of_channels(
    files: DatasetFiles,
    choice: Choice,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    fit: FitSettings,
    log: Log | None = None,
) -> tuple[ModelRecord, Decision]:
    """Everything that is known of the model of a choice for several channels.

    Structures that are fitted to simulated outputs have no other focus.
    """
    structure = choice.candidate.structure
    if structure in OF_SIMULATION:
        fit = replace(fit, focus="prediction")
    own = fit if fit.changes_model else None
    data, evaluations = load_prepared(files.prepared, files.transforms), settings.evaluations
    with errors_name_dataset(files), one_blas_thread():
        scorer = load_scorer(files, settings, fits)
        found, about = estimate_choice(
            *(choice, scorer, load_record(files), data.estimation, own, evaluations, log)
        )
    weighting = "determinant"
    if choice.candidate.polynomials is None:
        weighting = weighting_of(structure, scorer.settings)
    record = ModelRecord.of(
        *(found.estimate, data.estimation, search, data.transforms, choice.level),
        model=None if found.polynomials else found.model,
        variant=(structure, weighting),
        focus=fit.focus,
        constraints=fit.constraints,
        at_upper_ends=found.at_upper_ends,
    )
    return record, about


def complete_model(
    files: DatasetFiles,
    search: SearchSettings,
    window: ScoringWindow | None,
    phases: tuple[str, ...],
    fit: FitSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    others: tuple[Purpose, ...] = (),
    log: Log | None = None,
) -> None:
    """Complete the selected candidate, and write it for evopem, MATLAB and spreadsheets.

    With a focus or constraints, the model of its orders is estimated for these.  That of an
    automatic recipe is searched globally; several channels have no phases.  Models for ``others``
    of its purposes are kept beside it.
    """
    if phases and window is None:
        estimate_chosen(files, search, settings, fits, log)
    if phases:
        record = _selected(files, search, window, phases[-1], fit)
    else:
        record = estimate_channels(files, search, settings, fits, fit, log)
    model, names = record.model, (record.input_names, record.output_names)
    plant = None if record.orders is not None else record.plant
    with one_blas_thread():
        write_table(files.frequency_response, frequency_response_table(model, *names, plant))
        write_table(files.time_response, time_response_table(model, *names, record.plant))
    save(record, files.model)
    save_model_mat(record.model, files.model_mat)
    for purpose in others:
        complete_other(files, purpose, search, settings, fits, fit.constraints)


def _selected(
    files: DatasetFiles,
    search: SearchSettings,
    window: ScoringWindow | None,
    phase: str,
    fit: FitSettings,
) -> ModelRecord:
    """The candidate of one channel that a phase has selected; without window an automatic one."""
    selected = load(PhaseSelection, files.phase(phase)).selected
    prepared = load_prepared(files.prepared, files.transforms)
    level: LevelOfSimulation = "constant" if selected.with_level else "none"
    if window is None:
        plan = load(PreparationPlan, files.decision("preparation"))
        search = replace(search, objective=cast("Objective", plan.objective))
        level = load(Remedied, files.decision("remedies")).choice.level
        estimate = complete_estimate(
            selected, prepared.estimation, search, window_of(selected.orders), fit
        )
        estimate = replace(estimate, at_stability_bound=selected.at_stability_bound)
    else:
        estimate = complete_estimate(selected, prepared.estimation, search, window, fit)
    if level == "constant" and len(set(prepared.estimation.segment_recordings)) > 1:
        level = "state"  # each recording has a level of its own, and so have others
    return ModelRecord.of(
        *(estimate, prepared.estimation, search, prepared.transforms, level),
        focus=fit.focus,
        constraints=fit.constraints,
    )


def complete_other(
    files: DatasetFiles,
    purpose: Purpose,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    constraints: Constraints | None,
) -> None:
    """Keep the model for another purpose.

    It is the one of the comparison of structures, without acting on its checks and without a global
    search.  Constraints hold for models of several channels.
    """
    prepared = load_prepared(files.prepared, files.transforms)
    choice = load(Comparison, files.decision("comparison")).choice(purpose)
    polynomials = choice.candidate.polynomials
    with errors_name_dataset(files), one_blas_thread():
        if polynomials is not None and polynomials.inputs == 1:
            scorer = load_scorer(files, settings, fits)
            record = _of_one_channel(scorer, load_record(files), prepared, choice, search)
        else:
            quick, none = replace(search, evaluations=0), replace(settings, evaluations=0)
            fit = FitSettings(constraints=constraints)
            record, _ = record_of_channels(files, choice, quick, none, fits, fit)
    save(record, files.other_model(purpose))


def _of_one_channel(
    scorer: Scorer,
    record: PreparedRecord,
    prepared: PreparedData,
    choice: Choice,
    search: SearchSettings,
) -> ModelRecord:
    """The model of one channel, at the optimum that the comparison found."""
    data, objective = prepared.estimation, cast("Objective", record.plan.objective)
    own = replace(search, objective=objective, evaluations=0)
    selection, _ = search_chosen(choice, scorer, record, data, own)
    window = window_of(selection.orders)
    estimate = complete_estimate(selection.selected, data, own, window)
    return ModelRecord.of(estimate, data, own, prepared.transforms, choice.level)
