"""The JSON form of the package's dataclasses: one conversion for all of them.

A dataclass becomes an object with a key for each field, an array a list, and a complex number its
real and imaginary part. A number that is not finite becomes null, which JSON has and NaN it has
not; null is read as NaN where the field is a float. A field whose name ends with an underscore to
avoid a Python keyword loses it.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

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
    """Build a dataclass from what :func:`to_json` returned.

    Parameters
    ----------
    kind : type
        The dataclass, or a type made of dataclasses such as ``tuple[Candidate, ...]``.
    content : object
        Dicts, lists, texts and numbers.
    source : str
        The file or key that an error names.

    Raises
    ------
    InputError
        When the content has another form.
    """
    try:
        return _converter().structure(content, kind)
    except Exception as error:
        where = "; ".join(cattrs.transform_error(error)[:1]) or str(error)
        name = getattr(kind, "__name__", str(kind))
        raise InputError(source, f"does not hold a {name} ({where})", _REMEDY) from None


def save(value: object, path: str | Path) -> None:
    """Write a dataclass, or a sequence of them, as JSON."""
    write_json(path, to_json(value))


def load(kind: type[T], path: str | Path) -> T:
    """Read the dataclass that :func:`save` wrote.

    Raises
    ------
    InputError
        When the file is missing, is not JSON, or holds something else.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", _REMEDY) from None
    except ValueError:
        raise InputError(str(path), "is not valid JSON", _REMEDY) from None
    return from_json(kind, content, str(path))


@cache
def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_unstructure_hook(float, _finite_or_none)
    converter.register_structure_hook(float, _float)
    converter.register_unstructure_hook(complex, _real_and_imaginary)
    converter.register_structure_hook(complex, lambda pair, _: complex(*pair))
    converter.register_unstructure_hook_func(_is_array, _array_to_list)
    converter.register_structure_hook_func(_is_array, _list_to_array)
    converter.register_structure_hook_func(_is_plain_union, _plain)
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


def _float(value: Any, _: type) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


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


def _is_plain_union(kind: Any) -> bool:
    """Whether a type is a union that JSON itself tells apart, such as ``int | str | None``."""
    if get_origin(kind) not in (Union, UnionType):
        return False
    plain = (int, float, str, bool, type(None))
    return all(
        member in plain or get_origin(member) in (Literal, tuple) for member in get_args(kind)
    )


def _plain(value: Any, _: Any) -> Any:
    return tuple(value) if isinstance(value, list | tuple) else value
