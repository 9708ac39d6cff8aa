"""The chosen model, searched globally: its covariance, modes and frequency response."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from evopem.arrays import one_blas_thread
from evopem.automatic.chosen_model import estimate_choice, searches_of
from evopem.automatic.decision import Decision
from evopem.automatic.fit import CommonSettings, weighting_of
from evopem.automatic.revisions import act_on_checks
from evopem.automatic.structures import Choice, Comparison, rivals_of
from evopem.config.constraints import Constraints
from evopem.config.settings import (
    AutomaticSettings,
    FitSettings,
    Hold,
    Purpose,
    ScoringWindow,
    SearchSettings,
)
from evopem.config.structures import OF_SIMULATION
from evopem.errors import InputError, NoModelError
from evopem.estimation.continuous import in_continuous_time
from evopem.estimation.model_record import LevelOfSimulation, ModelRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.estimation.order_selection import complete_estimate
from evopem.estimation.search.problem import Log
from evopem.files.atomic import write_table
from evopem.files.json_form import load, load_shared, save
from evopem.models.mode_matching import with_spread
from evopem.models.polynomial import Model, save_model_mat
from evopem.models.response_tables import (
    frequency_response_table,
    furthest_rival,
    time_response_table,
)
from evopem.pipeline.structure_search import Scored, errors_name_dataset
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.recording import Recording


def _record_of(
    choice: Choice,
    scored: Scored,
    search: SearchSettings,
    settings: AutomaticSettings,
    fit: FitSettings,
    plant_kept: bool = False,
    log: Log | None = None,
) -> tuple[ModelRecord, Decision]:
    """Everything that is known of the model of a choice of the automatic recipe.

    Structures that are fitted to simulated outputs have no other focus.

    Raises InputError when the record is too short, or no model of the order meets the constraints.
    """
    candidate, data, scorer = choice.candidate, scored.prepared.estimation, scored.scorer
    if candidate.structure in OF_SIMULATION:
        fit = replace(fit, focus="prediction")
    search = replace(search, objective=scored.record.plan.objective)
    search, limited = searches_of(candidate, search, settings)
    with one_blas_thread():
        chosen, about = estimate_choice(
            *(choice, scorer, scored.record, data, limited),
            *(fit if fit.changes_model else None, plant_kept, log),
        )
    search = replace(search, max_root_radius=chosen.largest_radius)
    return ModelRecord.of(
        *(chosen.estimate, data, search, scored.prepared.transforms, level_of(choice.level, data)),
        model=chosen.model,
        structure=candidate.structure,
        weighting=weighting_of(candidate.structure, scorer.settings)
        if candidate.polynomials is None
        else "",
        focus=fit.focus,
        constraints=fit.constraints,
        at_upper_ends=chosen.at_upper_ends,
    ), about


def _for_other_purpose(
    chosen: ModelRecord,
    choice: Choice,
    scored: Scored,
    search: SearchSettings,
    settings: AutomaticSettings,
    constraints: Constraints | None,
) -> ModelRecord:
    """The model of a choice for another purpose, or the chosen one where there is none.

    Constraints may fit the orders of the chosen one alone, as may the bound of the roots.
    """
    given = choice, scored, search, settings
    try:
        return _record_of(*given, FitSettings(constraints=constraints))[0]
    except NoModelError:  # no descent ends at a stable model, or rounding spoils what it ends at
        return chosen
    except InputError as error:
        if error.source == "search.max_root_radius":
            return chosen
        if constraints is None or not error.source.startswith("constraints"):
            raise
        return _for_other_purpose(chosen, *given, None)


def level_of(level: LevelOfSimulation, data: Recording) -> LevelOfSimulation:
    """The level of other samples: of several recordings each has its own, and so have others."""
    several = len(set(data.segment_recordings)) > 1
    return "state" if level == "constant" and several else level


def complete_model(
    files: DatasetFiles,
    search: SearchSettings,
    window: ScoringWindow | None,
    phases: tuple[str, ...],
    fit: FitSettings,
    settings: AutomaticSettings,
    fits: CommonSettings,
    others: tuple[Purpose, ...] = (),
    hold: Hold | None = None,
    log: Log | None = None,
) -> None:
    """Complete the selected candidate, and write it for evopem, MATLAB and spreadsheets.

    With a ``hold`` of the input in continuous time as well.

    With a focus or constraints, the model of its orders is estimated for these.  To that of an
    automatic recipe, which has no phases, revisions are applied and it is searched globally; models
    for ``others`` of its purposes are kept beside it as the comparison of structures found them.
    """
    rivals: list[Model] = []
    if window is not None:
        record = _selected(files, search, window, phases[-1], fit)
    else:
        comparison = load_shared(Comparison, files.decision("comparison"))
        scored = Scored.load(files, settings, fits, of_choice=True)
        choice = comparison.choice(settings.purpose)
        with errors_name_dataset(files):
            with one_blas_thread():
                revised = act_on_checks(scored.scorer, choice, comparison.candidates)
            chosen = revised.choice, scored, search, settings, fit
            record, about = _record_of(*chosen, revised.plant_kept, log)
            save(replace(revised, search=about), files.decision("revisions"))
            known = rivals_of(scored.scorer, revised.choice, comparison)
            rivals = [scored.record.in_its_units(candidate.model) for candidate in known]
            spread = [rival.modes() for rival in rivals]
            record = replace(record, modes=with_spread(record.modes, spread))
            names = [candidate.name for candidate in known]
            reported, longest = [record.plant, *rivals[1:]], scored.prepared.estimation.longest
            with one_blas_thread():
                record = replace(record, rival=furthest_rival(names, reported, longest.samples))
            models: dict[tuple[str, str], ModelRecord] = {}
            for purpose in others:
                choice = comparison.choice(purpose)
                if (same := (choice.candidate.name, choice.level)) not in models:
                    given = choice, scored, search, replace(settings, evaluations=0)
                    other_model = _for_other_purpose(record, *given, fit.constraints)
                    modes = with_spread(other_model.modes, spread)
                    models[same] = replace(other_model, modes=modes)
                save(models[same], files.other_model(purpose))
    with one_blas_thread():
        if hold is not None:
            data = load_prepared(files.prepared, files.transforms).estimation
            of_plant = record.plant if record.orders is None else record.polynomials.plant()
            record = replace(record, continuous=in_continuous_time(of_plant, data, hold, search))
        write_model(files, record, rivals)


def write_model(files: DatasetFiles, record: ModelRecord, rivals: Sequence[Model] = ()) -> None:
    """Write a model with its responses; ``rivals`` widen their intervals."""
    model, names = record.model, (record.input_names, record.output_names)
    plant = None if record.orders is not None else record.plant
    with one_blas_thread():
        responses = frequency_response_table(model, *names, plant, rivals=rivals)
        write_table(files.frequency_response, responses)
        write_table(files.time_response, time_response_table(model, *names, record.plant, rivals))
    save(record, files.model)
    save_model_mat(record.model, files.model_mat, record.continuous)


def _selected(
    files: DatasetFiles, search: SearchSettings, window: ScoringWindow, phase: str, fit: FitSettings
) -> ModelRecord:
    selected = load(PhaseSelection, files.phase(phase)).selected
    prepared = load_prepared(files.prepared, files.transforms)
    data, level = prepared.estimation, "constant" if selected.levels else "none"
    estimate = complete_estimate(selected, data, search, window, fit)
    return ModelRecord.of(
        *(estimate, data, search, prepared.transforms),
        level_of(cast("LevelOfSimulation", level), data),
        focus=fit.focus,
        constraints=fit.constraints,
    )
