"""The lists of all data sets: one page, and one table of all their modes and checks."""

import sys
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

from evopem.config.configuration import Positions
from evopem.files.atomic import write_parquet, write_table, write_text
from evopem.report.index_page import build_index
from evopem.report.templates import template_folder
from evopem.results.fleet import DatasetSummary, Entry, fleet_table, read_entry, without_formulas
from evopem.results.followed_modes import FollowedMode, follow_modes, followed_table
from evopem.results.layout import OVERVIEW, DatasetFiles


def collect_fleet(
    files: DatasetFiles, names: tuple[str, ...], page: str, order: Positions | None
) -> None:
    """List data sets, and follow the modes of those whose results are whole."""
    entries = {name: read_entry(DatasetFiles(f"{files.folder}/{name}")) for name in names}
    given = entries, template_folder(), page, order
    followed = cache(partial(_followed, entries, order))
    for path in OVERVIEW:
        _write_list(f"{files.folder}/{Path(path).name}", *given, followed)


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
    followed = cache(partial(_followed, entries, order))
    for path in OVERVIEW:
        try:
            _write_list(path, entries, templates, page, order, followed)
        except Exception as error:
            sys.stderr.write(f"{path}: the list was not written ({error}).\n")
            with suppress(OSError):
                Path(path).unlink(missing_ok=True)


def _write_list(
    path: str,
    entries: Mapping[str, Entry],
    templates: Path,
    page: str,
    order: Positions | None,
    followed: Callable[[], list[FollowedMode]],
) -> None:
    """Write one of the lists, which its name tells."""
    match Path(path).name:
        case "index.html":
            name = order.name if order else ""
            write_text(path, build_index(entries, templates, page, followed(), name))
        case "fleet.csv":
            write_table(path, without_formulas(fleet_table(entries)))
        case "fleet.parquet":
            write_parquet(path, fleet_table(entries))
        case _:
            write_table(path, without_formulas(followed_table(followed())))


def _followed(entries: Mapping[str, Entry], order: Positions | None) -> list[FollowedMode]:
    recordings = {
        name: [m for m, kept in zip(entry.modes, entry.trusted, strict=True) if kept]
        for name, entry in entries.items()
        if isinstance(entry, DatasetSummary)
    }
    return follow_modes(recordings, order.places if order else None)
