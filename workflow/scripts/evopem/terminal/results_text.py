"""The results of a data set in a few lines: verdict, modes, errors, failed checks, report."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

from evopem.config.yaml_form import read_settings
from evopem.files.json_form import load
from evopem.models.modes import Mode
from evopem.report.numbers import count, is_number, number, percent, plural, with_error
from evopem.report.sentences.about_verdict import verdict
from evopem.results.dataset import DatasetResults, read_dataset_results
from evopem.results.fleet import DatasetSummary, Entry, IncompleteDataset
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


def state_space_text(summary: DatasetSummary, name: str, page: str) -> str:
    """The lines about one data set with several channels.

    Parameters
    ----------
    summary : DatasetSummary
    name : str
    page : str
        The file to open next.
    """
    failed = summary.n_checks(passed=False)
    outcome = plural(failed, "failed check") if failed else "no failed check"
    errors = [f"one step ahead {percent(summary.prediction_error_percent)}"]
    if is_number(summary.simulation_error_percent):
        errors.append(f"simulation {percent(summary.simulation_error_percent)}")
    lines = [
        f"{name}: {outcome}",
        "",
        *_modes_of(summary.modes, summary.trusted),
        "",
        f"  model   {summary.model}, from {count(summary.estimation_samples)} samples at "
        f"{summary.sampling_rate:g} Hz",
        f"  errors  {', '.join(errors)} on {count(summary.validation_samples)} validation samples, "
        "mean over the outputs",
        *_failed(summary.checks),
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
            else _text_of(name, files[name])
            for name, entry in entries.items()
        ]
    else:
        lines = [_line(name, entry) for name, entry in entries.items()]
        left = len(lines) - _SHOWN
        blocks = ["\n".join([*lines[:_SHOWN], *([f"… and {left} more"] if left > 0 else [])])]
    return "\n\n".join([*blocks, *([f"All data sets: {lists[0]}"] if lists else [])])


def _text_of(name: str, page: str) -> str:
    files = DatasetFiles.of_dataset(name)
    if Path(files.modes_json).exists():
        return state_space_text(load(DatasetSummary, files.summary), name, page)
    return results_text(read_dataset_results(files, read_settings(files.config)), page)


def _line(name: str, entry: Entry) -> str:
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    modes = ", ".join(f"{number(mode.frequency_hz)} Hz" for mode in entry.modes) or "no modes"
    failed = entry.n_checks(passed=False)
    return f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}; {modes}"


def _mode_table(results: DatasetResults) -> list[str]:
    trusted = {each.mode.pole for each in results.trusted_modes}
    modes = results.model.modes
    return _modes_of(modes, [mode.pole in trusted for mode in modes])


def _modes_of(modes: Sequence[Mode], trusted: Sequence[bool]) -> list[str]:
    if not modes:
        return ["  The model has no oscillating mode."]
    rows = [("mode", "frequency (Hz)", "damping (%)", "")]
    rows += [
        (
            str(position),
            with_error(mode.frequency_hz, mode.frequency_se_hz),
            with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se),
            "" if trust else "not to be trusted: see the report",
        )
        for position, (mode, trust) in enumerate(zip(modes, trusted, strict=True), start=1)
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
