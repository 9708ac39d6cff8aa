"""Packages that a stage needs and that come with an extra."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence

from evopem.errors import InputError

FOR_RESULTS = ("pandas",)
FOR_FIGURES = ("pandas", "matplotlib")
FOR_REPORT = ("pandas", "matplotlib", "jinja2")


def check_packages(needed: Sequence[str], source: str, work: str) -> None:
    """Refuse to begin what a missing package would end."""
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        problem = f"{work} need {', '.join(missing)}, which {are} not installed"
        raise InputError(source, problem, 'run pip install "evopem[report]"')
