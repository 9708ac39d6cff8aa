"""The keys of ``config.yaml`` as types; those of a mapping such as ``search`` are its settings.

Values come out in one form: ranges as tuples, paths, channels and units as they were written.
"""

# Types are made here, which a type checker cannot follow.
# mypy: disable-error-code="valid-type,misc"

import ast
import inspect
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import pairwise
from types import NoneType
from typing import (
    Annotated,
    Any,
    Literal,
    Required,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field
from typing_extensions import TypedDict

from evopem.config.channels import (
    ChannelSettings,
    Geometry,
    Rate,
    Reference,
    SyntheticSource,
    Units,
    built_in,
    key,
)
from evopem.config.configuration import RunSettings
from evopem.config.constraints import Constraints
from evopem.config.settings import (
    Focus,
    Hold,
    OutputWeighting,
    Purpose,
    Recipe,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    StateSpaceForm,
    Structure,
    TransformSettings,
    VaryingSettings,
)
from evopem.config.strict_yaml import Keys

STATE_SPACE = "state_space"
Value = TypeVar("Value")


def mapping(name: str, keys: Keys, required: Iterable[str] = ()) -> Any:
    """The type of a mapping with these keys, of which none but some have to be there."""
    kinds = {key: Required[kind] if key in required else kind for key, kind in keys.items()}
    kind = TypedDict(name, kinds, total=False)
    strict = ConfigDict(extra="forbid", strict=True)
    kind.__pydantic_config__ = strict  # type: ignore[attr-defined]
    return kind


def keys_of_fields(settings: type, names: Iterable[str] = ()) -> Keys:
    """Fields of settings as keys, all of them or some; a user leaves out what is None."""
    hints = get_type_hints(settings, include_extras=True)
    said = _said_of_fields(settings.__module__)[settings.__name__]
    return {
        name.rstrip("_"): _about(_without_none(hints[name]), said[name])
        if name in said
        else _without_none(hints[name])
        for name in (names or hints)
    }


def _group(settings: type) -> Any:
    return mapping(settings.__name__.strip("_"), keys_of_fields(settings))


@cache  # a module is parsed once, not for each of its classes
def _said_of_fields(module: str) -> dict[str, dict[str, str]]:
    """The text below each field of the classes of a module."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {
        settings.name: {
            field.target.id: " ".join(str(said.value.value).split())
            for field, said in pairwise(settings.body)
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if isinstance(said, ast.Expr) and isinstance(said.value, ast.Constant)
        }
        for settings in tree.body
        if isinstance(settings, ast.ClassDef)
    }


def _without_none(hint: Any) -> Any:
    kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    members = [alternative for alternative in get_args(kind) if alternative is not NoneType]
    if NoneType in get_args(kind):
        kind = Union[tuple(members)]  # noqa: UP007
    return Annotated[(kind, *notes)] if notes else kind


def _about(kind: Any, description: str) -> Any:
    return Annotated[kind, key(description)]


def _both_ends(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return (value, value) if isinstance(value, int) and not isinstance(value, bool) else value


def _ascending(ends: tuple[int, int]) -> tuple[int, int]:
    if ends[0] > ends[1]:
        raise ValueError(f"the lower end is above the upper one: write [{ends[1]}, {ends[0]}]")
    return ends


def _range(low: int, high: int) -> Any:
    order = _about(Annotated[int, Field(ge=low, le=high)], f"a whole number from {low} to {high}")
    return Annotated[
        tuple[order, order],
        BeforeValidator(_both_ends, json_schema_input_type=order | tuple[order, order]),
        AfterValidator(_ascending),
    ]


def _input_ranges(low: int, high: int) -> Any:
    """A range of all inputs, a list of ranges in their order, or a mapping from their names."""
    of_all = _range(low, high)
    in_order = Annotated[tuple[of_all, ...], Field(min_length=1)]
    by_name = Annotated[dict[str, of_all], Field(min_length=1)]

    def checked(value: Any) -> Any:
        if isinstance(value, list) and value:
            nested = [isinstance(item, list) for item in value]
            if any(nested) and not all(nested):
                raise ValueError("it has numbers beside ranges: write a number n as [n, n]")
            if not any(nested) and len(value) != 2:
                raise ValueError(
                    "it is no range, which has a lower and an upper end: for one number of each"
                    " input write ranges, such as [[2, 2], [1, 1]], or a mapping such as {hot: 2,"
                    " cold: 1}"
                )
        return tuple(value) if isinstance(value, list) else value

    return Annotated[Union[of_all, in_order, by_name], BeforeValidator(checked)]  # noqa: UP007


def one_or_list(values: Sequence[Value]) -> Value | list[Value] | None:
    """What stands under a key that has one value or a list of them."""
    return list(values) if len(values) > 1 else next(iter(values), None)


_Text = Annotated[str, Field(min_length=1)]
_Path = Annotated[str, Field(min_length=1, description="the path of a recording")]
_Paths = Annotated[_Text | Annotated[tuple[_Path, ...], Field(min_length=1)], Field()]
_Channels = Annotated[Reference | Annotated[tuple[Reference, ...], Field(min_length=1)], Field()]
_Unit = Annotated[Units, built_in("those in the file")]
_Condition = Annotated[int | float | str, key("a number, or a date such as 2026-03-01T12:30")]
COLUMNS = (
    *("sampling_rate", "time", "time_unit", "header_lines", "decimal_mark", "uneven_time"),
    "frequency",
)
"""Keys of a recorded file beside its channels."""


class _Recorded:
    file: Annotated[_Paths, built_in("required")]
    """the path of a recording, relative to the working directory, or a list or pattern of several.
    The extension tells its [format](formats.md)"""
    input: Annotated[_Channels, built_in("[decided from the file](#the-file-alone), else 1")]
    """a column number from 1, or a column, variable or channel name, or a list of them, or none. A
    name with a `*` stands for all channels that match"""
    output: Annotated[_Channels, built_in("[decided from the file](#the-file-alone), else 2")]
    """a column number from 1, or a column, variable or channel name, or a list of them. A name with
    a `*` stands for all channels that match and that no other key names"""
    input_unit: _Unit
    """a unit as text, such as "N m"; of several channels, a list of units or a mapping from names
    to units. Used on every axis"""
    output_unit: _Unit
    """a unit as text, such as "N m"; of several channels, a list of units or a mapping from names
    to units. Used on every axis"""


class _Validating:
    validation_file: _Paths
    """the path of an independent recording, relative to the working directory, or a list or pattern
    of several. Of the same layout and rate, to validate on instead of a cut of this one"""


class _Delay:
    orders: Annotated[_range(1, 60), built_in("[6, 9]")]
    """the orders k of the delay search. Of the models that are estimated for each delay, such as
    ARMAX(k, k, k, nk)"""
    nk: Annotated[_input_ranges(0, 1000), built_in("[0, 3]")]
    """the delays in samples. 0 acts on the same sample"""


class _Orders:
    plant: Annotated[_range(1, 60) | Literal["auto"], built_in("[6, 14]")]
    """the order k of phase one. Of ARMAX(k, k, k, nk) or what [other structures](structures.md)
    have instead. `auto` is [2 × number of spectral peaks, 14]; the evenly spaced lines of a
    periodic input are not counted as peaks"""
    nc: Annotated[_range(0, 60), built_in("[2, 16]")]
    """the orders of C"""
    nd: Annotated[_range(0, 60), built_in("[0, 4]")]
    """the orders of D"""
    na: Annotated[_range(0, 60), built_in("[0, 2]")]
    """the orders of A beside F, of A with `recipe: auto`"""
    nb: Annotated[_input_ranges(1, 60), built_in("[2, 16]")]
    """the orders of B. The last phase"""
    nf: Annotated[_input_ranges(0, 60), built_in("follow the order k")]
    """the orders of F. With `recipe: auto`"""
    nx: Annotated[
        _range(1, 60), built_in("as far as the recording goes, at most 20; to 40 while BIC falls")
    ]
    """the numbers of states. Of `ss_oe` and `ss_bj` those of the plant"""


class _Analysis:
    recipe: Annotated[Recipe, built_in("`auto`")]
    """how a model is found. `chapter`: a structure that is given, and the chapter's phases of its
    orders; `auto`: the [automatic recipe](automatic.md)"""
    purpose: Annotated[Purpose, built_in("`auto`")]
    """what the model is for. `auto` is simulation, or prediction without an input"""
    resample: Annotated[Rate | Literal["none"], built_in("`none`")]
    """the new sampling rate in Hz. Below that of the recording, with an anti-alias filter; with
    `none` nothing is decimated"""
    transforms: _group(TransformSettings)
    """the transforms towards stationarity, a mapping of box_cox, difference, difference_input and
    difference_pole"""
    split: _group(SplitSettings)
    """the division of the samples, a mapping of discard, estimation and by"""
    spectrum: _group(SpectrumSettings)
    """the multitaper estimate, a mapping of time_halfbandwidth and nfft"""
    structure: Annotated[Structure | Literal["state_space"], built_in("`armax`")]
    """the [structure](#the-structure-of-the-model) of the model"""
    form: Annotated[StateSpaceForm, built_in("decided")]
    """the [form](structures.md#state-space) of a state-space model"""
    weighting: Annotated[OutputWeighting, built_in("`determinant`, of output error `noise`")]
    """[how](structures.md#what-is-minimised) the outputs of a state-space model are weighed"""
    level: Annotated[bool, built_in("`false`")]
    """whether a constant is estimated along"""
    delay: _group(_Delay)
    """the grid of the delay search, a mapping of orders and nk"""
    orders: _group(_Orders)
    """the ranges of the order search, a mapping of plant, nc, nd, na and nb, with `recipe: auto`
    also nf, or of nx for state_space"""
    search: _group(SearchSettings)
    """the search for the parameters of a model, a mapping of its settings"""
    focus: Annotated[Focus, built_in("`prediction`")]
    """the errors that the model is [fitted for](structures.md#focus)"""
    constraints: _group(Constraints)
    """the [constraints](structures.md#constraints) of the model, a mapping of them"""
    continuous_time: Annotated[Hold, built_in("none")]
    """the hold of the input with which the model is [given in s](structures.md#continuous-time)"""
    varying: Annotated[
        Literal["auto", "none"] | _group(VaryingSettings),
        built_in("`auto`, with `recipe: chapter` `none`"),
    ]
    """whether a model whose coefficients [move](structures.md#moving-coefficients) is tried. `auto`
    where the machine seems to change; a mapping of basis and dimension tries it always"""
    geometry: Geometry
    """the structure over which mode shapes are drawn, a mapping of points, lines and channels"""


class _Any:
    conditions: dict[str, _Condition]
    """names of conditions with their numbers or dates, such as temperature with 21.5. See
    `follow`"""


SOURCE = (
    keys_of_fields(_Recorded)
    | keys_of_fields(ChannelSettings, COLUMNS)
    | keys_of_fields(_Validating)
)
SYNTHESIS = keys_of_fields(SyntheticSource)
ANALYSIS = keys_of_fields(_Analysis)
SOURCE_OF_ANY = keys_of_fields(_Any)
_DATASET = _about(
    mapping("Dataset", SOURCE_OF_ANY | SYNTHESIS | SOURCE | ANALYSIS),
    "a mapping with `file` or `synthesis` in it",
)


class _Run:
    datasets: Annotated[dict[str, _DATASET], Field(min_length=1), built_in("required")]
    """at least one data set, as `name` with its keys below it, or the [path of a
    table](#many-data-sets)"""
    defaults: mapping("Defaults", ANALYSIS)
    """keys of the analysis, of which each data set takes those that it has and does not set"""


RUN = keys_of_fields(_Run) | keys_of_fields(RunSettings)
CONFIGURATION = mapping("Configuration", RUN, ("datasets",))
