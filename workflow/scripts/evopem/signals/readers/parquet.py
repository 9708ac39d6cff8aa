"""Parquet tables, read by pyarrow."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evopem.signals.readers.open_file import Channel, Contents, library, refusing_damage


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The columns of a table; missing numbers are NaN."""
    arrow = library("pyarrow", path)
    parquet = library("pyarrow.parquet", path)

    def load(index: int) -> Channel:
        # Two columns may share a name: the table then holds both, in their order.
        # Without threads, which may outlive the interpreter and abort the process.
        table = file.read(columns=[names[index]], use_threads=False)
        column = table.column(names[:index].count(names[index]))
        if arrow.types.is_decimal(column.type):
            column = column.cast(arrow.float64())
        return Channel(names[index], column.to_numpy())

    with refusing_damage(path, "Parquet file"), path.open("rb") as stream:
        file = parquet.ParquetFile(stream)
        names = list(file.schema_arrow.names)
        yield Contents(path, "column", [(name,) for name in names], load)
