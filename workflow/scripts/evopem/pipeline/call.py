"""The call of a stage's function, with arguments that came as JSON."""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

from evopem.files.json_form import from_json
from evopem.results.layout import DatasetFiles

Log = Callable[[str], None]


def call(
    function: str,
    files: DatasetFiles,
    arguments: Mapping[str, Any],
    values: Mapping[str, str],
    log: Log | None = None,
    cores: int = 1,
    folder: str | Path = "",
) -> None:
    """Call the function of a stage."""
    module, _, name = function.partition(":")
    called = getattr(import_module(f".{module}", __package__), name)
    kinds = get_type_hints(called)
    typed = {key: from_json(kinds[key], value) for key, value in arguments.items()}
    offered: dict[str, Any] = {"log": log, "cores": cores, "folder": folder}
    for key, value in values.items():
        offered[key] = int(value) if kinds.get(key) is int else value
    called(files, **typed, **{key: value for key, value in offered.items() if key in kinds})
