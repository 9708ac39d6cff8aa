"""Refuse keys and values that cannot be, in one sentence; bring the others into one form."""

import difflib
import json
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import yaml
from pydantic import TypeAdapter, ValidationError

from evopem.config.strict_yaml import MAX_DEPTH, Keys
from evopem.errors import InputError

ErrorDetails = Mapping[str, Any]  # what pydantic says of one error

MAX_NUMBER = 2.0**64  # largest magnitude of any number in a configuration

MAX_KEY = 300  # most characters of a key or a name

ALL_SAMPLES = 1.0  # the fraction of samples that means all of them, where 1 is one sample

_LINK = re.compile(r"\[([^]]*)\]\([^)]*\)")
_NOT_TEXT = re.compile(r"[\x00\ud800-\udfff]")
_LIMITS = {
    "greater_than_equal": ("is below", "ge"),
    "greater_than": ("is not above", "gt"),
    "less_than_equal": ("is above", "le"),
    "less_than": ("is not below", "lt"),
}

Steps = tuple[str | int, ...]  # the keys and positions that lead to a value


def shipped(folder: str) -> Path:
    """A folder that an installed package holds, and in a checkout ``workflow``."""
    package = Path(__file__).resolve().parents[1]
    installed = package / folder
    return installed if installed.is_dir() else package.parents[1] / folder


def schema_file() -> Path:
    """The JSON schema for editors."""
    return shipped("schemas") / "config.schema.yaml"


def normalized(value: Any, source: str, path: Steps = ()) -> Any:
    """Copy a configuration with 6.0 written as 6, so that equal settings are equal everywhere.

    Refused are what JSON does not have, numbers beyond :data:`MAX_NUMBER`, keys that are no text or
    longer than :data:`MAX_KEY`, and nesting beyond :data:`MAX_DEPTH`.
    """

    def refuse(problem: str, remedy: str, place: Steps = path) -> NoReturn:
        raise InputError(source, problem, remedy, key_path(place))

    value = value.tolist() if hasattr(value, "tolist") else value  # of numpy
    if len(path) > MAX_DEPTH:
        problem = f"it is nested more than {MAX_DEPTH} levels deep"
        refuse(problem, "remove what leads back to its own beginning", path[:3])
    for text in (value, *(value if isinstance(value, Mapping) else ())):
        if isinstance(text, str) and (wrong := _NOT_TEXT.search(text)):
            refuse(f"the character U+{ord(wrong[0]):04X} is no text", "remove it")
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                refuse(f"the key {key!r} is not text", "put it in quotes")
            if len(key) > MAX_KEY:
                refuse(f"the key {key[:40]}... has {len(key)} characters", "shorten it")
        return {key: normalized(item, source, (*path, key)) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [normalized(item, source, (*path, index)) for index, item in enumerate(value)]
    if isinstance(value, int | float) and not -MAX_NUMBER <= value <= MAX_NUMBER:
        if isinstance(value, float) and not math.isfinite(value):
            refuse(f"{value} is not a finite number", "give a finite one")
        refuse(f"the number is beyond {MAX_NUMBER:.0e}", "give a smaller one")
    if isinstance(value, float) and value.is_integer():
        takes_all = value == ALL_SAMPLES and path[-2:] == ("split", "estimation")
        return value if takes_all else int(value)
    if not isinstance(value, str | int | float | None):
        refuse(f"{_shown(str(value))} cannot be used", "put it in quotes if it is text")
    return value


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """What checks values of a type."""
    return TypeAdapter(kind)


def checked(kind: Any, written: Any, source: str) -> Any:
    """Refuse keys and values that a type does not have; return the values in their one form."""
    try:
        return adapter(kind).validate_json(json.dumps(written), strict=True)
    except ValidationError as error:
        problems = [(_path(p, written), p) for p in error.errors(include_url=False)]
    problems.sort(key=lambda p: (p[1]["type"] == "missing", len(p[0]), key_path(p[0])))
    # Every member of a union complains; that which has the kind of the value says more of it.
    path, details = next(
        (path, problem)
        for path, problem in problems
        if not _is_of_other_kind(problem)
        or not any(
            place[: len(path)] == path and (len(place) > len(path) or not _is_of_other_kind(inner))
            for place, inner in problems
        )
    )
    problem, remedy = _explained(details, path, adapter(kind).json_schema())
    raise InputError(source, problem, remedy, key_path(path))


def _path(error: ErrorDetails, written: Any) -> list[str | int]:
    """The keys and positions that lead to a value, without the names of members of unions."""
    path: list[str | int] = []
    for step in error["loc"]:
        if isinstance(written, list) and isinstance(step, int):
            if step >= len(written):
                break
        elif not (isinstance(written, Mapping) and step in written):
            continue
        path.append(step)
        written = written[step]
    return path


def _is_of_other_kind(error: ErrorDetails) -> bool:
    """Whether a member of a union complains that the value is of another one."""
    given = error["input"]
    match error["type"]:
        case "literal_error":
            return not isinstance(given, str)
        case "too_short":  # of its valid entries
            return len(given) >= error["ctx"]["min_length"]
        case kind:
            return kind == "int_from_float" or kind.endswith("_type")


def _explained(error: ErrorDetails, path: list[str | int], schema: Keys) -> tuple[str, str]:
    """Turn what was found into a problem and a remedy."""
    node, limits, given = _below(schema, path), error.get("ctx", {}), error["input"]
    about = _LINK.sub(r"\1", described(node)[0])
    remedy = f"give {about or 'a value of the right kind'}"
    value = _shown(given)
    match error["type"]:
        case "extra_forbidden" | "unexpected_keyword_argument":
            known = list(_below(schema, path[:-1])["properties"])
            problem = f"there is no such key{_nearest(str(path[-1]), known)}"
            return problem, f"use one of {', '.join(known)}"
        case "missing" if isinstance(error["loc"][-1], str):
            return f"the key {error['loc'][-1]} is missing", "add it"
        case "missing" | "too_long" | "too_short" if isinstance(given, list | tuple):
            problem = f"{value} holds {len(given)} value{'s' * (len(given) != 1)}"
        case "too_short" | "string_too_short":
            problem = "there is nothing in it"
        case "value_error":
            problem = f"{value}: {limits['error']}"
        case "literal_error" | "string_pattern_mismatch":
            problem = f"{value} is not known{_nearest(str(given), _words(node))}"
        case kind if kind in _LIMITS:
            said, limit = _LIMITS[kind]
            problem = f"{value} {said} {limits[limit]:.16g}"
        case _:
            problem = "there is no value" if given is None else f"{value} cannot be used"
            if isinstance(given, str) and re.fullmatch(r"[+-]?[\d.]+([eE][+-]?\d+)?", given):
                remedy += f" (YAML reads {value} as text)"
    return problem, remedy


def _below(schema: Keys, path: Iterable[str | int]) -> Keys:
    """The part of a JSON schema that is about a value; without a description, what is above it."""

    def resolved(part: Keys) -> Keys:
        named = schema["$defs"][part["$ref"].rpartition("/")[2]] if "$ref" in part else {}
        return {**named, **part}

    node = dict(schema)
    for step in path:
        known = [
            (choice.get("properties") or {}).get(step)
            or choice.get("additionalProperties")
            or choice.get("items")
            or (choice.get("prefixItems") or [None])[0]
            for choice in (node, *map(resolved, node.get("anyOf", [])))
        ]
        below = resolved(next((choice for choice in known if choice), {}))
        node = {"description": node.get("description", "")} | below
    return node


def described(node: Keys) -> tuple[str, str]:
    """The clause about a value with what it may be, and what else the documentation says of it."""
    clause, _, more = node.get("description", "").partition(". ")
    members = _members(node)
    listed = [_member_in_words(member) for member in members]
    words = [word for words in listed for word in words]
    kinds = {member.get("type") for member in members}
    plain = kinds == {"object"} or kinds >= {"integer", "number"}  # a mapping, a share of samples
    if all(listed) and words and not plain:
        clause += ", " + " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
    return clause, more


def in_words(kind: Any) -> str:
    """What the documentation says of values of a type, without its links."""
    said = described(adapter(kind).json_schema())
    return _LINK.sub(r"\1", ". ".join(filter(None, said))).replace("`", "")


def _members(node: Keys) -> list[Keys]:
    """The types of a union, and of the unions in it; else the type itself."""
    return [inner for c in node["anyOf"] for inner in _members(c)] if "anyOf" in node else [node]


def _member_in_words(node: Keys) -> list[str]:
    """What a value may be, where that is one of some words or a number."""
    low, high = node.get("minimum"), node.get("maximum")
    match node.get("type"):
        case "boolean":
            return ["true", "false"]
        case "array" if len(node.get("prefixItems", ())) == 2:
            return ["[lower, upper]"]
        case "array" if "anyOf" in node.get("items", {}):
            return ["a list of them"]
        case "object" if "anyOf" in (node.get("additionalProperties") or {}):
            return ["a mapping from names to them"]
        case "integer" | "number" as kind:
            said = "a whole number" if kind == "integer" else "a number"
            if "exclusiveMinimum" in node or (low is not None and 0 < low < 1e-6):
                said += f" above {node.get('exclusiveMinimum', 0)}"
            elif low is not None and high is not None and high < 1e6:
                return [f"{said} from {low:g} to {high}"]
            elif low is not None:
                said += f" of at least {low}"
            if "exclusiveMaximum" in node:
                said += f" and below {node['exclusiveMaximum']}"
            return [said]
    return _words(node)


def _words(node: Keys) -> list[str]:
    inner = [node, *node.get("anyOf", [])]
    return [word for choice in inner for word in choice.get("enum", [choice.get("const")]) if word]


def key_path(parts: Iterable[str | int]) -> str:
    """Join the steps to a value, as in ``datasets.arm.delay.orders[0]``."""
    joined = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return joined.removeprefix(".")


def _shown(value: object) -> str:
    """Show a value as YAML would, cut when it is long."""
    value = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(value, default_flow_style=True, width=10_000).strip()
    text = text.removesuffix("\n...").strip()
    return text if len(text) <= 60 else f"{text[:57]}..."


def _nearest(word: str, known: Iterable[str]) -> str:
    lowered = {choice.lower(): choice for choice in known}
    close = difflib.get_close_matches(word.lower(), lowered, n=1)
    return f" (did you mean {lowered[close[0]]}?)" if close else ""
