"""YAML without surprises: what a reader would not expect is refused, with its line.

PyYAML follows YAML 1.1, where ``0100`` is 64, ``1:30`` is 90 and ``on`` is true. The nodes of a
text are checked before any value is built from them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from evopem.errors import InputError

Keys = Mapping[str, Any]
"""Keys and values of a mapping in YAML, before they become settings."""

MAX_DEPTH = 20
"""Deepest nesting of lists and mappings; a configuration needs 6."""

MAX_VALUES = 3_000_000
"""Largest number of values once every alias is written out."""

MAX_DIGITS = 30
"""Most digits of a whole number."""

_TAG = "tag:yaml.org,2002:"
_RESOLVER = yaml.resolver.Resolver()
_DECIMAL_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_DECIMAL_FLOAT = re.compile(
    r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
)
_LEADING_ZERO = re.compile(r"[-+]?0[0-9_]+")
_NOT_TEXT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff]")


def check_yaml_files(paths: Iterable[str | Path]) -> None:
    """Refuse a configuration file that YAML reads in another way than its user would."""
    for path in map(Path, paths):
        if not path.exists():
            continue
        source = str(path)
        if not path.is_file():
            raise InputError(source, "is not a regular file", "replace it by a text file")
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise InputError(
                source, f"byte {error.start} is not UTF-8", "save the file as UTF-8"
            ) from None
        except OSError as error:
            raise InputError(
                source, f"cannot be read ({error.strerror})", "check its permissions"
            ) from None
        node = _checked_node(text, _Place(source))
        if not isinstance(node, yaml.MappingNode) or not node.value:
            raise InputError(
                source, "there are no keys in it", "write at least `datasets:` with one data set"
            )


def read_value(text: str, source: str, place: str) -> Any:
    """Read a short YAML text, such as a list in brackets."""
    _checked_node(text, _Place(source, place))
    return yaml.safe_load(text)


@dataclass(frozen=True)
class _Place:
    """Where a node stands: in a line of a file, or in a cell of a table."""

    source: str
    cell: str = ""

    def error(self, node: yaml.Node | None, problem: str, remedy: str) -> InputError:
        line = f"line {node.start_mark.line + 1}" if node else ""
        return InputError(self.source, problem, remedy, self.cell or line)


def _checked_node(text: str, place: _Place) -> yaml.Node | None:
    """Parse a text to YAML nodes, and refuse what is not allowed among them."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise InputError(
            place.source,
            f"this is not YAML: {getattr(error, 'problem', None) or error}",
            "check indentation (spaces, no tabs), colons and brackets",
            place.cell or (f"line {mark.line + 1}" if mark else ""),
        ) from None
    except RecursionError:
        raise place.error(None, "it is nested too deeply", "remove brackets") from None
    except (ValueError, OverflowError):  # an escape beyond the last character of Unicode
        raise place.error(
            None, 'an escape such as "\\UFFFFFFFF" is no character', "correct it"
        ) from None
    if node is not None:
        _Checker(place).check(node)
    return node


@dataclass
class _Checker:
    """Checks every node of a text once, however many aliases lead to it."""

    place: _Place
    sizes: dict[int, int] = field(default_factory=dict)  # values in a checked node, by its identity
    depths: dict[int, int] = field(default_factory=dict)
    open: set[int] = field(default_factory=set)  # nodes that contain the one being checked

    def check(self, node: yaml.Node) -> None:
        identity = id(node)
        if identity in self.open:
            raise self.place.error(node, "an alias leads back to what contains it", "remove it")
        if identity in self.sizes:
            return
        if isinstance(node, yaml.ScalarNode):
            self._check_scalar(node)
            children = []
        else:
            self._check_tag(node, "map" if isinstance(node, yaml.MappingNode) else "seq")
            if isinstance(node, yaml.MappingNode):
                self._check_keys(node)
                children = [value for _, value in node.value]
            else:
                children = node.value
        self.open.add(identity)
        for child in children:
            self.check(child)
        self.open.remove(identity)
        size = 1 + sum(self.sizes[id(child)] for child in children)
        depth = 1 + max((self.depths[id(child)] for child in children), default=0)
        if size > MAX_VALUES:
            raise self.place.error(
                node,
                f"it holds more than {MAX_VALUES} values once its aliases are written out",
                "use fewer aliases",
            )
        if depth > MAX_DEPTH:
            raise self.place.error(
                node, f"it is nested more than {MAX_DEPTH} levels deep", "remove brackets"
            )
        self.sizes[identity], self.depths[identity] = size, depth

    def _check_tag(self, node: yaml.Node, *expected: str) -> None:
        if node.tag.removeprefix(_TAG) not in expected:
            raise self.place.error(
                node,
                f"the tag {node.tag.replace(_TAG, '!!')} has no meaning here",
                "write the value without a tag, and text in quotes",
            )

    def _check_keys(self, node: yaml.MappingNode) -> None:
        seen = set()
        for key, value in node.value:
            if key.tag == f"{_TAG}merge":
                self._check_merge(value)
                continue
            if not isinstance(key, yaml.ScalarNode) or key.tag != f"{_TAG}str":
                raise self.place.error(
                    key,
                    f"the key {_written(key)} is read as {_reading(key)}, not as text",
                    "put it in quotes",
                )
            self._check_text(key)
            if key.value in seen:
                raise self.place.error(
                    key, f"the key {_written(key)} stands here for the second time", "keep one"
                )
            seen.add(key.value)

    def _check_merge(self, node: yaml.Node) -> None:
        merged = node.value if isinstance(node, yaml.SequenceNode) else [node]
        if not all(isinstance(each, yaml.MappingNode) for each in merged):
            raise self.place.error(
                node, "only a mapping can be merged by <<", "give an alias of a mapping"
            )

    def _check_scalar(self, node: yaml.ScalarNode) -> None:
        self._check_tag(node, "str", "int", "float", "bool", "null", "timestamp")
        self._check_text(node)
        text, kind = node.value, node.tag.removeprefix(_TAG)
        if kind == "str":
            if _LEADING_ZERO.fullmatch(text) and node.style is None and _form(node) == "str":
                raise self._leading_zero(node)
            return
        if _form(node) != kind:
            self._check_tag(node)
        if kind == "int" and len(text) > MAX_DIGITS:
            raise self.place.error(
                node, f"it is a number of {len(text)} digits", "put it in quotes if it is text"
            )
        if kind == "int" and _LEADING_ZERO.fullmatch(text):
            raise self._leading_zero(node)
        if kind == "bool" and text in ("true", "false"):
            return
        plain = {"int": _DECIMAL_INTEGER, "float": _DECIMAL_FLOAT}.get(kind)
        if kind in ("bool", "timestamp") or (plain and not plain.fullmatch(text)):
            raise self.place.error(
                node,
                f"YAML reads {_written(node)} as {_reading(node)}",
                "write a number in decimal digits, or put it in quotes if it is text",
            )

    def _leading_zero(self, node: yaml.ScalarNode) -> InputError:
        reading = f" (YAML reads it as {_reading(node)})" if node.tag == f"{_TAG}int" else ""
        decimal = node.value.lstrip("+-0_") or "0"
        return self.place.error(
            node,
            f"the number {_written(node)} begins with a zero{reading}",
            f"write {decimal[:MAX_DIGITS]}, or put it in quotes if it is text",
        )

    def _check_text(self, node: yaml.ScalarNode) -> None:
        found = _NOT_TEXT.search(node.value)
        if found:
            raise self.place.error(
                node, f"the character U+{ord(found[0]):04X} is no text", "remove it"
            )


def _form(node: yaml.ScalarNode) -> str:
    """The kind that YAML gives a scalar without regard to its tag."""
    if node.style is not None:
        return "str"
    tag: str = _RESOLVER.resolve(yaml.ScalarNode, node.value, (True, False))
    return tag.removeprefix(_TAG)


def _written(node: yaml.Node) -> str:
    """What a node is in the file, cut when it is long."""
    if not isinstance(node, yaml.ScalarNode):
        return "in brackets"
    return node.value if len(node.value) <= 60 else f"{node.value[:57]}..."


def _reading(node: yaml.Node) -> str:
    """What YAML makes of a node, for an error."""
    match node.tag.removeprefix(_TAG):
        case "timestamp":
            return "a date"
        case "null":
            return "no value"
        case "map":
            return "a mapping"
        case "seq":
            return "a list"
        case "bool":
            return "true" if node.value.lower() in ("yes", "true", "on") else "false"
    try:
        return str(yaml.safe_load(node.value))[:60]
    except (yaml.YAMLError, ValueError, OverflowError):
        return "a number"
