"""Libraries that only this comparison needs."""

from __future__ import annotations

import importlib
from typing import Any

from evopem.errors import InputError


def library(name: str) -> Any:
    """Import a benchmark-only library.

    Raises
    ------
    InputError
        Naming what to install where it is missing.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        package = name.partition(".")[0]
        raise InputError(
            "fletcher_powell",
            f"the Python package {package} is not installed",
            "install it with `pip install cma optproblems`",
        ) from None
