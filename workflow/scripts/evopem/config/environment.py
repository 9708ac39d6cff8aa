"""Environment variables that all jobs of a run inherit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from evopem.config.blas import blas_code

CACHE_FOLDER = Path(".snakemake") / "evopem" / "cache"
"""Where libraries keep files for later runs when there is no home folder."""


def job_environment(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Variables to set, of those that are not set yet.

    Machine code of BLAS is fixed (:func:`evopem.config.blas.blas_code`). Without a home folder that
    can be written to, as in many containers, matplotlib, fontconfig and numba keep their caches
    below the working directory, where they would create a home folder or fail.

    Parameters
    ----------
    environment : mapping
        The variables that are set.
    folder : Path
        The working directory.
    """
    wanted = blas_code()
    home = Path(environment.get("HOME") or "~").expanduser()
    if not (home.is_dir() and os.access(home, os.W_OK)):
        cache = folder / CACHE_FOLDER
        wanted |= {"XDG_CACHE_HOME": str(cache), "MPLCONFIGDIR": str(cache / "matplotlib")}
    return {name: value for name, value in wanted.items() if name not in environment}
