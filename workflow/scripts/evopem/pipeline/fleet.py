"""The lists of all data sets: one page, and one table of all their modes and checks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from evopem.config.configuration import Positions, positions
from evopem.files.atomic import write_parquet, write_table, write_text
from evopem.report.index_page import build_index
from evopem.report.templates import template_folder
from evopem.results.fleet import (
    DatasetSummary,
    Entry,
    fleet_table,
    read_entry,
    without_formulas,
)
from evopem.results.followed_modes import FollowedMode, follow_modes, followed_table
from evopem.results.layout import OVERVIEW, DatasetFiles


def collect_fleet(
    files: DatasetFiles, names: tuple[str, ...], page: str, order: dict[str, Any]
) -> None:
    """List data sets, and follow the modes of those whose results are whole."""
    entries = {name: read_entry(DatasetFiles(f"{files.folder}/{name}")) for name in names}
    lists = [f"{files.folder}/{Path(each).name}" for each in OVERVIEW]
    for write in _lists(entries, template_folder(), page, lists, positions(order)).values():
        write()


def collect_unfinished(
    required: Mapping[str, Collection[str]],
    templates: Path,
    page: str,
    pending: Collection[str] = (),
    order: Positions | None = None,
) -> None:
    """List all data sets after a run that failed, each with its summary or what went wrong.

    Raises no error: it runs when Snakemake has already failed. A list that cannot be written is
    deleted, so that no outdated list remains, and a sentence on standard error says why.
    """
    entries = {
        name: read_entry(DatasetFiles.of_dataset(name), files, name in pending)
        for name, files in required.items()
    }
    for path, write in _lists(entries, templates, page, OVERVIEW, order).items():
        try:
            write()
        except Exception as error:
            sys.stderr.write(f"{path}: the list was not written ({error}).\n")
            with suppress(OSError):
                Path(path).unlink(missing_ok=True)


def _lists(
    entries: Mapping[str, Entry],
    templates: Path,
    page: str,
    files: Sequence[str],
    order: Positions | None,
) -> dict[str, Callable[[], None]]:
    """What writes each list, by its path."""
    index_file, csv_file, parquet_file, modes_file = files

    @cache
    def followed() -> list[FollowedMode]:
        recordings = {
            name: [m for m, kept in zip(entry.modes, entry.trusted, strict=True) if kept]
            for name, entry in entries.items()
            if isinstance(entry, DatasetSummary)
        }
        return follow_modes(recordings, order.places if order else None)

    def index() -> str:
        return build_index(entries, templates, page, followed(), order.name if order else "")

    return {
        index_file: lambda: write_text(index_file, index()),
        csv_file: lambda: write_table(csv_file, without_formulas(fleet_table(entries))),
        parquet_file: lambda: write_parquet(parquet_file, fleet_table(entries)),
        modes_file: lambda: write_table(modes_file, without_formulas(followed_table(followed()))),
    }
