"""What a run prints at its end: the results of its data sets, or a line for each."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from evopem.files.json_form import load
from evopem.report.numbers import number, plural
from evopem.report.results_text import results_text
from evopem.report.verdict import verdict
from evopem.results.dataset import read_results
from evopem.results.fleet import DatasetSummary, Entry, ResponseValidation
from evopem.results.identity import IncompleteDataset
from evopem.results.layout import DatasetFiles

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


def run_text(entries: Mapping[str, Entry], page: str, lists: Sequence[str]) -> str:
    """What came out for the data sets of a run."""
    files = {name: f"{DatasetFiles.of_dataset(name).folder}/{page}" for name in entries}
    if len(entries) <= _SHOWN_WHOLE:
        blocks = [
            _line(name, entry)
            if isinstance(entry, IncompleteDataset)
            or not Path(DatasetFiles.of_dataset(name).config).exists()  # packed, of a batch
            else dataset_text(DatasetFiles.of_dataset(name), files[name])
            for name, entry in entries.items()
        ]
    else:
        lines = [_line(name, entry) for name, entry in entries.items()]
        left = len(lines) - _SHOWN
        blocks = ["\n".join([*lines[:_SHOWN], *([f"… and {left} more"] if left > 0 else [])])]
    return "\n\n".join([*blocks, *([f"All data sets: {lists[0]}"] if lists else [])])


def dataset_text(files: DatasetFiles, page: str) -> str:
    """The lines about one data set of any number of channels; `page` is the file to open next."""
    summary = load(DatasetSummary, files.summary)
    of = summary.of_responses and load(ResponseValidation, files.validation)
    return results_text(files.name, (of or verdict(read_results(files))).sentence, summary, page)


def _line(name: str, entry: Entry) -> str:
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    modes = ", ".join(f"{number(mode.frequency_hz)} Hz" for mode in entry.modes) or "no modes"
    failed = len(entry.failed)
    return f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}; {modes}"
