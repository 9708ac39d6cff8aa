"""The prepared samples of several channels, and how errors about them are named."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from evopem.errors import InputError
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared


def load_prepared_channels(files: DatasetFiles) -> PreparedData:
    """The prepared samples of a data set, for estimation and for validation."""
    return load_prepared(files.prepared, files.transforms)


@contextmanager
def errors_name_dataset(files: DatasetFiles) -> Iterator[None]:
    """Put the configuration key of a data set before the place that an error names.

    Raises
    ------
    InputError
        In place of one without the key, and where an estimation raises `ValueError`: it has too
        few samples for its orders.
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
