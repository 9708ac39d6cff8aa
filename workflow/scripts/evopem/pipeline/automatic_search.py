"""Delay, orders and structure by the automatic recipe: one file for each decision."""

from __future__ import annotations

from evopem.automatic.candidates import Scorer, StructureSearch
from evopem.automatic.chosen import select_structure
from evopem.automatic.delays import DelayChoice, decide_delays
from evopem.automatic.folds import FoldPlan
from evopem.automatic.folds import decide_folds as decide_common_folds
from evopem.automatic.limits import OrderLimits
from evopem.automatic.orders import NESTED
from evopem.automatic.orders import search_structure as search
from evopem.automatic.remedies import act_on_checks as act
from evopem.automatic.structures import Comparison, Purpose
from evopem.automatic.structures import compare_structures as compare
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import AutomaticSettings, InputRanges, Range
from evopem.errors import InputError
from evopem.files.json_form import load, save
from evopem.pipeline.preparation import load_record
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared


def decide_folds(files: DatasetFiles) -> None:
    """Decide how held-out samples are divided."""
    with one_blas_thread():
        save(decide_common_folds(load_record(files).stretches), files.decision("folds"))


def decide_delay(files: DatasetFiles, limits: Range | None) -> None:
    """Decide the delay, within the limits of the configuration."""
    stretches = load_record(files).stretches
    save(decide_delays(stretches, ("input",), InputRanges(limits)), files.decision("delay"))


def search_structure(files: DatasetFiles, structure: str, settings: AutomaticSettings) -> None:
    """Search the orders of one structure, from the optima of those nested in it."""
    smaller = {each: load(StructureSearch, files.search(each)) for each in NESTED[structure]}
    with one_blas_thread():
        scorer = _scorer(files, OrderLimits.of_search(settings))
        save(search(scorer, structure, smaller), files.search(structure))


def compare_structures(
    files: DatasetFiles, structures: tuple[str, ...], settings: AutomaticSettings
) -> None:
    """Choose a model for each purpose among the candidates of all structures.

    Raises
    ------
    InputError
        When the recording is too short for every structure.
    """
    searches = [load(StructureSearch, files.search(each)) for each in structures]
    with one_blas_thread():
        scorer = _scorer(files, OrderLimits.of_choice(settings))
        try:
            comparison = compare(scorer, searches)
        except ValueError as error:
            raise InputError(
                f"datasets.{files.name}", str(error), "give a longer recording"
            ) from None
        chosen = comparison.choice(settings.purpose).candidate
        about = next(each for each in comparison.decisions if each.choice == chosen.name)
        selection = select_structure(
            *(comparison.candidates, chosen, about.sentence, load_record(files)),
            *(load_prepared(files.prepared, files.transforms).estimation, scorer.window),
        )
    save(comparison, files.decision("comparison"))
    save(selection, files.phase(selection.phase))


def act_on_checks(files: DatasetFiles, settings: AutomaticSettings) -> None:
    """Apply remedies to the model for the purpose until its checks hold or nothing helps."""
    comparison = load(Comparison, files.decision("comparison"))
    purpose: Purpose = settings.purpose
    with one_blas_thread():
        scorer = _scorer(files, OrderLimits.of_choice(settings))
        save(act(scorer, comparison.choice(purpose)), files.decision("remedies"))


def _scorer(files: DatasetFiles, limits: OrderLimits) -> Scorer:
    record = load_record(files)
    folds = load(FoldPlan, files.decision("folds"))
    delays = load(DelayChoice, files.decision("delay")).delays
    return Scorer(record.stretches, folds, record.settings, limits, delays)
