"""A digest of the code behind a script, for a workflow to notice that it changed."""

from __future__ import annotations

import ast
import atexit
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

_PACKAGE = "evopem"
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
    waiting = [script]
    while waiting:
        new = _imports(waiting.pop(), roots) - reached
        reached |= new
        waiting.extend(new)
    return reached


@cache
def _imports(file: Path, roots: tuple[Path, ...]) -> frozenset[Path]:
    """Find the project's files that a file imports anywhere in it, its functions included."""
    home = next(root for root in roots if file.is_relative_to(root))
    kept, key = _kept_names(), f"{file.relative_to(home).as_posix()} {_content(file).hex()}"
    if key not in kept:
        if not _NEW and not sys.dont_write_bytecode:
            atexit.register(_keep)
        tree = ast.parse(file.read_text(encoding="utf-8"))
        kept[key] = _NEW[key] = sorted(set(_names(tree, file.relative_to(home))))
    return frozenset(found for name in kept[key] for root in roots for found in _files(name, root))


_NEW: dict[str, list[str]] = {}
"""The dotted names that files import, or may import, as this process found them."""


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


def _names(node: ast.AST, file: Path) -> Iterator[str]:
    """Name what a syntax tree imports, and what it may import: `from a import b` is a or a.b."""
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return  # what only a type checker reads
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = file.parts[: -node.level] if node.level else ()
        package = ".".join((*above, *filter(None, [node.module])))
        yield from (package, *(f"{package}.{alias.name}" for alias in node.names))
    elif isinstance(node, ast.Constant) and str(node.value).startswith(f"{_PACKAGE}."):
        # A module imported by `importlib` is named as text, or, where a part of its name is
        # known only when it runs, the text before that: `evopem.signals.readers.`.
        yield str(node.value)
    for inner in ast.iter_child_nodes(node):
        yield from _names(inner, file)


@cache
def _files(name: str, root: Path) -> tuple[Path, ...]:
    """Find the files below a folder that an import of a dotted name runs.

    The ``__init__`` of a top-level package is not among them.
    """
    first, *steps = name.split(".")
    if first not in _top_level(root):
        return ()
    path = root / first
    candidates = [root / f"{first}.py"]
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
