"""A commented ``config.yaml`` for a folder of recordings, written by looking into them."""

import json
import os
import re
import shlex
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import yaml

from evopem.config.configuration import MANY
from evopem.config.defaults import complete
from evopem.config.schema import schema_file
from evopem.config.source_checks import MAX_LENGTH, RESERVED_NAMES, RESULTS_FOLDER, is_valid
from evopem.config.strict_yaml import Keys
from evopem.errors import InputError
from evopem.files.atomic import write_text
from evopem.signals.inspection import (
    INPUT_NAMES,
    OUTPUT_NAMES,
    SignalColumn,
    TimeColumn,
    inspect_file,
    named,
    roles_of,
)
from evopem.signals.measured_files import FORMATS, channel_names
from evopem.signals.readers.frequency_responses import responses_named

CONFIGURATION = "config.yaml"

_RESULTS = {"config.yaml", "recording.json", "transforms.json"}
"""Files of which a folder with results of evopem holds all."""
_HEAD = """\
# yaml-language-server: $schema={schema}
# Written by `evopem init` from what the files hold. Check input, output and sampling rate of each
# data set, remove what is no recording of yours, and run, in this folder:
#   snakemake --snakefile PATH/Snakefile --directory .
# where PATH is the checkout of evopem. What no key says is decided from the recording. Keys of the
# analysis (such as structure, resample, split) decide it instead, for one data set or, under
# `defaults:`, for all.
"""
_MANY = """\
# One job takes each recording from its file to its report; `stage` has one for each stage.
one_job_per: recording
"""


def write_configuration(folder: str | Path) -> Path:
    """Write ``config.yaml`` into a folder of recordings."""
    folder = Path(folder)
    target = folder / CONFIGURATION
    if not folder.is_dir():
        raise InputError(str(folder), "is not a folder", "give the folder of the recordings")
    if target.exists() or target.is_symlink():
        remedy = "move it away, or edit it: it is not overwritten"
        raise InputError(str(target), "exists already", remedy)
    write_text(target, configuration_text(folder))
    return target


def configuration_text(folder: Path) -> str:
    """The configuration for all recordings of a folder."""
    entries: list[str] = []
    unread: list[str] = []
    used = set(RESERVED_NAMES)
    for path in recorded_files(folder):
        shown = path.relative_to(folder).as_posix()
        base = dataset_name(path)
        numbered = (f"{base}_{number}" if number > 1 else base for number in count(1))
        name = next(name for name in numbered if name.lower() not in used)
        try:
            entry = _entry(name, path, shown)
            complete(yaml.safe_load(f"datasets:\n{entry}"))
        except InputError as error:
            where = f"{shown}, {error.place}" if error.place else shown
            unread.append(f"# {_comment(f'{where}: {error.problem}; {error.remedy}.')}")
        else:
            entries.append(entry)
            used.add(name.lower())
    if not entries:
        seen = f" ({len(unread)} of a known extension hold none)" if unread else ""
        problem = f"there is no recording of two signals in this folder{seen}"
        raise InputError(str(folder), problem, f"give a folder with files of {' '.join(FORMATS)}")
    many = _MANY if len(entries) >= MANY else ""
    if unread:
        entries.append("\n".join(["# Left out:", *unread]) + "\n")
    return _HEAD.format(schema=schema_file()) + many + "datasets:\n" + "\n".join(entries)


def recorded_files(folder: Path) -> list[Path]:
    """The files of a folder and its subfolders whose extension is that of a known format.

    Hidden folders and those of results are left out.
    """
    recorded = []
    for top, folders, files in os.walk(folder):
        if set(files) >= _RESULTS:
            folders.clear()
            continue
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and name != RESULTS_FOLDER
        )
        recorded += [Path(top) / name for name in sorted(files) if not name.startswith(".")]
    return [path for path in recorded if path.suffix.lower() in FORMATS]


def dataset_name(path: Path) -> str:
    """The name of a data set after its file."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem).lstrip("_.-")
    name = re.sub(r"\.{2,}", ".", name)[: MAX_LENGTH - 20].rstrip(".") or "recording"
    shorter = (f"recording_{name[:length].rstrip('.')}" for length in (40, 10, 1))
    return next(filter(is_valid, (name, *shorter)))


def _too_few(signals: Sequence[SignalColumn]) -> str:
    few = "only one" if signals else "none"
    return f"{few} of its channels holds numbers that change"


def _entry(name: str, path: Path, file: str) -> str:
    """The entry of a file; InputError where it cannot be used."""
    if not file.isprintable() or set("{}*") & set(file):
        problem = "its name is no UTF-8 text, or holds what means something else in a workflow"
        raise InputError(file, problem, "rename it")
    contents = inspect_file(path)
    signals = contents.signals
    if len(signals) < 2:
        raise contents.unread or InputError(file, _too_few(signals), "two are needed")
    sources, targets, sure = _channels(signals)
    others = [_scalar(signal.reference) for signal in signals if signal not in (*sources, *targets)]
    lines = [f"  {_scalar(name)}:", f"    file: {_scalar(file)}"]
    guess = "" if sure else "  # a guess by the order of the channels"
    for key, channels in (("input", sources), ("output", targets)):
        names = [_scalar(channel.reference) for channel in channels]
        named = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
        unit = f"  # {_comment(channels[0].unit)}" if channels[0].unit else ""
        lines.append(f"    {key}: {named}{unit}{guess}")
    lines += _rate(sources[0], targets[0], contents.time)
    if others:
        lines.append(f"    # other channels: {_comment(', '.join(others))}")
    lines.append(f"    # {sources[0].samples} samples")
    return "\n".join(lines) + "\n"


def _channels(
    signals: Sequence[SignalColumn],
) -> tuple[list[SignalColumn], list[SignalColumn], bool]:
    """Inputs and outputs, and whether their names say so; else the first two signals."""
    sources = named(signals, INPUT_NAMES)
    targets = named(signals, OUTPUT_NAMES)
    one_rate = len({(source.samples, source.sampling_rate) for source in (*sources, *targets)}) == 1
    if sources and targets and one_rate and not any(source in targets for source in sources):
        return sources, targets, True
    source = sources[0] if sources else next(x for x in signals if x not in targets[:1])
    target = next((target for target in targets if target != source), None)
    return [source], [target or next(signal for signal in signals if signal != source)], False


def certain_channels(path: str) -> tuple[Keys, str]:
    """Input, output and time of a recording where they are certain, and a sentence about them.

    By the words of the names, else, of two signals, by a test of causality.
    """
    contents = inspect_file(path)
    signals, time = contents.signals, contents.time.reference if contents.time else None
    names = [str(signal.reference) for signal in signals]
    problem = f"which of its channels are inputs and outputs is not certain ({', '.join(names)})"
    columns = channel_names(Path(path))
    if responses := responses_named(columns):
        problem = f"it seems to hold frequency responses ({', '.join(responses)})"
        options = f"{shlex.quote(path)} --frequency {shlex.quote(columns[0])}"
        raise InputError(path, problem, f"give evopem {options} --input NAME --output '*'")
    keys: Keys = {}
    sources = roles = None
    if len(signals) > 1:
        sources, targets, sure = _channels(signals)
        if sure:
            keys = {"input": [source.reference for source in sources]}
            keys |= {"output": [target.reference for target in targets], "time": time}
            return keys, f"{path}: {_taken(keys)}, by their names."
        if len(signals) == 2:
            try:
                roles = roles_of(path, timed=False)
            except InputError as error:
                problem = error.problem
    if roles is not None:
        keys = {"input": [roles.input], "output": [roles.output], "time": roles.time}
        return keys, f"{path}: {roles.sentence}"
    if not signals:
        remedy = "give a recording of signals"
        raise contents.unread or InputError(path, _too_few(signals), remedy)
    if len(signals) < 2:
        also = f" ({contents.unread.place}: {contents.unread.problem})" if contents.unread else ""
        problem = f"{_too_few(signals)}{also}"
    outputs = [str(signal.reference) for signal in named(signals, OUTPUT_NAMES)]
    alone = not sources or set(outputs) == set(names)
    example = ["none", *(outputs or names[:1])] if alone else [names[0], names[1]]
    options = " ".join(
        f"--{role} {shlex.quote(name)}"
        for role, name in zip(["input", *["output"] * len(example)], example, strict=False)
    )
    rate = "" if time is not None or signals[0].sampling_rate else " --rate HZ"
    raise InputError(path, problem, f"name them, as in: evopem {shlex.quote(path)} {options}{rate}")


def _taken(keys: Keys) -> str:
    """Inputs, outputs and time in words."""
    words = [
        f"{role}{'s' if len(keys[role]) > 1 else ''} {', '.join(map(str, keys[role]))}"
        for role in ("input", "output")
    ]
    return "; ".join([*words, *([f"time {keys['time']}"] if keys["time"] is not None else [])])


def _rate(source: SignalColumn, target: SignalColumn, time: TimeColumn | None) -> list[str]:
    rates = {source.sampling_rate, target.sampling_rate}
    if time is not None:
        column = f"    time: {_scalar(time.reference)}"
        if time.sampling_rate is not None:
            return [f"{column}  # {time.sampling_rate:g} Hz"]
        likely = re.search(r"set time_unit to (?:one of \w+, )?(\w+)", time.problem)
        to_set = f"time_unit: {likely[1]}  # to be set: " if likely else ""
        return [column, f"    # {to_set}{_comment(time.problem)}"]
    if len(rates) == 1 and None not in rates:
        return [f"    # sampling rate: {rates.pop():g} Hz, as the file states"]
    return ["    # sampling_rate: 100  # Hz; to be set: the file states none"]


def _scalar(reference: int | str) -> str:
    """A number, or a text that YAML takes for this text and nothing else."""
    if isinstance(reference, int):
        return str(reference)
    plain = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_./-]*", reference)
    reserved = {"y", "n", "yes", "no", "on", "off", "true", "false", "null", "none"}
    if plain and reference.lower() not in reserved:
        return reference
    return json.dumps(reference, ensure_ascii=False)


def _comment(text: str) -> str:
    """A text on one line, without what a terminal or YAML would obey."""
    text = text.encode("utf-8", "backslashreplace").decode()
    return re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+", " ", text)
