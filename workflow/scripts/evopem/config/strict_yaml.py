"""YAML without surprises: what a reader would not expect is refused, with its line.

PyYAML follows YAML 1.1, where ``0100`` is 64, ``1:30`` is 90 and ``on`` is true. The nodes of a
text are checked before any value is built from them.
"""

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from evopem.errors import InputError

Keys = dict[str, Any]  # keys and values of a mapping in YAML, before they become settings

MAX_DEPTH = 20  # deepest nesting of lists and mappings; a configuration needs 6

MAX_VALUES = 3_000_000  # largest number of values once every alias is written out

_TAG = "tag:yaml.org,2002:"
_RESOLVER = yaml.resolver.Resolver()
# What YAML 1.1 reads as everyone does, by its kind; a whole number has at most 30 digits.
_UNMISTAKABLE = {
    "int": re.compile(r"[-+]?(0|[1-9][0-9]{0,29})"),
    "float": re.compile(
        r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
    ),
    "bool": re.compile("true|false"),
    "null": re.compile("~|null|Null|NULL|"),
    "str": re.compile(r"(?![-+]?0[0-9_]+$).*", re.DOTALL),
}
_READINGS = {"timestamp": "a date", "null": "no value", "map": "a mapping", "seq": "a list"}
_READINGS |= {"str": "text"}
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
            node = _checked_node(path.read_text(encoding="utf-8"), source)
        except UnicodeDecodeError as error:
            problem = f"byte {error.start} is not UTF-8"
            raise InputError(source, problem, "save the file as UTF-8") from None
        except OSError as error:
            problem = f"cannot be read ({error.strerror})"
            raise InputError(source, problem, "check its permissions") from None
        if not isinstance(node, yaml.MappingNode) or not node.value:
            remedy = "write at least `datasets:` with one data set"
            raise InputError(source, "there are no keys in it", remedy)


def read_value(text: str, source: str, place: str) -> Any:
    """Read a short YAML text, such as a list in brackets."""
    _checked_node(text, source, place)
    return yaml.safe_load(text)


def _checked_node(text: str, source: str, cell: str = "") -> yaml.Node | None:
    """Parse a file, or the cell of a table, to YAML nodes, and refuse what is not allowed."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = f"this is not YAML: {getattr(error, 'problem', None) or error}"
        remedy = "check indentation (spaces, no tabs), colons and brackets"
        place = cell or (f"line {mark.line + 1}" if mark else "")
        raise InputError(source, problem, remedy, place) from None
    except RecursionError:
        raise InputError(source, "it is nested too deeply", "remove brackets", cell) from None
    except (ValueError, OverflowError):  # an escape beyond the last character of Unicode
        problem = 'an escape such as "\\UFFFFFFFF" is no character'
        raise InputError(source, problem, "correct it", cell) from None
    if node is not None:
        _Checker(source, cell).check(node)
    return node


@dataclass
class _Checker:
    """Checks every node of a text once, however many aliases lead to it."""

    source: str
    cell: str
    # Values in a node and levels of nesting, by its identity; None while its inside is checked.
    known: dict[int, tuple[int, int] | None] = field(default_factory=dict)

    def refuse(self, node: yaml.Node, problem: str, remedy: str) -> NoReturn:
        line = f"line {node.start_mark.line + 1}"
        raise InputError(self.source, problem, remedy, self.cell or line)

    def check(self, node: yaml.Node) -> tuple[int, int]:
        if id(node) not in self.known:
            self.known[id(node)] = None
            self.known[id(node)] = self._inside(node)
        place = self.known[id(node)]
        if place is None:
            self.refuse(node, "an alias leads back to what contains it", "remove it")
        return place

    def _inside(self, node: yaml.Node) -> tuple[int, int]:
        kind, children = node.tag.removeprefix(_TAG), []
        if isinstance(node, yaml.ScalarNode):
            self._check_scalar(node, kind)
        elif isinstance(node, yaml.MappingNode) and kind == "map":
            self._check_keys(node)
            children = [value for _, value in node.value]
        elif isinstance(node, yaml.SequenceNode) and kind == "seq":
            children = node.value
        else:
            self._refuse_tag(node)
        inner = [(0, 0), *map(self.check, children)]
        size, depth = 1 + sum(pair[0] for pair in inner), 1 + max(pair[1] for pair in inner)
        if size > MAX_VALUES:
            problem = f"it holds more than {MAX_VALUES} values once its aliases are written out"
            self.refuse(node, problem, "use fewer aliases")
        if depth > MAX_DEPTH:
            problem = f"it is nested more than {MAX_DEPTH} levels deep"
            self.refuse(node, problem, "remove brackets")
        return size, depth

    def _refuse_tag(self, node: yaml.Node) -> NoReturn:
        problem = f"the tag {node.tag.replace(_TAG, '!!')} has no meaning here"
        self.refuse(node, problem, "write the value without a tag, and text in quotes")

    def _check_keys(self, node: yaml.MappingNode) -> None:
        seen = set()
        for key, value in node.value:
            if key.tag == f"{_TAG}merge":
                merged = value.value if isinstance(value, yaml.SequenceNode) else [value]
                if not all(isinstance(mapping, yaml.MappingNode) for mapping in merged):
                    problem = "only a mapping can be merged by <<"
                    self.refuse(value, problem, "give an alias of a mapping")
                continue
            if not isinstance(key, yaml.ScalarNode) or key.tag != f"{_TAG}str":
                problem = f"the key {_written(key)} is read as {_reading(key)}, not as text"
                self.refuse(key, problem, "put it in quotes")
            self._check_text(key)
            if key.value in seen:
                problem = f"the key {_written(key)} stands here for the second time"
                self.refuse(key, problem, "keep one")
            seen.add(key.value)

    def _check_scalar(self, node: yaml.ScalarNode, kind: str) -> None:
        """Refuse a tag that changes what a text is, and a text that YAML 1.1 takes for another."""
        self._check_text(node)
        plain = node.style is None
        tag = _RESOLVER.resolve(yaml.ScalarNode, node.value, (True, False)) if plain else None
        written_kind = tag.removeprefix(_TAG) if tag else "str"
        if kind not in (written_kind, "str") or written_kind in ("value", "merge"):
            self._refuse_tag(node)
        expected = _UNMISTAKABLE.get(kind)
        if plain and written_kind == kind and not (expected and expected.fullmatch(node.value)):
            problem = f"YAML reads {_written(node)} as {_reading(node)}"
            remedy = "write a number in decimal digits, or put it in quotes if it is text"
            self.refuse(node, problem, remedy)

    def _check_text(self, node: yaml.ScalarNode) -> None:
        if wrong := _NOT_TEXT.search(node.value):
            self.refuse(node, f"the character U+{ord(wrong[0]):04X} is no text", "remove it")


def _written(node: yaml.Node) -> str:
    """What a node is in the file, cut when it is long."""
    if not isinstance(node, yaml.ScalarNode):
        return "in brackets"
    return node.value if len(node.value) <= 60 else f"{node.value[:57]}..."


def _reading(node: yaml.Node) -> str:
    """What YAML makes of a node, for an error."""
    read = _READINGS.get(node.tag.removeprefix(_TAG), "")
    if not read and len(node.value) <= 30:
        with suppress(yaml.YAMLError, ValueError, OverflowError):
            read = str(yaml.safe_load(node.value)).lower()
    return read or f"a number of {len(node.value)} digits"
