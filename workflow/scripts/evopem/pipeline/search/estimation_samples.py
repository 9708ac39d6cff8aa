"""The estimation samples of a data set as decisions and searches take them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from evopem.automatic.candidates import Scorer
from evopem.automatic.delays import DelayChoice
from evopem.automatic.fit import FitSettings
from evopem.automatic.held_out.folds import FoldPlan
from evopem.automatic.limits import OrderLimits
from evopem.automatic.preparation.plan import PreparationPlan, PreparedRecord
from evopem.config.settings import AutomaticSettings
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared


def load_record(files: DatasetFiles) -> PreparedRecord:
    """All stretches of the estimation samples, with the plan behind them."""
    plan = load(PreparationPlan, files.decision("preparation"))
    return PreparedRecord.of(load_prepared(files.prepared, files.transforms), plan)


def load_scorer(
    files: DatasetFiles, settings: AutomaticSettings, fits: FitSettings, of_choice: bool = False
) -> Scorer:
    """What fits and scores models of a data set; of a choice only those of its structure."""
    record = load_record(files)
    names = load_prepared(files.prepared, files.transforms).estimation.input_names
    structure = settings.structure if of_choice else None
    limits = OrderLimits(None if structure == "state_space" else structure, settings.orders, names)
    return Scorer(
        record.stretches,
        load(FoldPlan, files.decision("folds")),
        replace(fits, objective=record.plan.objective),
        limits,
        load(DelayChoice, files.decision("delay")).delays,
    )


@contextmanager
def errors_name_dataset(files: DatasetFiles) -> Iterator[None]:
    """Put the configuration key of a data set before the place that an error names.

    Raises InputError in place of one without the key, and where an estimation raises `ValueError`:
    it has too few samples for its orders.
    """
    key = f"datasets.{files.name}"
    try:
        yield
    except InputError as error:
        place = ".".join(filter(None, (key, error.source, error.place)))
        raise InputError(place, error.problem, error.remedy) from None
    except ValueError as error:
        remedy = "give a longer recording, or lower the orders"
        raise InputError(key, str(error), remedy) from None
