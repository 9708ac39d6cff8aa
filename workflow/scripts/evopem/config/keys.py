"""The keys of ``config.yaml`` as types; those of a mapping such as ``search`` are its settings.

Values come out in one form: ranges as tuples, paths, channels and units as they were written.
"""

# Types are made here, which a type checker cannot follow.
# mypy: disable-error-code="valid-type,misc"

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
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
    UnitSettings,
    built_in,
    key,
)
from evopem.config.configuration import RunSettings
from evopem.config.constraints import Constraints
from evopem.config.settings import (
    Focus,
    InputRanges,
    OutputWeighting,
    Purpose,
    Recipe,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    StateSpaceForm,
    Structure,
    TransformSettings,
)

STATE_SPACE = "state_space"
Value = TypeVar("Value")


_STRICT = ConfigDict(extra="forbid", strict=True)


def mapping(name: str, keys: Mapping[str, Any], required: Iterable[str] = ()) -> Any:
    """The type of a mapping with these keys, of which none but some have to be there."""
    kinds = {key: Required[each] if key in required else each for key, each in keys.items()}
    kind = TypedDict(name, kinds, total=False)
    kind.__pydantic_config__ = _STRICT  # type: ignore[attr-defined]
    return kind


def keys_of_fields(settings: type, names: Iterable[str] = ()) -> dict[str, Any]:
    """Fields of settings as keys, all of them or some; a user leaves out what is None."""
    hints, said = get_type_hints(settings, include_extras=True), _said_of_fields(settings)
    wanted = list(names) or [each.name for each in fields(settings)]
    return {
        name.rstrip("_"): _about(_without_none(hints[name]), said[name])
        if name in said
        else _without_none(hints[name])
        for name in wanted
    }


def _said_of_fields(settings: type) -> dict[str, str]:
    """The text below each field of settings."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(settings))).body
    assert isinstance(body, ast.ClassDef)
    return {
        field.target.id: " ".join(str(said.value.value).split())
        for field, said in pairwise(body.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(said, ast.Expr) and isinstance(said.value, ast.Constant)
    }


def _without_none(hint: Any) -> Any:
    kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    members = [each for each in get_args(kind) if each is not NoneType]
    if NoneType in get_args(kind):
        kind = Union[tuple(members)]  # noqa: UP007
    return Annotated[(kind, *notes)] if notes else kind


def _about(kind: Any, description: str, value: str = "") -> Any:
    return Annotated[(kind, key(description), *([built_in(value)] if value else []))]


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
    one = _range(low, high)
    several = Annotated[tuple[one, ...], Field(min_length=1)]
    by_name = Annotated[dict[str, one], Field(min_length=1)]

    def checked(value: Any) -> Any:
        if isinstance(value, list) and value:
            nested = [isinstance(each, list) for each in value]
            if any(nested) and not all(nested):
                raise ValueError("it has numbers beside ranges: write a number n as [n, n]")
            if not any(nested) and len(value) != 2:
                raise ValueError(
                    "it is no range, which has a lower and an upper end: for one number of each"
                    " input write ranges, such as [[2, 2], [1, 1]], or a mapping such as {hot: 2,"
                    " cold: 1}"
                )
        return tuple(value) if isinstance(value, list) else value

    return Annotated[Union[one, several, by_name], BeforeValidator(checked)]  # noqa: UP007


def input_ranges_of(value: Any) -> InputRanges:
    """The ranges of a checked value."""
    if isinstance(value, Mapping):
        return InputRanges(by_name=dict(value))
    if value and isinstance(value[0], tuple):
        return InputRanges(in_order=tuple(value))
    return InputRanges(value)


def one_or_list(values: Sequence[Value]) -> Value | list[Value] | None:
    """What stands under a key that has one value or a list of them."""
    return list(values) if len(values) > 1 else next(iter(values), None)


def units_of(value: Any) -> UnitSettings:
    """The units of a checked value."""
    if isinstance(value, Mapping):
        return UnitSettings(by_name=dict(value))
    return UnitSettings(value) if isinstance(value, str) else UnitSettings(in_order=tuple(value))


_Text = Annotated[str, Field(min_length=1)]
_Path = Annotated[str, Field(min_length=1, description="the path of a recording")]
_PATHS = (
    "the path of a recording, relative to the working directory, or a list or pattern of several"
)
_Paths = Annotated[_Text | Annotated[tuple[_Path, ...], Field(min_length=1)], Field()]
_Channels = Annotated[Reference | Annotated[tuple[Reference, ...], Field(min_length=1)], Field()]
_CHANNELS = "a column number from 1, or a column, variable or channel name, or a list of them"
_Units = str | tuple[str, ...] | dict[str, str]
_UNITS = (
    'a unit as text, such as "N m"; of several channels, a list of units or a mapping from names to'
    " units"
)
COLUMNS = (*("sampling_rate", "time", "time_unit", "header_lines", "decimal_mark"), "uneven_time")
"""Keys of a recorded file beside its channels."""

SOURCE: dict[str, Any] = {
    "file": _about(
        _Paths,
        f"{_PATHS}. Text (`.csv`, `.tsv`, `.txt`, `.dat`, `.asc`), MATLAB `.mat` (v5 and v7.3),"
        " `.npz`, `.npy`, `.parquet`, `.h5`, `.hdf5`, `.tdms`, `.uff`, `.unv`; the extension"
        " decides",
        "required",
    ),
    "input": _about(
        _Channels,
        f"{_CHANNELS}, or none. A name with a `*` stands for all channels that match",
        "[decided from the file](#the-file-alone), else 1",
    ),
    "output": _about(
        _Channels,
        f"{_CHANNELS}. A name with a `*` stands for all channels that match and that no other key"
        " names",
        "[decided from the file](#the-file-alone), else 2",
    ),
    "input_unit": _about(_Units, f"{_UNITS}. Used on every axis", "those in the file"),
    "output_unit": _about(_Units, f"{_UNITS}. Used on every axis", "those in the file"),
    **keys_of_fields(ChannelSettings, COLUMNS),
    "validation_file": _about(
        _Paths,
        "the path of an independent recording, relative to the working directory, or a list or"
        " pattern of several. Of the same layout and rate, to validate on instead of a cut of"
        " this one",
    ),
}
SYNTHESIS = keys_of_fields(SyntheticSource)
ANALYSIS: dict[str, Any] = {
    "recipe": _about(
        Recipe,
        "how a model is found. `chapter`: a structure that is given, and the chapter's phases of"
        " its orders; `auto`: the [automatic recipe](automatic.md)",
        "`auto`; of `arma` and `general` `chapter`",
    ),
    "purpose": _about(
        Purpose,
        "what the model is for. `auto` is simulation, or prediction without an input",
        "`auto`",
    ),
    "resample": _about(
        Rate | Literal["none"],
        "the new sampling rate in Hz. Below that of the recording, with an anti-alias filter;"
        " with `none` nothing is decimated",
        "`none`",
    ),
    "transforms": _about(
        mapping("Transforms", keys_of_fields(TransformSettings)),
        "the transforms towards stationarity, a mapping of box_cox, difference and"
        " difference_input",
    ),
    "split": _about(
        mapping("Split", keys_of_fields(SplitSettings)),
        "the division of the samples, a mapping of discard, estimation and by",
    ),
    "spectrum": _about(
        mapping("Spectrum", keys_of_fields(SpectrumSettings)),
        "the multitaper estimate, a mapping of time_halfbandwidth and nfft",
    ),
    "structure": _about(
        Structure | Literal["state_space"],
        "the [structure](#the-structure-of-the-model) of the model",
        "`armax`",
    ),
    "form": _about(
        StateSpaceForm, "the [form](structures.md#state-space) of a state-space model", "decided"
    ),
    "weighting": _about(
        OutputWeighting,
        "[how](structures.md#what-is-minimised) the outputs of a state-space model are weighed",
        "`determinant`, of output error `noise`",
    ),
    "level": _about(bool, "whether a constant is estimated along", "`false`"),
    "delay": _about(
        mapping(
            "Delay",
            {
                "orders": _about(
                    _range(1, 60),
                    "the orders k of the delay search. Of the models that are estimated for each"
                    " delay, such as ARMAX(k, k, k, nk)",
                    "[6, 9]",
                ),
                "nk": _about(
                    _input_ranges(0, 1000),
                    "the delays in samples. 0 acts on the same sample",
                    "[0, 3]",
                ),
            },
        ),
        "the grid of the delay search, a mapping of orders and nk",
    ),
    "orders": _about(
        mapping(
            "Orders",
            {
                "joint": _about(
                    _range(1, 60) | Literal["auto"],
                    "the order k of phase one. Of ARMAX(k, k, k, nk) or what [other"
                    " structures](structures.md) have instead. `auto` is [2 × number of spectral"
                    " peaks, 14]; the evenly spaced lines of a periodic input are not counted as"
                    " peaks",
                    "[6, 14]",
                ),
                "nc": _about(_range(0, 60), "the orders of C", "[2, 16]"),
                "nd": _about(_range(0, 60), "the orders of D", "[0, 4]"),
                "na": _about(
                    _range(0, 60), "the orders of A beside F, or of A with several inputs", "[0, 2]"
                ),
                "nb": _about(_input_ranges(1, 60), "the orders of B. The last phase", "[2, 16]"),
                "nf": _about(
                    _input_ranges(0, 60),
                    "the orders of F with several inputs",
                    "follow the order k",
                ),
                "nx": _about(
                    _range(1, 60),
                    "the numbers of states. Of `ss_oe` and `ss_bj` those of the plant",
                    "as far as the record goes, at most 20; up to 40 while BIC falls",
                ),
            },
        ),
        "the ranges of the order search, a mapping of joint, nc, nd, na and nb, with several"
        " inputs also nf, or of nx for state_space",
    ),
    "search": _about(
        mapping("Search", keys_of_fields(SearchSettings)),
        "the search for the parameters of a model, a mapping of its settings",
    ),
    "focus": _about(
        Focus, "the errors that the model is [fitted for](structures.md#focus)", "`prediction`"
    ),
    "constraints": _about(
        mapping("Constraints", keys_of_fields(Constraints)),
        "the [constraints](structures.md#constraints) of the model, a mapping of them",
    ),
    "geometry": _about(
        Geometry,
        "the structure over which mode shapes are drawn, a mapping of points, lines and channels",
    ),
}
SOURCE_OF_ANY: dict[str, Any] = {
    "conditions": _about(
        dict[str, _about(int | float | str, "a number, or a date such as 2026-03-01T12:30")],
        "names of conditions with their numbers or dates, such as temperature with 21.5. See"
        " `follow`",
    )
}
_DATASET = _about(
    mapping("Dataset", SOURCE_OF_ANY | SYNTHESIS | SOURCE | ANALYSIS),
    "a mapping with `file` or `synthesis` in it",
)
RUN: dict[str, Any] = {
    "datasets": _about(
        Annotated[dict[str, _DATASET], Field(min_length=1)],
        "at least one data set, as `name` with its keys below it, or the [path of a"
        " table](#many-data-sets)",
        "required",
    ),
    "defaults": _about(
        mapping("Defaults", ANALYSIS),
        f"keys of the analysis ({', '.join(ANALYSIS)}). For every data set that does not set them",
    ),
    **keys_of_fields(RunSettings),
}
CONFIGURATION = mapping("Configuration", RUN, ("datasets",))
