"""Where the samples of a data set come from, and where they were measured."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from evopem.errors import InputError


def key(description: str, **bounds: Any) -> Any:
    """What is said of a key: a clause that ends an error, behind its first full stop text for the
    documentation, and bounds. A field says it in the text below it."""
    return Field(description=description, **bounds)


def built_in(text: str) -> Any:
    """What is taken where a key is not written, where that is not the default of its field."""
    return Field(json_schema_extra={"built_in": text})


NONE = "none"  # no input, or no resampling

Reference = Annotated[int, Field(ge=1)] | Annotated[str, Field(min_length=1)]
"""A channel: its number from 1, or its name, in which a ``*`` stands for any text."""

Rate = Annotated[float, key("the sampling rate in Hz", ge=1e-9, le=1e12)]
Seed = Annotated[int, key("the seed of all random draws", ge=0)]

Units = str | tuple[str, ...] | dict[str, str]
"""The unit of all channels, of each in their order, or by their names."""


def of_each(
    given: Any, names: Sequence[str], source: str, place: str = "", role: str = "input"
) -> tuple[Any, ...]:
    """What is given for each channel: for all, for each in order, or by names; else None."""
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                problem, remedy = f"there is no {role} {name}", f"name one of {', '.join(names)}"
                raise InputError(source, problem, remedy, place)
        return tuple(map(given.get, names))
    # A range of whole numbers is one value.
    if not isinstance(given, tuple) or isinstance(next(iter(given), None), int):
        return (given,) * len(names)
    if len(given) != len(names):
        problem = f"there are {len(given)} values and {len(names)} {role}s"
        remedy = "give one for each, one for all, or a mapping from their names"
        raise InputError(source, problem, remedy, place)
    return given


@dataclass(frozen=True)
class ChannelSettings:
    """Which channels of a recorded file are read, and what is known of them.

    What is None is taken from the file.
    """

    # Column numbers from 1, or names of columns, variables or channels; one with a ``*`` stands for
    # all that it matches.  No inputs for a structure that has none.
    inputs: tuple[Reference, ...] = (1,)
    outputs: tuple[Reference, ...] = (2,)
    sampling_rate: Rate | None = None
    """the sampling rate in Hz. It may be left out where the file states it or has time stamps"""
    time: Annotated[
        Reference | None,
        built_in(
            "where no rate is stated, the channel whose name holds a word for time (`t`, `Time"
            " [s]`, `timestamp`, ...), with uniform stamps in a known unit"
        ),
    ] = None
    """the number or name of the column that holds the time. Instead of `sampling_rate`; it is
    checked to be uniform"""
    time_unit: Annotated[
        Literal["s", "ms", "us", "ns", "min", "h", "d"] | None, built_in("that in the file")
    ] = None
    """the unit of the time column"""
    input_unit: Units | None = None
    output_unit: Units | None = None
    header_lines: Annotated[Annotated[int, Field(ge=0)] | None, built_in("found")] = None
    """the number of lines above the first row of numbers. Of text tables"""
    decimal_mark: Annotated[Literal[".", ","] | None, built_in("found")] = None
    """the decimal mark of the numbers. Of text tables"""
    frequency: Annotated[Reference | None, built_in("samples in time")] = None
    """the column of frequencies in Hz. Of [frequency responses](formats.md#frequency-responses)"""
    uneven_time: Literal["refuse", "interpolate"] = "refuse"
    """what is done where the time stamps are not uniform. `interpolate`: signals whose stamps are
    late or missing at times are [brought to even times](formats.md#time-stamps)"""


def listed(value: Any) -> tuple[Any, ...]:
    """Channels or paths of a list, of one of them, or of none."""
    if value is None or value == NONE:
        return ()
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def is_pattern(reference: object) -> bool:
    """Whether a reference stands for all channels whose names it matches."""
    return isinstance(reference, str) and "*" in reference


def are_one(references: tuple[Reference, ...]) -> bool:
    """Whether there is one channel, which no pattern stands for."""
    return len(references) == 1 and not is_pattern(references[0])


@dataclass(frozen=True)
class RecordedSource:
    """Recorded files of one system, and independent ones for validation where there are any."""

    files: tuple[str, ...]  # one, or several that are one data set
    channels: ChannelSettings  # the same in all files
    validation_files: tuple[str, ...] = ()
    channels_from_file: bool = False  # input, output and time are decided from the first file

    @property
    def all_files(self) -> tuple[str, ...]:
        """The recorded files, those for validation last."""
        return (*self.files, *self.validation_files)


@dataclass(frozen=True)
class SyntheticSource:
    """A simulated recording."""

    synthesis: Literal["flexible_arm", "armax"]
    """the simulated system. `flexible_arm` is a physical arm on a servomotor, `armax` a known ARMAX
    process"""
    seed: Seed = 1
    samples: Annotated[int, Field(ge=200, le=10**9)] = 5000
    """the number of samples"""
    sampling_rate: Rate = 100.0
    noise: Annotated[Annotated[float, Field(ge=0, le=1e6)] | None, built_in("0.1")] = None
    """the ratio of noise to output. Of `armax` alone"""
    softening: Annotated[Annotated[float, Field(ge=0, lt=1)] | None, built_in("0")] = None
    """the share by which the arm's frequencies fall along the recording. Of `flexible_arm` alone"""

    validation_files = all_files = ()  # nothing is recorded


def _vector(value: Any) -> Any:
    if isinstance(value, str) and value.lstrip("+-") in ("x", "y", "z") and len(value) <= 2:
        size = -1.0 if value.startswith("-") else 1.0
        return tuple(size if axis == value.lstrip("+-") else 0.0 for axis in "xyz")
    if isinstance(value, list):
        return (*value, 0.0) if len(value) == 2 else tuple(value)
    return value


_Point = Annotated[str, BeforeValidator(lambda name: str(name) if isinstance(name, int) else name)]
_Vector = Annotated[tuple[float, float, float], BeforeValidator(_vector)]


@dataclass(frozen=True)
class ChannelPlace:
    """Where an output was measured: a point, and a direction of any length above 0."""

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    point: Annotated[_Point, key("the name of a point")]
    direction: Annotated[_Vector, key("three numbers, or one of x, y, z, -x, -y, -z")]


@dataclass(frozen=True)
class Geometry:
    """The structure that mode shapes are drawn over."""

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    points: Annotated[
        Annotated[
            dict[str, Annotated[_Vector, key("two or three coordinates, such as [0, 0, 1]")]],
            Field(min_length=1),
        ],
        key("the points by name, such as {tip: [0, 0, 1]}"),
    ]
    channels: Annotated[
        Annotated[dict[str, ChannelPlace], Field(min_length=1)],
        key(
            "the outputs by name with their points and directions, such as {acc1: {point: tip,"
            " direction: z}}"
        ),
    ]
    lines: Annotated[
        tuple[tuple[_Point, _Point], ...], key("a list of pairs of points, such as [[root, tip]]")
    ] = ()


def joined_geometry(parts: Iterable[Geometry | None]) -> Geometry | None:
    """The points, channels and lines of several set-ups; None without any."""
    given = [part for part in parts if part]
    points = {name: place for part in given for name, place in part.points.items()}
    channels = {name: place for part in given for name, place in part.channels.items()}
    lines = dict.fromkeys(line for part in given for line in part.lines)
    return Geometry(points, channels, tuple(lines)) if given else None
