"""What jobs run in and ask for: the environment; memory and time by the size of recordings.

The constants were measured (docs/fleets.md). Every quantity grows with the number of the attempt.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from evopem.config.channels import RecordedSource, SyntheticSource
from evopem.config.order_grid import max_candidates_per_part, sample_requirements
from evopem.config.settings import DatasetSettings
from evopem.config.structures import phases_of
from evopem.errors import InputError

MARGIN_MINUTES = 10
"""Of every job that estimates."""

SECONDS_OF_RECIPE = 15.0
SECONDS_OF_CHANNELS = 60.0
"""Processor time of a short recording by the automatic recipe, and of one of several channels."""


def recording_bytes(settings: DatasetSettings) -> int:
    """Size of a data set's recordings, known before any job has run."""
    source = settings.source
    if isinstance(source, SyntheticSource):
        return 16 * source.samples
    files = [Path(file) for file in source.all_files]
    return sum(file.stat().st_size for file in files if is_file(file))


def is_file(path: str | Path) -> bool:
    """Whether a path names a file; False for a name that no file system accepts."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def max_samples(settings: DatasetSettings) -> float:
    """Number of samples of a data set's recordings, at most: a sample has at least 8 bytes."""
    source = settings.source
    if isinstance(source, RecordedSource):
        return recording_bytes(settings) / 8
    return source.samples


def reading_memory(settings: DatasetSettings, attempt: int) -> int:
    """MB of a job that reads a recording once."""
    return int(attempt * (800 + 40e-6 * recording_bytes(settings)))


def reading_time(settings: DatasetSettings, attempt: int) -> int:
    """Minutes of a job that reads a recording once."""
    return int(attempt * (5 + 0.25e-6 * recording_bytes(settings)))


def estimates_again(settings: DatasetSettings) -> bool:
    """Whether the completed model is searched, or estimated anew for its focus or constraints."""
    return not settings.is_single_channel or settings.fit.changes_model


def estimation_memory(settings: DatasetSettings, threads: int, attempt: int) -> int:
    """MB of Snakemake and of the processes that estimate candidates, or models of channels."""
    if not settings.is_single_channel:
        return int(attempt * (1200 + 200e-6 * recording_bytes(settings)))
    processes = threads + 1 if threads > 1 else 1
    samples = max_samples(settings)
    # The least squares of many parameters work in stretches: long records need no more for them.
    each = min(250 + 80e-6 * _largest_fit(settings), 400 + 400e-6 * samples)
    return int(attempt * (400 + processes * each))


def recording_seconds(settings: DatasetSettings) -> float:
    """Processor time of all stages of a recording without figures, roughly.

    The text of a sample has more than the 8 bytes of :func:`max_samples`; a few times too many
    samples do no harm here.
    """
    if not settings.is_single_channel:
        return SECONDS_OF_CHANNELS
    if settings.automatic is not None:
        return SECONDS_OF_RECIPE + 2e-3 * max_samples(settings)
    structure, grid = settings.order_grid.structure, settings.order_grid
    count = sum(max_candidates_per_part(each, grid, "auto") for each in phases_of(structure))
    return 1.0 + count * (0.05 + 6e-8 * _largest_fit(settings))


def estimation_time(
    settings: DatasetSettings,
    phase: str | None,
    candidates_per_job: int | str,
    threads: int,
    attempt: int,
) -> int:
    """Minutes of a job that estimates the candidates of a phase, or of all phases for None."""
    if not settings.is_single_channel:
        return int(attempt * (60 + 60e-6 * recording_bytes(settings)))
    count = sum(
        max_candidates_per_part(each, settings.order_grid, candidates_per_job)
        for each in ([phase] if phase else phases_of(settings.order_grid.structure))
    )
    seconds = 2 + 2e-9 * settings.search.evaluations * _largest_fit(settings)
    return int(attempt * (MARGIN_MINUTES + 3 * count * seconds / threads / 60))


def _largest_fit(settings: DatasetSettings) -> float:
    """Samples times parameters of a data set's largest model."""
    return max_samples(settings) * sample_requirements(settings).parameters


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
        problem = "it is set, and the searches need compiled functions"
        raise InputError("NUMBA_DISABLE_JIT", problem, "unset it and run again")
    try:
        import resource
    except ImportError:  # Windows
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < MIN_ADDRESS_SPACE:
        problem = f"a process may have {limit // 1024} kB of address space"
        remedy = f"allow at least {MIN_ADDRESS_SPACE // 1024} kB, or as many as there are"
        raise InputError("ulimit -v", problem, remedy)
