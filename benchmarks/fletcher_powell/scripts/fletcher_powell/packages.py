"""Python packages that only this comparison uses.

Imports neither NumPy nor pandas, because the Snakefile imports this module.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evopem.errors import InputError
from fletcher_powell.settings import Settings

REQUIREMENTS = Path(__file__).parents[2] / "requirements.txt"


def check_packages(settings: Settings) -> None:
    """Check that the packages that the runs import are installed, without importing them.

    Raises
    ------
    InputError
        Naming the missing packages and the command that installs them.
    """
    # The first instance is always the one whose data are in optproblems.
    needed = ["cma"] if "cma-es" in settings.algorithms else []
    needed.append("optproblems")
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise _not_installed(missing)


def import_package(name: str) -> Any:
    """Import a module of one of these packages.

    Raises
    ------
    InputError
        Naming the missing package and the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        raise _not_installed([name.partition(".")[0]]) from None


def _not_installed(names: Sequence[str]) -> InputError:
    several = len(names) > 1
    return InputError(
        "fletcher_powell",
        f"the Python package{'s' * several} {' and '.join(names)} "
        f"{'are' if several else 'is'} not installed",
        f"run `{sys.executable} -m pip install -r {REQUIREMENTS}`",
    )
