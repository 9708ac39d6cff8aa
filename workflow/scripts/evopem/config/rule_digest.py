"""A digest of the code behind a script, for a workflow to notice that it changed."""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

# What only a type checker reads.
_FOR_TYPES = re.compile(r"^( *)if TYPE_CHECKING:\n(?:\1 +.*\n|\n)+", re.MULTILINE)
_IMPORT = re.compile(
    r"^ *(?:from +(\.*)([\w.]*) +import +(\([^)]*\)|.*)|import +(.*))", re.MULTILINE
)
# A module imported by `importlib` is named as text, or, where a part of its name is known only when
# it runs, the text before that: `evopem.signals.readers.`.
_AS_TEXT = re.compile(r"""["'](evopem\.[\w.]+)""")


def code_version(
    script: str | Path,
    others: Iterable[str | Path] = (),
    folders: Iterable[str | Path] = (),
    modules: Iterable[str | Path] = (),
) -> str:
    """Digest a script and every module of the project that it imports, directly or not.

    Contents count, not times or places: a touched file or a fresh clone has the same digest.
    The ``__init__`` of a top-level package is left out: it holds no numerics.
    """
    script = Path(script).resolve()
    roots = (script.parent, *(Path(folder).resolve() for folder in folders))
    starts = {script, *(Path(module).resolve() for module in modules)}
    files = starts | reached_files(starts, roots) | {Path(extra).resolve() for extra in others}
    digest = hashlib.sha256()
    for name, file in sorted((os.path.relpath(file, script.parent), file) for file in files):
        digest.update(Path(name).as_posix().encode() + _content(file))
    return digest.hexdigest()[:16]


@cache
def _content(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes().replace(b"\r\n", b"\n")).digest()


def reached_files(scripts: Iterable[Path], roots: tuple[Path, ...]) -> set[Path]:
    """Walk the imports from scripts to every file of the project behind them."""
    reached: set[Path] = set()
    waiting = list(scripts)
    while waiting:
        new = _imports(waiting.pop(), roots) - reached
        reached |= new
        waiting.extend(new)
    return reached


@cache
def _imports(file: Path, roots: tuple[Path, ...]) -> frozenset[Path]:
    """Find the project's files that a file imports anywhere in it, its functions included."""
    text = _FOR_TYPES.sub("", file.read_text(encoding="utf-8"))
    home = next(root for root in roots if file.is_relative_to(root))
    names = {*_names(text, file.relative_to(home)), *_AS_TEXT.findall(text)}
    return frozenset(module for name in names for root in roots for module in _files(name, root))


def _names(text: str, file: Path) -> Iterator[str]:
    """Name what a module imports, and what it may import: `from a import b` is a or a.b."""
    for dots, module, listed, plain in _IMPORT.findall(text):
        above = file.parts[: -len(dots)] if dots else ()
        package = ".".join((*above, *filter(None, [module])))
        names = [n.split()[0] for n in (listed or plain).strip("()").split(",") if n.strip()]
        yield from (names if plain else (package, *(f"{package}.{name}" for name in names)))


@cache
def _files(name: str, root: Path) -> tuple[Path, ...]:
    """Find the files below a folder that an import of a dotted name runs; no top ``__init__``."""
    path, *steps = name.split(".")
    candidates = [f"{path}.py"]
    if name.endswith("."):
        folder = name[:-1].replace(".", "/")
        candidates += [file for file in _below(root) if file.rpartition("/")[0] == folder]
    for step in steps:
        path = f"{path}/{step}"
        candidates += (f"{path}.py", f"{path}/__init__.py")
    return tuple(root / candidate for candidate in candidates if candidate in _below(root))


@cache
def _below(root: Path) -> frozenset[str]:
    """List the modules below a folder, once for all names that are looked for."""
    return frozenset(file.relative_to(root).as_posix() for file in root.rglob("*.py"))
