"""The same machine code on every kind of processor, as far as it can be had."""

from __future__ import annotations

import re
from pathlib import Path

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
