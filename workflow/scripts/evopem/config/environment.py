"""The environment that all jobs of a run inherit: variables and limits."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from evopem.errors import InputError

CPUINFO = Path("/proc/cpuinfo")


def blas_code(cpuinfo: Path = CPUINFO) -> dict[str, str]:
    """Environment in which OpenBLAS takes its code for AVX2 on newer processors as well.

    Left to itself it takes the fastest for the processor, whose sums round differently, and a
    search follows its last bits. Empty where the processor lacks AVX2 or cannot be asked (Linux
    tells); numba's and numpy's part of the results has the same bits everywhere.
    """
    try:
        flags = set(re.findall(r"\w+", cpuinfo.read_text(encoding="utf-8")))
    except OSError:
        return {}
    return {"OPENBLAS_CORETYPE": "Haswell"} if {"avx2", "fma"} <= flags else {}


MIN_ADDRESS_SPACE = 1_000_000_000
"""Fewest bytes of address space in which a job's libraries can be loaded."""

CACHE_FOLDER = Path(".snakemake") / "evopem" / "cache"
"""Where libraries keep files for later runs when there is no home folder."""


def job_environment(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Variables to set, of those that are not set yet.

    Machine code of BLAS is fixed (:func:`blas_code`). Without a home folder that
    can be written to, as in many containers, matplotlib, fontconfig and numba keep their caches
    below the working directory, where they would create a home folder or fail.
    """
    wanted = blas_code()
    home = Path(environment.get("HOME") or "~").expanduser()
    if not (home.is_dir() and os.access(home, os.W_OK)):
        cache = folder / CACHE_FOLDER
        wanted |= {"XDG_CACHE_HOME": str(cache), "MPLCONFIGDIR": str(cache / "matplotlib")}
    return {name: value for name, value in wanted.items() if name not in environment}


def check_environment(environment: Mapping[str, str]) -> None:
    """Refuse an environment in which no job can run."""
    if environment.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise InputError(
            "NUMBA_DISABLE_JIT",
            "it is set, and the searches need compiled functions",
            "unset it and run again",
        )
    limit = _address_space()
    if limit is not None and limit < MIN_ADDRESS_SPACE:
        raise InputError(
            "ulimit -v",
            f"a process may have {limit // 1024} kB of address space",
            f"allow at least {MIN_ADDRESS_SPACE // 1024} kB, or as many as there are",
        )


def _address_space() -> int | None:
    """The limit of the address space in bytes; None where there is none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit
