"""Evolutionary prediction-error identification of dynamic systems.

The names of the public interface stand in ``__init__.pyi``, once for type checkers and for their
import here; they load on first use, so that a light import stays light.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_HOMES = {
    alias.asname: (str(node.module), alias.name)
    for node in _STUB.body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
__all__ = [*_HOMES]


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        module, name_there = _HOMES[name]
        return getattr(import_module(module), name_there)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
