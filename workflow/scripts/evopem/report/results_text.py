"""The results of a data set, or of those of a run, in few words: verdict, modes, errors, checks."""

import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from evopem.automatic.orders import in_runs
from evopem.automatic.varying import Moves
from evopem.files.json_form import load
from evopem.models.varying import MovingMode
from evopem.report.numbers import (
    aligned,
    count,
    enumeration,
    is_number,
    mode_cells,
    number,
    percent,
    plural,
    with_error,
)
from evopem.report.verdict import verdict
from evopem.results.dataset import DatasetResults, read_results
from evopem.results.fleet import DatasetSummary, Entry
from evopem.results.identity import IncompleteDataset
from evopem.results.layout import DatasetFiles
from evopem.validation.checks.inputs import OTHER_SAMPLES
from evopem.validation.distortion import Distortion, Floor
from evopem.validation.error_parts import ErrorParts
from evopem.validation.validation import ROUNDING, Validation

_WIDTH = 96
# Share of a distortion's power from which on it is mostly of one kind.
MOSTLY = 0.8
ON_LINES = " or distortion at the lines of the input themselves"
AT_FLOOR = " This is as good as a linear model can be, to a tenth of the error."
_NO_MODE = "The model has no oscillating mode."
_SHOWN_WHOLE = 3  # up to so many data sets are shown with their modes, more with a line each
_SHOWN, _MOST_DELAYS = 40, 3
_PLAIN = str.maketrans(
    {"\u202f": " ", "\u2009": " ", "\u00a0": " ", "\u2212": "-", "\u2013": "-", "\u00b1": "+-"}
    | {"\u201c": '"', "\u201d": '"', "\u2019": "'", "\u2026": "..."}
)


def results_text(
    name: str, verdict: str, summary: DatasetSummary, page: str = "", delays: str = ""
) -> str:
    """The lines about one data set; `page` is the file to open next."""
    modes = aligned(_mode_rows(summary), "   ") if summary.modes else [_NO_MODE]
    lines = [
        *textwrap.wrap(f"{name}: {verdict}", _WIDTH),
        "",
        *(f"  {line}" for line in modes),
        "",
        *_wrapped(", ".join(filter(None, [_model(summary), delays])), "  model   "),
        *_wrapped(_errors(summary), "  errors  "),
        *_wrapped(" ".join(error_parts(summary)[:1]), "  parts   "),
        *_wrapped(moving_sentence(summary.moves), "  moves   "),
    ]
    for check in sorted(summary.reservations, key=lambda check: check.word, reverse=True):
        sentence = re.split(r"(?<=\.) |; ", check.statement, maxsplit=1)[0].rstrip(".")
        lines += _wrapped(f"{check.name}: {sentence}.", f"  {check.word.lower():8}")
    return "\n".join([*lines, *([f"  report  {page}"] if page else [])])


def results_html(name: str, verdict: str, summary: DatasetSummary) -> str:
    """The same as HTML without styles that leave it, with all that the failed checks found."""
    from pandas import DataFrame

    head, *rows = _mode_rows(summary)
    modes = DataFrame(rows, columns=head).to_html(index=False, border=0) if rows else _NO_MODE
    parts = [
        f"<p><strong>{escape(name)}</strong>: {escape(verdict)}</p>",
        modes,
        f"<p>{escape(_model(summary))}. Errors: {escape(_errors(summary))}.</p>",
        *([f"<p>{escape(moved)}</p>"] if (moved := moving_sentence(summary.moves)) else []),
    ]
    if listed := [f"{c.word}: {c.name}. {c.statement}" for c in summary.reservations]:
        counts = len(summary.failed), len(listed) - len(summary.failed)
        named = zip(counts, ("failed check", "caution"), strict=True)
        heading = ", ".join(plural(number, noun) for number, noun in named if number)
        items = "".join(f"<li>{escape(item)}</li>" for item in listed)
        parts.append(f"<details><summary>{heading}</summary><ul>{items}</ul></details>")
    return "<div>" + "\n".join(parts) + "</div>"


def _model(summary: DatasetSummary) -> str:
    if summary.of_responses:
        return f"{summary.model}, from {count(summary.estimation_samples)} frequencies"
    return (
        f"{summary.model}, from {count(summary.estimation_samples)} samples at"
        f" {number(summary.sampling_rate)} Hz"
    )


def _errors(summary: DatasetSummary) -> str:
    if summary.of_responses:
        return f"{percent(summary.simulation_error_percent)} of the frequency responses"
    errors = [f"one step ahead {percent(summary.prediction_error_percent)}"]
    if is_number(summary.simulation_error_percent):
        errors.append(f"simulation {percent(summary.simulation_error_percent)}")
    several = any(len(mode.shape) > 1 for mode in summary.modes)
    same = any(check.name == OTHER_SAMPLES for check in summary.checks)
    return (
        f"{', '.join(errors)} on {count(summary.validation_samples)}"
        f" {'of these' if same else 'validation samples'}"
        f"{', mean over the outputs' if several else ''}"
    )


def _mode_rows(summary: DatasetSummary) -> list[tuple[str, ...]]:
    doubt = "not to be trusted: see the report"
    both = zip(summary.modes, summary.trusted, strict=True)
    return [
        ("mode", "frequency (Hz)", "damping (%)", ""),
        *(
            (str(position), *mode_cells(mode), "" if trusted else doubt)
            for position, (mode, trusted) in enumerate(both, start=1)
        ),
    ]


def _wrapped(text: str, head: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=" " * 10)


def error_parts(judged: Validation | DatasetSummary) -> list[str]:
    """A sentence for each of four outputs, the largest errors first; none where not judged."""
    if judged.prediction_error_percent <= ROUNDING:
        return ["There is no noise: these are rounding errors."]
    split, floors = judged.distortion, [x for x in judged.floors if x.floor.low > 0.0]
    reached = {x.name: AT_FLOOR for x in floors if x.reached}
    several = len(split.outputs or judged.floors) > 1
    said = [(x.error_percent, x.name, _sentence(split, x, several)) for x in split.outputs]
    said = said or [(x.error_percent, x.name, _floor(x, several)) for x in floors]
    return [text + reached.get(name, "") for _, name, text in sorted(said, reverse=True)[:4]]


def moving_sentence(moves: Moves | None) -> str:
    """What moves in a machine that changes, or that no moving model is better."""
    if moves is None:
        return ""
    errors = f"{percent(moves.error_percent, 2)} against {percent(moves.constant_error_percent, 2)}"
    by_time = moves.schedule == "time"
    held_out = "samples held out all along the recording" if by_time else "held-out samples"
    if not moves.is_better:
        response = "The response changes with time, but coefficients that move"
        moving = response if by_time else f"Coefficients that move with {moves.schedule}"
        return f"{moving} do not clearly predict {held_out} better: {errors} one step ahead."
    moved = [f"mode {n} {_way(mode)}" for n, mode in enumerate(moves.modes, 1) if mode.moves]
    said = f": {enumeration(moved)}" if moved else ", though no mode by more than its error"
    changes = f"The machine changes{'' if by_time else f' with {moves.schedule}'}"
    if moves.is_nonlinear:
        changes, said = "The machine may be nonlinear: beside powers it shows no change", ""
    unstable = (
        ""
        if moves.is_stable
        else f" At some {'moments' if by_time else 'values'} its frozen poles are unstable."
    )
    return (
        f"{changes}{said}. With coefficients that move, {held_out} are predicted one step ahead"
        f" with an error of {errors} with constant ones.{unstable}"
    )


def _way(mode: MovingMode) -> str:
    """From where to where a mode moves, and how far it is between."""
    ends = mode.modes[0], mode.modes[-1]
    first, last = (with_error(end.frequency_hz, end.frequency_se_hz) for end in ends)
    low, high = mode.lowest.frequency_hz, mode.highest.frequency_hz
    way = f"moves from {first} to {last} Hz"
    if high - low > 1.5 * abs(ends[1].frequency_hz - ends[0].frequency_hz):
        way += f" (between {number(low, 4)} and {number(high, 4)} Hz)"
    return way


def _floor(floor: Floor, several: bool) -> str:
    """How much of an error can be the model's."""
    of_output = f" of {floor.name}" if several else ""
    return (
        f"Of the simulation error{of_output} of {percent(floor.error_percent)}, at most"
        f" {percent(floor.rest.high, 2)} can be this model’s: noise, disturbances,"
        f" nonlinearity and change, which no linear model of these inputs removes, are"
        f" {percent(floor.floor.low, 2)} or more. The squares of the parts add up."
    )


def _parity(parts: ErrorParts) -> str:
    """Which powers make the distortion, where even and odd lines tell."""
    even = parts.even_share
    if not is_number(even) or MOSTLY > even > 1.0 - MOSTLY:
        return ""
    kind = "even (asymmetric, as of squares)" if even >= MOSTLY else "odd (symmetric, as of cubes)"
    return f". The distortion that shows is mostly {kind}"


def _sentence(distortion: Distortion, parts: ErrorParts, several: bool) -> str:
    """What the error of an output consists of."""
    samples = f" of the {distortion.on} samples"
    of_output = f" of {parts.name}" if several else ""
    of = f"Of the simulation error{of_output} of {percent(parts.error_percent)} over"
    periods = plural(distortion.periods, "period")
    if distortion.realisations > 1:
        periods = f"{periods} each of {distortion.realisations} realisations"
    noise = f"{percent(parts.noise.percent, 2)} is noise"
    extra, rest = parts.distortion, percent(parts.rest.percent, 2)
    if not distortion.shown:
        limit = f"; no nonlinear distortion shows (at most {percent(extra.high, 2)} can be there)"
        if not distortion.separated:
            limit = f"{ON_LINES}, which this excitation does not tell apart"
        split = f"{noise} and {rest} this model{limit}"
    else:
        least = "" if distortion.separated else "at least "
        split = (
            f"{noise}, {least}{percent(extra.percent, 2)} ({percent(extra.low, 2)} to"
            f" {percent(extra.high, 2)}) nonlinear distortion, which no linear model removes, and"
            f" {rest} this model{'' if distortion.separated else ON_LINES}{_parity(parts)}"
        )
    return f"{of} {periods}{samples}, {split}. The squares of the parts add up."


def show(text: str) -> None:
    """Print text; characters outside the terminal's encoding become the nearest ones in it."""
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
            _line_of(name, entry)
            if isinstance(entry, IncompleteDataset)
            or not Path(DatasetFiles.of_dataset(name).config).exists()  # packed, of a batch
            else dataset_text(DatasetFiles.of_dataset(name), files[name])
            for name, entry in entries.items()
        ]
    else:
        lines = [_line_of(name, entry) for name, entry in entries.items()]
        left = len(lines) - _SHOWN
        blocks = ["\n".join([*lines[:_SHOWN], *([f"… and {left} more"] if left > 0 else [])])]
    return "\n\n".join([*blocks, *([f"All data sets: {lists[0]}"] if lists else [])])


def delay_words(results: DatasetResults) -> str:
    """The delays of the inputs, such as “delay 3 samples (30 ms), likely 2 to 4”."""
    rate, parts = results.model.sampling_rate, []
    for delay in results.delays:
        seconds, likely = delay.samples / rate, delay.likely or ()
        time = f"{number(seconds, 3)} s" if seconds >= 1.0 else f"{number(1000 * seconds, 3)} ms"
        words = f"{plural(delay.samples, 'sample')} ({time})" if delay.samples else "0"
        words += f", likely {in_runs(likely)}" if len(likely) > 1 else ""
        parts.append(f"{delay.input} {words}" if len(results.delays) > 1 else words)
    if len(parts) > _MOST_DELAYS:
        samples = [delay.samples for delay in results.delays]
        return f"delays of {min(samples)} to {max(samples)} samples"
    return f"delay{'s' if len(parts) > 1 else ''} {'; '.join(parts)}" if parts else ""


def dataset_text(files: DatasetFiles, page: str) -> str:
    """The lines about one data set of any number of channels; `page` is the file to open next."""
    summary, results = load(DatasetSummary, files.summary), read_results(files)
    delays = delay_words(results)
    return results_text(files.name, verdict(results).sentence, summary, page, delays)


def _line_of(name: str, entry: Entry) -> str:
    if isinstance(entry, IncompleteDataset):
        return f"{name}: {entry.status}. {entry.problem}"
    modes = ", ".join(f"{number(mode.frequency_hz)} Hz" for mode in entry.modes) or "no modes"
    failed = len(entry.failed)
    return f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}; {modes}"
