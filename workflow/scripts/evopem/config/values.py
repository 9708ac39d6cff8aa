"""The values of a configuration in one normal form, without any that no key can mean."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from evopem.config.schema import key_path
from evopem.config.strict_yaml import MAX_DEPTH
from evopem.errors import InputError

MAX_NUMBER = 2.0**64
"""Largest magnitude of any number in a configuration."""

MAX_KEY = 300
"""Most characters of a key or a name."""

ALL_SAMPLES = 1.0
"""The fraction of samples that means all of them, where 1 is one sample."""

_NOT_TEXT = re.compile(r"[\x00\ud800-\udfff]")

Path = tuple[str | int, ...]
"""The keys and positions that lead to a value."""


def normalized(value: Any, source: str, path: Path = ()) -> Any:
    """Copy a configuration with 6.0 written as 6, so that equal settings are equal everywhere.

    Raises
    ------
    InputError
        For a number that is not finite or beyond :data:`MAX_NUMBER`; a key that is not text or
        longer than :data:`MAX_KEY`; a text with a null character or half a surrogate pair; or
        nesting beyond :data:`MAX_DEPTH`, as in a mapping that contains itself.
    """
    if len(path) > MAX_DEPTH:
        raise InputError(
            source,
            f"it is nested more than {MAX_DEPTH} levels deep",
            "remove what leads back to its own beginning",
            key_path(path[:3]),
        )
    if isinstance(value, Mapping):
        for key in value:
            _check_key(key, source, path)
        return {key: normalized(each, source, (*path, str(key))) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [normalized(each, source, (*path, index)) for index, each in enumerate(value)]
    if isinstance(value, str):
        _check_text(value, source, path)
    if isinstance(value, int | float):
        return _normalized_number(value, source, path)
    return value


def _normalized_number(value: int | float, source: str, path: Path) -> int | float:
    if not -MAX_NUMBER <= value <= MAX_NUMBER:
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(
                source, f"{value} is not a finite number", "give a finite one", key_path(path)
            )
        raise InputError(
            source, f"the number is beyond {MAX_NUMBER:.0e}", "give a smaller one", key_path(path)
        )
    if isinstance(value, bool) or not float(value).is_integer():
        return value
    if isinstance(value, float) and value == ALL_SAMPLES and path[-2:] == ("split", "estimation"):
        return value
    return int(value)


def _check_key(key: object, source: str, path: Path) -> None:
    if not isinstance(key, str):
        raise InputError(source, f"the key {key!r} is not text", "put it in quotes", key_path(path))
    _check_text(key, source, path)
    if len(key) > MAX_KEY:
        raise InputError(
            source, f"the key {key[:40]}... has {len(key)} characters", "shorten it", key_path(path)
        )


def _check_text(text: str, source: str, path: Path) -> None:
    found = _NOT_TEXT.search(text)
    if found:
        raise InputError(
            source,
            f"the character U+{ord(found[0]):04X} is no text",
            "remove it",
            key_path(path),
        )
