"""A digest of the code behind a script, for a workflow to notice that it changed."""

from __future__ import annotations

import ast
import atexit
import hashlib
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

_PACKAGE = "evopem"
# A text that begins with the package, behind a quotation mark or a field of an f-string.
_MODULE_AS_TEXT = re.compile(rf"[\"'}}]{_PACKAGE}\.")
# Every start of Snakemake asks for all modules: what each imports is kept beside its bytecode.
_KEPT = Path(__file__).parent / "__pycache__" / "imports.json"


def code_version(
    script: str | Path,
    others: Iterable[str | Path] = (),
    folders: Sequence[str | Path] = (),
    modules: Iterable[str | Path] = (),
) -> str:
    """Digest a script and every module of the project that it imports, directly or not.

    Contents count, not times or places: a touched file or a fresh clone has the same digest.
    The ``__init__`` of a top-level package is left out: it holds no numerics.
    """
    script = Path(script).resolve()
    root = script.parent
    roots = (root, *(Path(folder).resolve() for folder in folders))
    files: set[Path] = set()
    for start in (script, *(Path(module).resolve() for module in modules)):
        files |= {start, *_reached(start, roots)}
    files.update(Path(other).resolve() for other in others)
    digest = hashlib.sha256()
    for name, file in sorted((os.path.relpath(file, root), file) for file in files):
        digest.update(Path(name).as_posix().encode())
        digest.update(_content(file))
    return digest.hexdigest()[:16]


def imported_modules(script: str | Path, root: str | Path | None = None) -> list[str]:
    """List the files a script reaches by its imports, relative to its own folder or another."""
    script = Path(script).resolve()
    root = script.parent if root is None else Path(root).resolve()
    return sorted(path.relative_to(root).as_posix() for path in _reached(script, (root,)))


@cache
def _content(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes().replace(b"\r\n", b"\n")).digest()


def _reached(script: Path, roots: tuple[Path, ...]) -> set[Path]:
    """Walk the imports from a script to every file of the project behind it."""
    reached: set[Path] = set()
    waiting = list(_imports(script, roots))
    while waiting:
        file = waiting.pop()
        if file not in reached:
            reached.add(file)
            waiting.extend(_imports(file, roots))
    return reached


@cache
def _imports(file: Path, roots: tuple[Path, ...]) -> frozenset[Path]:
    """Find the project's files that a file imports anywhere in it, its functions included."""
    home = next(root for root in roots if file.is_relative_to(root))
    names = _imported_names(file, home)
    return frozenset(found for name in names for root in roots for found in _files(name, root))


@cache
def _imported_names(file: Path, home: Path) -> tuple[str, ...]:
    """The dotted names that a file imports, or may import."""
    kept, key = _kept_names(), f"{file.relative_to(home).as_posix()} {_content(file).hex()}"
    if key not in kept:
        if not _NEW and not sys.dont_write_bytecode:
            atexit.register(_keep)
        kept[key] = _NEW[key] = sorted(_parsed_names(file, home))
    return tuple(kept[key])


_NEW: dict[str, list[str]] = {}


@cache
def _kept_names() -> dict[str, list[str]]:
    """Imported names by place and content of a file, as earlier processes found them."""
    with suppress(OSError, ValueError):
        kept = json.loads(_KEPT.read_bytes())
        if kept.pop("of", None) == _content(Path(__file__)).hex():
            return kept
    return {}


def _keep() -> None:
    """Write the imported names for later processes, where the folder can be written to."""
    files = {key.split()[0] for key in _NEW}
    others = {key: names for key, names in _kept_names().items() if key.split()[0] not in files}
    written = _KEPT.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        _KEPT.parent.mkdir(exist_ok=True)
        written.write_text(json.dumps({"of": _content(Path(__file__)).hex()} | others | _NEW))
        written.replace(_KEPT)


def _parsed_names(file: Path, home: Path) -> set[str]:
    text = file.read_text(encoding="utf-8")
    # Expressions, which are most nodes, are read only where one names a module.
    nodes = _run_nodes(ast.parse(text), with_expressions=_MODULE_AS_TEXT.search(text) is not None)
    return {name for node in nodes for name in _names(node, file, home)}


def _run_nodes(tree: ast.AST, with_expressions: bool) -> Iterator[ast.AST]:
    """Walk a syntax tree, past what only a type checker reads."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr) and not with_expressions:
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from _run_nodes(node, with_expressions)


def _names(node: ast.AST, file: Path, root: Path) -> Iterator[str]:
    """Name what one statement imports, and what it may import: `from a import b` is a or a.b."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        package = node.module or ""
        if node.level:
            parents = file.relative_to(root).parts[: -node.level]
            package = ".".join((*parents, *filter(None, [node.module])))
        yield package
        yield from (f"{package}.{alias.name}" for alias in node.names)
    elif (
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and node.value.startswith(f"{_PACKAGE}.")
    ):
        # A module imported by `importlib` is named as text, or, where a part of its name is
        # known only when it runs, the text before that: `evopem.signals.readers.`.
        yield node.value


@cache
def _files(name: str, root: Path) -> tuple[Path, ...]:
    """Find the files below a folder that an import of a dotted name runs.

    The ``__init__`` of a top-level package is not among them.
    """
    first, *steps = name.split(".")
    if first not in _top_level(root):
        return ()
    module, path = root / f"{first}.py", root / first
    candidates = [module]
    if name.endswith("."):
        steps.pop()
        candidates += path.joinpath(*steps).glob("*.py")
    for step in steps:
        path /= step
        candidates += (path.with_suffix(".py"), path / "__init__.py")
    return tuple(file for file in candidates if file.is_file())


@cache
def _top_level(root: Path) -> frozenset[str]:
    """The names of the modules and packages in a folder."""
    return frozenset(path.stem for path in root.iterdir())
