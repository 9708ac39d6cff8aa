"""The chosen model, searched globally."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

from evopem.automatic.chosen import estimate_chosen as search_chosen
from evopem.automatic.chosen import select_structure
from evopem.automatic.fit import FitSettings
from evopem.automatic.limits import OrderLimits
from evopem.automatic.remedies import Remedied
from evopem.automatic.state_space import weighting_of
from evopem.automatic.state_space_chosen import ChosenModel, estimate_candidate
from evopem.automatic.structures import Choice, Comparison
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import AutomaticSettings, Objective, SearchSettings
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load, save
from evopem.pipeline.search.estimation_samples import errors_name_dataset, load_record, load_scorer
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared

Log = Callable[[str], None]


def estimate_chosen(
    files: DatasetFiles,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    log: Log | None = None,
) -> None:
    """Describe all candidates of one channel, and search the chosen orders globally."""
    record = load_record(files)
    data = load_prepared(files.prepared, files.transforms).estimation
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    chosen = comparison.choice(settings.purpose).candidate
    about = next(each for each in comparison.decisions if each.choice == chosen.name)
    window = load_scorer(files, settings, fits).window
    own = replace(search, objective=cast("Objective", record.plan.objective))
    with one_blas_thread():
        structures = select_structure(
            comparison.candidates, chosen, about.sentence, record, data, window
        )
        selection = search_chosen(remedied, record, data, own, log)
    save(structures, files.phase(structures.phase))
    save(selection, files.phase(selection.phase))


def estimate_channels(
    files: DatasetFiles,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    constraints: Constraints | None,
    log: Log | None = None,
) -> ModelRecord:
    """Search the chosen model of several channels globally, and add its noise model.

    Raises InputError when the record is too short, or no model of the order meets the constraints.
    """
    data = load_prepared(files.prepared, files.transforms)
    choice = load(Remedied, files.decision("remedies")).choice
    with errors_name_dataset(files):
        found = estimated(data, choice, search, settings, fits, constraints, log)
    return record_of(found, data, choice, search, fits, constraints)


def estimated(
    data: PreparedData,
    choice: Choice,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    constraints: Constraints | None,
    log: Log | None,
) -> ChosenModel:
    """The model of a choice for several channels."""
    limits = OrderLimits(None, settings.orders, data.estimation.input_names)
    own = replace(fits, objective=search.objective)
    return estimate_candidate(
        *(choice.candidate, data.estimation, own, limits, constraints, settings.evaluations, log)
    )


def record_of(
    found: ChosenModel,
    data: PreparedData,
    choice: Choice,
    search: SearchSettings,
    fits: FitSettings,
    constraints: Constraints | None,
) -> ModelRecord:
    """Everything that is known of a model of several channels."""
    structure = choice.candidate.structure
    weighting = "determinant"
    if choice.candidate.polynomials is None:
        weighting = weighting_of(structure, replace(fits, objective=search.objective))
    return ModelRecord.of(
        *(found.estimate, data.estimation, search, data.transforms, choice.level),
        model=None if found.polynomials else found.model,
        variant=(structure, weighting),
        constraints=constraints,
        at_upper_ends=found.at_upper_ends,
    )
