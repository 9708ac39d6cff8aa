"""The JSON form of the package's dataclasses: one conversion for all of them.

A complex number is its real and imaginary part, and a number that is not finite null, which is read
as NaN where the field is a float. A field whose name ends with an underscore loses it. Values are
not converted from one type to another: 2.7 or "2" are no whole number.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from reprlib import repr as shortened
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override

from evopem.errors import InputError
from evopem.files.atomic import write_json

T = TypeVar("T")

_REMEDY = "delete the file and run snakemake again, which writes it anew"


def to_json(value: object) -> Any:
    """Convert a dataclass, or a sequence or mapping of them, to what JSON can hold."""
    return _converter().unstructure(value)


def from_json(kind: type[T], content: object, source: str = "the content") -> T:
    """Build a dataclass, or a type such as ``tuple[Candidate, ...]``, from what `to_json` returned.

    An `InputError` says where the content of ``source``, a file or key, has another form.

    Examples
    --------
    >>> from evopem.models.structures import Orders
    >>> from_json(Orders, {"na": 2, "nb": [1], "nc": 2, "nk": [3]})
    Orders(na=2, nb=(1,), nc=2, nd=0, nf=(0,), nk=(3,), structure='armax')
    >>> from_json(Orders, {"na": 2.5, "nb": [1], "nc": 2, "nk": [3]}, "model.json")
    Traceback (most recent call last):
    ...
    evopem.errors.InputError: model.json, na: 2.5 is not a whole number; delete the file ...
    """
    try:
        return _converter().structure(content, kind)
    except Exception as error:
        first = cattrs.transform_error(error, path="", format_exception=_explained)[0]
        problem, _, place = first.rpartition(" @ ")
        raise InputError(source, problem, _REMEDY, place.removeprefix(".")) from None


def save(value: object, path: str | Path) -> None:
    """Write a dataclass, or a sequence of them, as JSON."""
    write_json(path, to_json(value))


def load(kind: type[T], path: str | Path) -> T:
    """Read the dataclass that :func:`save` wrote; an `InputError` names what is wrong."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", _REMEDY) from None
    except (ValueError, RecursionError):
        raise InputError(str(path), "is not valid JSON", _REMEDY) from None
    return from_json(kind, content, str(path))


@cache
def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_unstructure_hook(float, _finite_or_none)
    converter.register_unstructure_hook(bool, bool)  # of numpy, which JSON does not take
    converter.register_structure_hook(float, _float)
    for kind, what in ((int, "a whole number"), (bool, "true or false"), (str, "a text")):
        converter.register_structure_hook(kind, partial(_exact, what))
    converter.register_unstructure_hook(complex, _real_and_imaginary)
    converter.register_structure_hook(complex, lambda pair, _: complex(*pair))
    converter.register_unstructure_hook_func(_is_array, _array_to_list)
    converter.register_structure_hook_func(_is_array, _list_to_array)
    converter.register_structure_hook_func(lambda kind: get_origin(kind) is Literal, _literal)
    converter.register_structure_hook_func(
        lambda kind: get_origin(kind) is tuple, partial(_tuple, converter)
    )
    converter.register_structure_hook_func(_is_plain_union, partial(_plain, converter))
    converter.register_structure_hook_func(_is_dataclass_union, partial(_nearest, converter))
    converter.register_unstructure_hook_factory(
        is_dataclass,
        lambda kind: make_dict_unstructure_fn(kind, converter, **_renamed(kind)),
    )
    converter.register_structure_hook_factory(
        is_dataclass,
        lambda kind: make_dict_structure_fn(
            kind, converter, _cattrs_forbid_extra_keys=True, **_renamed(kind)
        ),
    )
    return converter


def _renamed(kind: type) -> dict[str, Any]:
    names = [field.name for field in fields(kind)]
    return {name: override(rename=name.rstrip("_")) for name in names if name.endswith("_")}


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _explained(error: BaseException, _: type | None) -> str:
    """Say what is wrong with a value, in a clause."""
    match error:
        case KeyError():
            return f"the key {error.args[0]} is missing"
        case cattrs.ForbiddenExtraKeysError():
            return f"the key {min(error.extra_fields)} is not known"
        case AttributeError() | TypeError():
            return "the content has another form"
    return str(error)


def _float(value: Any, _: type) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{shortened(value)} is not a number")
    return float(value)


def _exact(what: str, value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise ValueError(f"{shortened(value)} is not {what}")
    return value


def _real_and_imaginary(value: complex) -> list[float]:
    return [float(value.real), float(value.imag)]


def _is_array(kind: Any) -> bool:
    origin = get_origin(kind) or kind
    return getattr(origin, "__module__", "") == "numpy" and origin.__name__ == "ndarray"


def _array_to_list(array: Any) -> Any:
    if array.dtype.kind == "c":
        return [_real_and_imaginary(value) for value in array.tolist()]
    return _nan_to_none(array.tolist())


def _nan_to_none(values: Any) -> Any:
    if isinstance(values, list):
        return [_nan_to_none(value) for value in values]
    return _finite_or_none(values) if isinstance(values, float) else values


def _list_to_array(values: Any, kind: Any) -> Any:
    import numpy as np

    if "complex" in str(kind):
        return np.array([complex(*pair) for pair in values], dtype=complex)
    return np.array(values, dtype=float)


def _literal(value: Any, kind: Any) -> Any:
    words = get_args(kind)
    if not isinstance(value, str) or value not in words:
        raise ValueError(f"{shortened(value)} is none of {', '.join(words)}")
    return value


def _tuple(converter: cattrs.Converter, value: Any, kind: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise ValueError(f"{shortened(value)} is not a list")
    members = get_args(kind)
    if members[-1] is not Ellipsis:
        if len(value) != len(members):
            raise ValueError(f"{shortened(value)} has not {len(members)} entries")
        return tuple(map(converter.structure, value, members))
    listed: list[Any] = converter.structure(value, list[members[0]])  # type: ignore[valid-type]
    return tuple(listed)


def _is_plain_union(kind: Any) -> bool:
    """Whether a type is a union that JSON itself tells apart, such as ``int | str | None``."""
    if get_origin(kind) not in (Union, UnionType):
        return False
    plain = (int, float, str, bool)
    members = [_without_notes(each) for each in get_args(kind) if each is not type(None)]
    return len(members) > 1 and all(
        member in plain or get_origin(member) in (Literal, tuple, dict) for member in members
    )


def _without_notes(kind: Any) -> Any:
    """A type without what :class:`typing.Annotated` says of it."""
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _is_dataclass_union(kind: Any) -> bool:
    """Whether a type is a union of dataclasses, perhaps with None."""
    if get_origin(kind) not in (Union, UnionType):
        return False
    members = [member for member in get_args(kind) if member is not type(None)]
    return len(members) > 1 and all(map(is_dataclass, members))


def _nearest(converter: cattrs.Converter, value: Any, kind: Any) -> Any:
    """The member of a union whose fields are nearest to the keys of a value."""
    members = get_args(kind)
    if value is None and type(None) in members:
        return None
    keys = set(value)

    def differing(member: type) -> int:
        return len(keys ^ {field.name.rstrip("_") for field in fields(member)})

    dataclasses = [member for member in members if member is not type(None)]
    return converter.structure(value, min(dataclasses, key=differing))


def _plain(converter: cattrs.Converter, value: Any, kind: Any) -> Any:
    members = [_without_notes(member) for member in get_args(kind)]
    if value is None:
        if type(None) in members:
            return None
        raise ValueError("there is no value")
    # A whole number stays one where the union has both kinds of numbers.
    for member in sorted(members, key=lambda each: each is float):
        if member is not type(None) and (get_origin(member) is dict) == isinstance(value, Mapping):
            with suppress(ValueError):
                return converter.structure(value, member)
    raise ValueError(f"{shortened(value)} cannot be used here")
