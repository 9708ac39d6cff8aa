"""The results of a data set in a few lines: verdict, modes, errors, failed checks, report."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Mapping, Sequence

from evopem.config.yaml_form import read_settings
from evopem.report.numbers import count, number, percent, plural, with_error
from evopem.report.sentences.about_verdict import verdict
from evopem.results.dataset import DatasetResults, read_dataset_results
from evopem.results.fleet import Entry, IncompleteDataset
from evopem.results.layout import DatasetFiles
from evopem.validation.checks import Check

_WIDTH = 96
_SHOWN_WHOLE = 3
"""Up to so many data sets are shown with their modes, more with a line each."""
_SHOWN = 40
_PLAIN = str.maketrans(
    {"\u202f": " ", "\u2009": " ", "\u00a0": " ", "\u2212": "-", "\u2013": "-", "\u00b1": "+-"}
    | {"\u201c": '"', "\u201d": '"', "\u2019": "'", "\u2026": "..."}
)


def show(text: str) -> None:
    """Print text; characters that the terminal's encoding lacks become the nearest ones it has."""
    encoding = sys.stdout.encoding or "utf-8"
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        text = text.translate(_PLAIN).encode(encoding, "replace").decode(encoding)
    print(text, flush=True)


def results_text(results: DatasetResults, page: str) -> str:
    """The lines about one data set.

    Parameters
    ----------
    results : DatasetResults
    page : str
        The file to open next.
    """
    validation, transforms = results.validation, results.model.transforms
    lines = [
        *textwrap.wrap(f"{results.name}: {verdict(results).sentence}", _WIDTH),
        "",
        *_mode_table(results),
        "",
        f"  model   {results.model.orders}, from {count(transforms.estimation_samples)} samples at "
        f"{results.model.sampling_rate:g} Hz",
        f"  errors  one step ahead {percent(validation.prediction_error_percent)}, simulation "
        f"{percent(validation.simulation_error_percent)} on {count(validation.samples)} "
        "validation samples",
        *_failed(results.checks),
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
        blocks = [
            _line(name, entry)
            if isinstance(entry, IncompleteDataset)
            else results_text(_read(name), files[name])
            for name, entry in entries.items()
        ]
    else:
        lines = [_line(name, entry) for name, entry in entries.items()]
        left = len(lines) - _SHOWN
        blocks = ["\n".join([*lines[:_SHOWN], *([f"… and {left} more"] if left > 0 else [])])]
    return "\n\n".join([*blocks, *([f"All data sets: {lists[0]}"] if lists else [])])


def _read(name: str) -> DatasetResults:
    files = DatasetFiles.of_dataset(name)
    return read_dataset_results(files, read_settings(files.config))


def _line(name: str, entry: Entry) -> str:
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    modes = ", ".join(f"{number(mode.frequency_hz)} Hz" for mode in entry.modes) or "no modes"
    failed = entry.n_checks(passed=False)
    return f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}; {modes}"


def _mode_table(results: DatasetResults) -> list[str]:
    modes = results.model.modes
    if not modes:
        return ["  The model has no oscillating mode."]
    trusted = {each.mode.pole for each in results.trusted_modes}
    rows = [("mode", "frequency (Hz)", "damping (%)", "")]
    rows += [
        (
            str(position),
            with_error(mode.frequency_hz, mode.frequency_se_hz),
            with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se),
            "" if mode.pole in trusted else "not to be trusted: see the report",
        )
        for position, mode in enumerate(modes, start=1)
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        "  "
        + "   ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _failed(checks: Sequence[Check]) -> list[str]:
    """Each failed check with the first sentence of what was found."""
    lines = []
    for check in checks:
        if check.passed is False:
            found = re.split(r"(?<=[.;]) ", check.statement, maxsplit=1)[0]
            lines += _wrapped(f"{check.name}: {found}", "  failed  ")
    return lines


def _wrapped(text: str, head: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=" " * 10)
