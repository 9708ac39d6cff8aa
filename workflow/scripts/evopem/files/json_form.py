"""The JSON form of the package's dataclasses: one conversion for all of them.

A complex number is its real and imaginary part, and a number that is not finite null, which is read
as NaN where the field is a float. A field whose name ends with an underscore loses it. Values are
not converted from one type to another: 2.7 or "2" are no whole number.
"""

import json
import math
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache, lru_cache
from pathlib import Path
from reprlib import repr as shortened
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from evopem.errors import InputError
from evopem.files.atomic import write_text
from evopem.files.checksums import rewritten

T = TypeVar("T")

_EXACT = {int: "a whole number", bool: "true or false", str: "a text"}
_parts_of: Any = cache(lambda kind: (get_origin(kind) or kind, get_args(kind)))


class _MisfitError(Exception):
    """What is wrong with a value, and its place."""


def to_json(value: Any) -> Any:
    """Convert a dataclass, or a sequence or mapping of them, to what JSON can hold."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, list | tuple):
        numbers = {*map(type, value)} == {float} and all(map(math.isfinite, value))
        return list(value) if numbers else [to_json(item) for item in value]
    if is_dataclass(value):
        return {
            key: to_json(getattr(value, name))
            for key, (name, *_) in _fields(value.__class__).items()
        }
    if isinstance(value, Mapping):
        return {key: to_json(item) for key, item in value.items()}
    if isinstance(value, complex):
        return [float(value.real), float(value.imag)]
    return to_json(value.tolist())  # of numpy


def from_json(kind: type[T], content: object, source: str = "the content") -> T:
    """Build a dataclass, or a type such as ``tuple[Candidate, ...]``, from what `to_json` returned.

    An `InputError` says where the content of ``source``, a file or key, has another form.
    """
    try:
        value: T = _read(kind, content, "")
    except _MisfitError as error:
        problem, place = error.args
        raise InputError(source, problem, rewritten(source), place.removeprefix(".")) from None
    return value


def save(value: object, path: str | Path, indent: int | None = 2) -> None:
    """Write a dataclass, or a sequence of them, as JSON; on one line where only stages read it."""
    text = json.dumps(to_json(value), indent=indent, ensure_ascii=False, allow_nan=False)
    write_text(path, f"{text}\n")


def load(kind: type[T], path: str | Path) -> T:
    """Read the dataclass that :func:`save` wrote; an `InputError` names what is wrong."""
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise InputError(str(path), "is no regular file", "give the path of a file")
        text = Path(path).read_text(encoding="utf-8")
        content = json.loads(text, parse_float=_finite, parse_constant=_finite)
    except InputError:
        raise
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", rewritten(path)) from None
    except (ValueError, RecursionError):
        raise InputError(str(path), "is not valid JSON", rewritten(path)) from None
    return from_json(kind, content, str(path))


def load_shared(kind: type[T], path: str | Path) -> T:
    """As :func:`load`: the same object, which nobody may change, while a file stays the same."""
    about = Path(path).stat() if Path(path).exists() else None
    known = about and (about.st_ino, about.st_mtime_ns, about.st_size)
    return _loaded(kind, str(path), known)


_loaded: Any = lru_cache(maxsize=16)(lambda kind, path, _: load(kind, path))


def _finite(text: str) -> float:
    """A number; NaN, Infinity and 1e999 are no JSON, though Python reads them."""
    if not math.isfinite(number := float(text)):
        raise ValueError(text)
    return number


@cache
def _fields(kind: type) -> dict[str, tuple[str, Any, bool]]:
    """Keys of a dataclass with the names, types and needs of its fields."""
    hints = get_type_hints(kind)
    return {
        field.name.rstrip("_"): (
            field.name,
            hints[field.name],
            field.default is MISSING and field.default_factory is MISSING,
        )
        for field in fields(kind)
        if field.init
    }


def _read(kind: Any, content: Any, place: str) -> Any:

    def misfit(problem: str) -> _MisfitError:
        return _MisfitError(f"{shortened(content)} {problem}", place)

    origin, members = _parts_of(kind)
    if origin in _EXACT:
        if type(content) is not origin:
            raise misfit(f"is not {_EXACT[origin]}")
        return content
    if origin is float:
        if isinstance(content, bool) or not isinstance(content, int | float | None):
            raise misfit("is not a number")
        if isinstance(content, int) and abs(content) > sys.float_info.max:
            raise misfit("is too large")
        return math.nan if content is None else float(content)
    if is_dataclass(origin):
        return _read_fields(origin, content, place)
    if origin is tuple:
        if not isinstance(content, list | tuple):
            raise misfit("is not a list")
        if members[-1] is Ellipsis:
            if members[0] in (float, *_EXACT) and {*map(type, content)} <= {members[0]}:
                return tuple(content)
            members = members[:1] * len(content)
        if len(content) != len(members):
            raise misfit(f"has not {len(members)} entries")
        pairs = enumerate(zip(members, content, strict=True))
        return tuple(_read(member, item, f"{place}[{k}]") for k, (member, item) in pairs)
    if origin is Literal:
        if not isinstance(content, str) or content not in members:
            raise misfit(f"is none of {', '.join(members)}")
        return content
    if origin in (Union, UnionType):
        return _read_member(members, content, place)
    if origin is Any:
        return content
    try:
        if origin in (dict, Mapping):
            return {key: _read(members[1], item, f"{place}.{key}") for key, item in content.items()}
        return complex(*content) if origin is complex else _array(kind, content)
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise _MisfitError("the content has another form", place) from None


def _read_fields(kind: Any, content: Any, place: str) -> Any:
    if not isinstance(content, Mapping):
        raise _MisfitError("the content has another form", place)
    known = _fields(kind)
    for key in sorted(content.keys() - known.keys()):
        raise _MisfitError(f"the key {key} is not known", place)
    for key, (_, _, is_needed) in known.items():
        if is_needed and key not in content:
            raise _MisfitError(f"the key {key} is missing", place)
    values = {
        name: _read(hint, content[key], f"{place}.{key}")
        for key, (name, hint, _) in known.items()
        if key in content
    }
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise _MisfitError(str(error), place) from None


def _read_member(members: tuple[Any, ...], content: Any, place: str) -> Any:
    """Build a value of a union: of several dataclasses that with the fields nearest to its keys."""
    if content is None and NoneType in members:
        return None
    left = [member for member in members if member is not NoneType]
    if isinstance(content, Mapping) and all(map(is_dataclass, left)):
        left = [min(left, key=lambda kind: len(content.keys() ^ _fields(kind).keys()))]
    if len(left) == 1:
        return _read(left[0], content, place)
    if content is None:
        raise _MisfitError("there is no value", place)
    # A whole number stays one where the union has both kinds of numbers.
    for member in sorted(left, key=lambda kind: kind is float):
        with suppress(_MisfitError):
            return _read(member, content, place)
    raise _MisfitError(f"{shortened(content)} cannot be used here", place)


def _array(kind: Any, values: Any) -> Any:
    import numpy as np

    if "complex" in str(kind):
        return np.array([complex(*pair) for pair in values], dtype=complex)
    return np.array(values, dtype=float)
