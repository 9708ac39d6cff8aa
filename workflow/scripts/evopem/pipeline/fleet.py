"""The lists of all data sets: one page, and one table of all their modes and checks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from evopem.files.atomic import write_parquet, write_table, write_text
from evopem.report.index_page import build_index
from evopem.results.fleet import (
    Entry,
    IncompleteDataset,
    fleet_table,
    read_entry,
    read_summaries,
    without_formulas,
)
from evopem.results.layout import FLEET_CSV, FLEET_PARQUET, INDEX, DatasetFiles


def collect_fleet(
    names: Iterable[str],
    templates: Path,
    page: str,
    index_file: str,
    csv_file: str,
    parquet_file: str,
) -> None:
    """List data sets whose results are complete.

    Parameters
    ----------
    names : iterable of str
        Names of the data sets; their folders lie beside `index_file`.
    templates : Path
        Folder of ``index.html.j2``.
    page : str
        The file in the folder of a data set that its row links to.
    index_file, csv_file, parquet_file : path
        The lists to write.

    Raises
    ------
    InputError
        When a summary is missing or damaged, or a list cannot be written.
    """
    folder = Path(index_file).parent
    entries = read_summaries(DatasetFiles(str(folder / name)) for name in names)
    for write in _lists(entries, templates, page, index_file, csv_file, parquet_file).values():
        write()


def collect_unfinished(
    required: Mapping[str, Collection[str]],
    templates: Path,
    page: str,
    pending: Collection[str] = (),
) -> None:
    """List all data sets after a run that failed, each with its summary or what went wrong.

    Raises no error: it runs when Snakemake has already failed. A list that cannot be written is
    deleted, so that no outdated list remains, and a sentence on standard error says why.

    Parameters
    ----------
    required : mapping of str to collection of path
        The results that each data set must have, by the names of the data sets.
    templates : Path
        Folder of ``index.html.j2``.
    page : str
        The file in the folder of a data set that its row links to.
    pending : collection of str
        Names of the data sets of which the run has left jobs undone.
    """
    entries = {
        name: _entry(DatasetFiles.of_dataset(name), files, name in pending)
        for name, files in required.items()
    }
    for path, write in _lists(entries, templates, page, INDEX, FLEET_CSV, FLEET_PARQUET).items():
        try:
            write()
        except Exception as error:
            sys.stderr.write(f"{path}: the list was not written ({error}).\n")
            with suppress(OSError):
                Path(path).unlink(missing_ok=True)


def _entry(files: DatasetFiles, required: Collection[str], pending: bool) -> Entry:
    """The entry of a data set; an error of reading it becomes its problem."""
    try:
        return read_entry(files, required, pending)
    except Exception as error:
        return IncompleteDataset("failed", f"{files.folder}: cannot be read ({error}).")


def _lists(
    entries: Mapping[str, Entry],
    templates: Path,
    page: str,
    index_file: str,
    csv_file: str,
    parquet_file: str,
) -> dict[str, Callable[[], None]]:
    """What writes each list, by its path."""
    return {
        index_file: lambda: write_text(index_file, build_index(entries, templates, page)),
        csv_file: lambda: write_table(csv_file, without_formulas(fleet_table(entries))),
        parquet_file: lambda: write_parquet(parquet_file, fleet_table(entries)),
    }
