"""Orders and structure: one file for each decision."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Self

from evopem.arrays import one_blas_thread
from evopem.automatic.candidates import OrderLimits, Scorer, StructureSearch
from evopem.automatic.cross_validation.folds import FoldPlan
from evopem.automatic.fit import CommonSettings
from evopem.automatic.orders import DelayChoice, order_models, search_structure, without_covariances
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord
from evopem.automatic.structures import compare_structures
from evopem.config.settings import AutomaticSettings
from evopem.config.structures import NESTED
from evopem.errors import InputError, NoModelError
from evopem.estimation.search.problem import Log
from evopem.files.json_form import load, load_shared, save
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared


@dataclass(frozen=True)
class Scored:
    """The samples of a data set, and what fits and scores models of them."""

    prepared: PreparedData
    record: PreparedRecord
    scorer: Scorer

    @classmethod
    def load(
        cls,
        files: DatasetFiles,
        settings: AutomaticSettings,
        fits: CommonSettings,
        of_choice: bool = False,
    ) -> Self:
        """That of a data set; of a choice only models of its structure."""
        prepared = load_prepared(files.prepared, files.transforms)
        plan = load(PreparationPlan, files.decision("preparation"))
        record = PreparedRecord.of(prepared.estimation, plan)
        names = prepared.estimation.input_names
        structure = settings.structure if of_choice else None
        delay = load(DelayChoice, files.decision("delay"))
        orders = settings.orders
        if delay.shortest:
            orders = replace(orders, nk=(delay.shortest, prepared.estimation.samples))
        limits = OrderLimits(None if structure == "state_space" else structure, orders, names)
        common = replace(fits, objective=record.plan.objective)
        folds, delays = load(FoldPlan, files.decision("folds")), (delay.delays, delay.likely)
        scorer = Scorer(record.stretches, folds, common, limits, *delays, delay.early)
        return cls(prepared, record, scorer)


@contextmanager
def errors_name_dataset(files: DatasetFiles) -> Iterator[None]:
    """Put the configuration key of a data set before the place that an error names.

    Raises InputError in place of one without the key, and of NoModelError.
    """
    key = f"datasets.{files.name}"
    try:
        yield
    except InputError as error:
        place = ".".join(filter(None, (key, error.source, error.place)))
        raise InputError(place, error.problem, error.remedy) from None
    except NoModelError as error:
        remedy = "give a longer recording, or lower the orders"
        raise InputError(key, str(error), remedy) from None


def search_structures(
    files: DatasetFiles,
    structures: tuple[str, ...],
    settings: AutomaticSettings,
    fits: CommonSettings,
    nested: tuple[str, ...] = (),
    log: Log | None = None,
) -> None:
    """Search the orders of structures, each from the optima of those nested in it, which are among
    those before it or ``nested``, which were searched already."""
    known = {structure: load(StructureSearch, files.search(structure)) for structure in nested}
    scored = Scored.load(files, settings, fits)
    for structure in structures:
        smaller = {s: known[s] for s in NESTED.get(structure, ()) if s in known}
        with errors_name_dataset(files), one_blas_thread():
            result = search_structure(scored.scorer, structure, smaller, log)
        known[structure] = without_covariances(result)
        save(known[structure], files.search(structure), indent=None)
        models = order_models(result, scored.record, scored.prepared.estimation)
        save(models, files.models_of_orders(structure), indent=None)


def choose(
    files: DatasetFiles,
    structures: tuple[str, ...],
    settings: AutomaticSettings,
    fits: CommonSettings,
) -> None:
    """Choose a model for each purpose among the candidates of all structures."""
    searches = [load_shared(StructureSearch, files.search(structure)) for structure in structures]
    scorer = Scored.load(files, settings, fits, of_choice=True).scorer
    with errors_name_dataset(files), one_blas_thread():
        comparison = compare_structures(scorer, searches)
    save(comparison, files.decision("comparison"), indent=None)
