"""The results of a data set in a few lines: verdict, modes, errors, failed checks, report."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence

from evopem.models.modes import Mode
from evopem.report.numbers import MISSING, count, enumeration, number, percent, plural, with_error
from evopem.results.fleet import DatasetSummary, Entry, IncompleteDataset
from evopem.results.layout import DatasetFiles

_WIDTH = 96
_SHOWN_WHOLE = 3
"""Up to so many data sets are shown with their modes, more with a line each."""
_SHOWN = 40


def results_text(name: str, entry: Entry, page: str) -> str:
    """The lines about one data set.

    Parameters
    ----------
    name : str
    entry : DatasetSummary or IncompleteDataset
    page : str
        The file to open next.
    """
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    lines = [
        *textwrap.wrap(f"{name}: {verdict(entry)}", _WIDTH),
        "",
        *_mode_table(entry.modes),
        "",
        f"  model   {entry.orders}, from {count(entry.estimation_samples)} samples at "
        f"{entry.sampling_rate:g} Hz",
        f"  errors  one step ahead {percent(entry.prediction_error_percent)}, simulation "
        f"{percent(entry.simulation_error_percent)} on {count(entry.validation_samples)} "
        "validation samples",
        *_failed(entry),
        f"  report  {page}",
    ]
    return "\n".join(lines)


def run_text(entries: Mapping[str, Entry], page: str, lists: Sequence[str]) -> str:
    """What came out for the data sets of a run.

    Parameters
    ----------
    entries : mapping of str to DatasetSummary or IncompleteDataset
        By the names of the data sets.
    page : str
        The file to open next, in the folder of a data set.
    lists : sequence of str
        The lists of all data sets, where there are any.
    """
    files = {name: f"{DatasetFiles.of_dataset(name).folder}/{page}" for name in entries}
    if len(entries) <= _SHOWN_WHOLE:
        blocks = [results_text(name, entry, files[name]) for name, entry in entries.items()]
    else:
        lines = [_line(name, entry) for name, entry in entries.items()]
        left = len(lines) - _SHOWN
        blocks = ["\n".join([*lines[:_SHOWN], *([f"… and {left} more"] if left > 0 else [])])]
    return "\n\n".join([*blocks, *([f"All data sets: {lists[0]}"] if lists else [])])


def _line(name: str, entry: Entry) -> str:
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    modes = ", ".join(f"{number(mode.frequency_hz)} Hz" for mode in entry.modes) or "no modes"
    failed = entry.n_checks(passed=False)
    return f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}; {modes}"


def verdict(summary: DatasetSummary) -> str:
    """What the checks say of the model as a whole, in a sentence."""
    failed = [f"“{check.name}”" for check in summary.checks if check.passed is False]
    unjudged = [f"“{check.name}”" for check in summary.checks if check.passed is None]
    if failed:
        return (
            f"the model fails {enumeration(failed)}; read in the report what that means before you "
            "rely on it."
        )
    if unjudged:
        return f"the model fails no check, but {enumeration(unjudged)} could not be judged."
    return f"the model passes all {len(summary.checks)} checks."


def _mode_table(modes: Sequence[Mode]) -> list[str]:
    if not modes:
        return ["  The model has no oscillating mode."]
    rows = [("mode", "frequency (Hz)", "damping (%)")]
    rows += [
        (
            str(position),
            with_error(mode.frequency_hz, mode.frequency_se_hz),
            with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se),
        )
        for position, mode in enumerate(modes, start=1)
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return [
        "  "
        + "   ".join(
            f"{text or MISSING:<{width}}" for text, width in zip(row, widths, strict=True)
        ).rstrip()
        for row in rows
    ]


def _failed(summary: DatasetSummary) -> list[str]:
    """Each failed check with the first sentence of what was found."""
    lines = []
    for check in summary.checks:
        if check.passed is False:
            found = re.split(r"(?<=[.;]) ", check.statement, maxsplit=1)[0]
            lines += _wrapped(f"{check.name}: {found}", "  failed  ")
    return lines


def _wrapped(text: str, head: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=" " * 10)
