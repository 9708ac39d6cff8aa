"""Measured frequency responses: a recording of another kind, with errors at frequencies."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from evopem.arrays import Array, Complex
from evopem.config.channels import ChannelSettings, is_pattern, of_each
from evopem.errors import InputError
from evopem.signals.measured_files import channel_names, format_of, read_channels
from evopem.signals.readers.open_file import Reference, listing, split_heading
from evopem.signals.readers.uff import frequency_functions
from evopem.signals.recording import numbered

FEWEST = 10  # frequencies, below which nothing is estimated
MOST_COHERENT = 1.001  # with what rounding adds
# Lines to either side over which the variances of coherences are averaged.
SMOOTHED = 3
_BETWEEN = r"[\s_./:,;()-]+"
_PARTS = {
    **dict.fromkeys(("real", "re"), "real"),
    **dict.fromkeys(("imaginary", "imag", "im"), "imaginary"),
    **dict.fromkeys(("magnitude", "mag", "abs", "gain"), "magnitude"),
    **dict.fromkeys(("phase", "phase deg", "angle", "angle deg"), "phase"),
    **dict.fromkeys(("coherence", "coh"), "coherence"),
    **dict.fromkeys(("variance", "var"), "variance"),
}
"""What a column of a response holds, by the words behind its name."""
_DECIBELS = re.compile(r"\bdB", re.I)
_RADIANS = re.compile(r"\b(milli|micro|[muµμ])?rad(ians?)?\b", re.I)
_RADIAN = {"degree": np.pi / 180.0, "": 1.0, "m": 1e-3, "milli": 1e-3}  # others are micro
_WHOLE = {"complex"}, {"real", "imaginary"}, {"magnitude", "phase"}


@dataclass(frozen=True, eq=False)
class FrequencyResponses:
    """Responses of l outputs to m inputs at F frequencies.

    InputError for frequencies that do not increase from above 0, or lie above half the sampling
    rate, for responses that are not finite, and for variances that are not positive.
    """

    frequencies: Array  # (F,) Hz
    values: Complex  # (F, l, m), or (F,); output units by input units
    # (F, l, m) variances of the errors, real and imaginary part together, where they are known
    variances: Array | None = None
    are_absolute: bool = True  # whether the variances are known but for nothing, else a factor
    sampling_rate: float | None = None  # Hz of sampled signals; None in continuous time
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    source: str = "frequency responses"

    def __post_init__(self) -> None:
        given: dict[str, Any] = {"frequencies": np.asarray(self.frequencies, dtype=float)}
        for name, kind in (("values", complex), ("variances", float)):
            if (array := getattr(self, name)) is not None:
                array = np.asarray(array, dtype=kind)
                given[name] = array[:, None, None] if array.ndim == 1 else array
        values, known = given["values"], "variances" in given
        given["are_absolute"] = self.are_absolute and known
        if known:
            given["variances"] = np.broadcast_to(given["variances"], values.shape)
        for role, size in zip(("output", "input"), values.shape[1:], strict=True):
            given[f"{role}_names"] = getattr(self, f"{role}_names") or numbered(role, size)
            given[f"{role}_units"] = getattr(self, f"{role}_units") or ("",) * size
        for name, value in given.items():
            object.__setattr__(self, name, value)
        self._check()

    def _check(self) -> None:
        frequencies, rate = self.frequencies, self.sampling_rate
        if not len(self.values) == len(frequencies) >= FEWEST:
            problem = f"there are {len(frequencies)} frequencies and {len(self.values)} values"
            raise InputError(self.source, problem, f"give as many of both, {FEWEST} or more")
        known = np.isfinite(self.values)
        if self.variances is not None:
            known &= np.isfinite(self.variances) & (self.variances > 0.0)
        falling = ~(np.diff(frequencies, prepend=0.0) > 0.0)
        for wrong, problem in (
            (falling, "the frequencies do not increase from above 0"),
            (~known.all(axis=(1, 2)), "a response is not finite, or its variance not above 0"),
        ):
            if wrong.any():
                place = f"frequency {int(np.argmax(wrong)) + 1}"
                raise InputError(self.source, problem, "repair or remove that line", place)
        if rate is not None and not frequencies[-1] < rate / 2:
            problem = f"{frequencies[-1]:g} Hz is not below half the sampling rate of {rate:g} Hz"
            raise InputError(self.source, problem, "correct the rate, or leave out what lies above")


def variances_of(values: Complex, coherence: Array) -> Array:
    """Of responses with coherences, but for a factor (Bendat & Piersol 2010, section 9.2).

    Means of neighbouring lines: that of one is the square of few averages.
    """
    known = np.clip(coherence, 1e-6, 1.0 - 1e-6)  # that no line outweighs all others
    noise = np.abs(values) ** 2 * (1.0 - known) / known
    sides = [(SMOOTHED, SMOOTHED), *[(0, 0)] * (noise.ndim - 1)]
    edge = np.pad(noise, sides, mode="reflect")
    return np.asarray(sum(edge[k : k + len(noise)] for k in range(2 * SMOOTHED + 1)))


Read = tuple[list[tuple[Any, ...]], tuple[str, ...], tuple[str, ...]]
"""Frequencies, values, coherences, variances and unit of each response; outputs and inputs."""


def read_responses(
    name: str | Path, channels: ChannelSettings, folder: str | Path = ""
) -> FrequencyResponses:
    """Read frequency responses by the settings of a data set with the key ``frequency``.

    Of universal files functions of type 4 and coherences of type 6 between the named degrees of
    freedom; else complex columns, or pairs of columns that the names of channels tell with a word.
    """
    path = Path(folder) / name
    of_file = _of_functions if format_of(path) == "uff" else _of_columns
    responses, outputs, inputs = of_file(path, channels)
    axes, *columns, units = zip(*responses, strict=True)
    if not all(np.array_equal(axis, axes[0]) for axis in axes):
        problem = "the responses have different frequencies"
        raise InputError(str(path), problem, "choose some that were measured together")
    kept = slice(int(axes[0].size > 0 and not axes[0][0] > 0.0), None)
    values, coherence, variances = (
        None if any(c is None for c in parts) else np.column_stack(parts)[kept] for parts in columns
    )
    assert values is not None
    shape = -1, len(outputs), len(inputs)
    absolute = variances is not None
    if variances is None and coherence is not None:
        if (wrong := ((coherence < 0.0) | (coherence > MOST_COHERENT)).any(axis=1)).any():
            place = f"frequency {int(np.argmax(wrong)) + 1 + (kept.start or 0)}"
            problem = "a coherence lies outside 0 to 1"
            raise InputError(str(path), problem, "correct it, or leave its column out", place)
        variances = variances_of(values, coherence)
    values = values.reshape(shape)
    variances = None if variances is None else variances.reshape(shape)
    of_inputs, of_outputs = (
        of_each(getattr(channels, f"{role}_unit"), names, str(path), f"{role}_unit", role)
        for role, names in (("input", inputs), ("output", outputs))
    )
    pairs = zip(of_outputs, units[:: len(inputs)], strict=True)
    return FrequencyResponses(
        frequencies=axes[0][kept],
        values=values,
        variances=variances,
        are_absolute=absolute,
        sampling_rate=channels.sampling_rate,
        input_names=inputs,
        output_names=outputs,
        input_units=tuple(unit or "" for unit in of_inputs),
        output_units=tuple(unit or stated for unit, stated in pairs),
        source=str(path),
    )


def _of_functions(path: Path, channels: ChannelSettings) -> Read:
    channel_names(path)  # refuses a file that is not there
    functions = frequency_functions(path)
    roles = []
    for place, listed in enumerate((channels.outputs, channels.inputs)):
        names = list(dict.fromkeys(str(key[place]) for key in functions if not key[2]))
        wanted = [name for asked in listed for name in names if fnmatchcase(name, str(asked))]
        if not wanted:
            problem = f"no frequency response belongs to {', '.join(map(str, listed))}"
            raise InputError(str(path), problem, f"choose among {listing(names)}")
        roles.append(tuple(dict.fromkeys(wanted)))
    responses = []
    for output, reference in product(*roles):
        if (output, reference, False) not in functions:
            problem = f"there is no frequency response of {output} to {reference}"
            raise InputError(str(path), problem, "choose outputs that all inputs have")
        axis, values, unit = functions[output, reference, False]
        coherence = functions.get((output, reference, True), (axis, values[:0], ""))[1].real
        known = coherence if coherence.size == values.size else None
        responses.append((axis, values, known, None, unit))
    return responses, roles[0], roles[1]


def _of_columns(path: Path, channels: ChannelSettings) -> Read:
    (axis,) = read_channels(path, [channels.frequency or 1])
    if axis.unit not in ("", "Hz") or axis.values.dtype.kind not in "fiu":
        problem = f'the column "{axis.name}" holds no frequencies in Hz'
        raise InputError(str(path), problem, "choose another column, or convert it")
    names, frequencies = channel_names(path), axis.values.astype(float)
    there = responses_named(names)
    outputs, inputs = (
        _expanded(listed, [name.partition("/")[place] for name in there])
        for listed, place in ((channels.outputs, 0), (channels.inputs, 2))
    )
    places = {_plain(split_heading(name)[0]): number for number, name in enumerate(names, 1)}
    responses = []
    for output, reference in product(outputs, inputs):
        heads = [f"{output}/{reference}", output][: 1 + (len(inputs) == 1)]
        heads += [""] * (len(inputs) == len(outputs) == 1)
        columns: dict[str, int] = {}
        for head in reversed(heads):
            spelled = ((kind, _plain(f"{head} {word}")) for word, kind in _PARTS.items())
            columns |= {kind: places[plain] for kind, plain in spelled if plain in places}
            columns |= {"complex": names.index(head) + 1} if head in names else {}
        if not any(parts <= columns.keys() for parts in _WHOLE):
            problem = f"no columns hold the response of {output} to {reference}"
            problem += f", but of {', '.join(there)}" if there else ""
            remedy = f'name them "{output} real" and "{output} imag", or magnitude and phase'
            raise InputError(str(path), problem, remedy)
        read = read_channels(path, list(columns.values()))
        parts = {kind: part.values for kind, part in zip(columns, read, strict=True)}
        if any(part.dtype.kind not in "cfiu" for part in parts.values()):
            raise InputError(str(path), f"a column of {output} holds text", "repair it")
        if "complex" in parts:
            values = parts["complex"].astype(complex)
        elif _WHOLE[1] <= parts.keys():
            values = parts["real"] + 1j * parts["imaginary"]
        else:
            magnitude, phase = parts["magnitude"], parts["phase"]
            # Units that are spelled otherwise, "(dB re 1 N)" or "(Radians)", are in the name alone.
            headings = (names[place - 1] for place in columns.values())
            units = {
                kind: f"{part.unit} {heading.removeprefix(split_heading(heading)[0])}"
                for kind, heading, part in zip(columns, headings, read, strict=True)
            }
            if _DECIBELS.search(units["magnitude"]):
                magnitude = 10.0 ** (magnitude / 20.0)
            radians = _RADIANS.search(units["phase"])
            prefix = (radians[1] or "").lower() if radians else "degree"
            unit = _RADIAN.get(prefix, 1e-6)
            values = magnitude * np.exp(1j * unit * phase)
        responses.append((frequencies, values, parts.get("coherence"), parts.get("variance"), ""))
    return responses, outputs, inputs


def responses_named(names: Sequence[str]) -> list[str]:
    """The responses of which two parts or more are there: tip, of ``tip real``, ``tip imag``."""
    words = "|".join(sorted(_PARTS, key=len, reverse=True))
    part = re.compile(rf"(.+?){_BETWEEN}(?:{words})(?:{_BETWEEN})?", re.IGNORECASE)
    counts = Counter(
        match.group(1) for name in names if (match := part.fullmatch(split_heading(name)[0]))
    )
    return [name for name, count in counts.items() if count > 1]


def _expanded(listed: Sequence[Reference], names: Sequence[str]) -> tuple[str, ...]:
    """Channels with every pattern replaced by the names that fit it; itself where none does."""
    expanded = list[str]()
    for asked in map(str, listed):
        fitting = [name for name in names if is_pattern(asked) and fnmatchcase(name, asked)]
        expanded += fitting or [asked]
    return tuple(dict.fromkeys(expanded))


def _plain(name: str) -> str:
    return " ".join(re.split(_BETWEEN, name.casefold())).strip()
