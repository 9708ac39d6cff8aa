"""Parquet tables, read by pyarrow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.channels import (
    Channel,
    Reference,
    find_channel,
    library,
    refuse_unreadable,
)


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read columns by name or by number."""
    arrow = library("pyarrow", path)
    parquet = library("pyarrow.parquet", path)
    with path.open("rb") as stream:
        try:
            file = parquet.ParquetFile(stream)
            names = list(file.schema_arrow.names)
        except (arrow.ArrowException, OSError):
            refuse_unreadable(path, "Parquet file")
        channels = []
        for reference in references:
            index = find_channel(path, reference, names, "column")
            try:
                # Two columns may share a name: the table then holds both, in their order.
                # Without threads, which may outlive the interpreter and abort the process.
                table = file.read(columns=[names[index]], use_threads=False)
                column = table.column(names[:index].count(names[index]))
            except (arrow.ArrowException, OSError):
                refuse_unreadable(path, "Parquet file")
            if column.null_count:
                first = int(np.argmax(column.is_null().to_numpy()))
                raise InputError(
                    str(path),
                    "the value is missing",
                    "repair or remove that sample",
                    f'column "{names[index]}", sample {first + 1}',
                )
            if arrow.types.is_decimal(column.type):
                column = column.cast(arrow.float64())
            channels.append(Channel(names[index], column.to_numpy()))
    return channels


def names(path: Path) -> list[str]:
    """Names of all columns in the order of their numbers."""
    arrow = library("pyarrow", path)
    parquet = library("pyarrow.parquet", path)
    try:
        return list(parquet.read_schema(path).names)
    except (arrow.ArrowException, OSError):
        refuse_unreadable(path, "Parquet file")
