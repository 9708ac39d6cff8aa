"""The whole configuration: data sets, their order, the jobs of a run and what these need.

Memory and time of jobs follow from the size of recordings by constants that were measured
(docs/fleets.md), and grow with the number of the attempt.
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from evopem.config.channels import RecordedSource, SyntheticSource, are_one
from evopem.config.conditions import Following
from evopem.config.order_grid import max_candidates_per_part, sample_requirements
from evopem.config.settings import DatasetSettings
from evopem.config.structures import phases_of
from evopem.errors import InputError

Number = Annotated[int, Field(ge=1)] | Literal["auto"]
Names = Annotated[str, Field(min_length=1)] | Annotated[tuple[str, ...], Field(min_length=1)]
_Structure = Annotated[str, Field(pattern="^[A-Za-z0-9_-]{1,100}$")]


@dataclass(frozen=True)
class RunSettings:
    """How a run is divided into jobs, and what it writes: the keys beside the data sets."""

    candidates_per_job: Number = "auto"
    """the candidates that one job estimates. `auto`: all of a phase, in parallel on the cores of
    the job"""
    one_job_per: Literal["auto", "stage", "recording"] = "auto"
    """one job for each stage of a data set or for all stages of a recording. With `stage` a change
    reruns only what depends on it; `recording` saves most of the start-up time of [many
    recordings](fleets.md). `auto`: `recording` for ten data sets and more"""
    report: Literal["html", "none"] = "html"
    """the report of each data set. With `none` no figures are made"""
    shard: Annotated[str, Field(pattern="^[1-9][0-9]{0,8}/[1-9][0-9]{0,8}$")] | None = None
    """the number of a shard and of all shards, such as 3/40. Without the list of all data sets; for
    [runs in parallel](fleets.md)"""
    follow: Annotated[str, Field(min_length=1)] | None = None
    """the name of a condition that every data set has, such as temperature. Recordings are ordered
    by it where their [modes are followed](fleets.md#modes-over-the-recordings)"""
    correct_for: Annotated[Names, Field()] | None = None
    """the name of a condition with numbers that every data set has, or a list of them. Their
    effect is [regressed out](fleets.md#modes-over-the-recordings) of modes that are followed"""
    reference: Annotated[int, Field(ge=1)] | Annotated[str, Field(min_length=1)] | None = None
    """how many recordings of a structure, from its first one on, are unchanged, or a pattern of
    their names. Others get a [damage index](fleets.md#damage-index)"""
    false_alarms: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.01
    """the probability that the damage index of an unchanged recording is above its limit"""
    recordings_per_job: Number | None = None
    """the recordings that [one job identifies](fleets.md#several-recordings-a-job). With `report:
    none`"""
    setups: dict[_Structure, Annotated[tuple[str, ...], Field(min_length=2)]] | None = None
    """structures, each with a list of the data sets that are its [set-ups](fleets.md#set-ups)"""


@dataclass(frozen=True)
class Configuration:
    """A checked and completed configuration."""

    datasets: dict[str, DatasetSettings]
    run: RunSettings
    following: Following = field(default_factory=Following)
    batches: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the recordings that one job identifies, by the number of the batch; empty where each
    recording has jobs of its own."""


SECONDS_OF_A_BATCH = 300.0
"""Work of a job, by estimate, beside which the 4 s of its start are less than a fiftieth."""

LEAST_SECONDS, LEAST_BATCHES = 30.0, 16
"""Work of which a start is a seventh; of more, so many batches keep cores busy to the end."""

MANY = 10
"""From so many data sets on, one job takes a recording through all stages where nothing is said."""


def with_jobs(run: RunSettings, datasets: int) -> RunSettings:
    """Decide how a run is divided into jobs where it says ``auto``.

    Each stage has a job of its own where there are few data sets, so that a change reruns only what
    depends on it. Of many, each has one job: there are fewer of them, and each ends with a report.
    """
    if run.one_job_per != "auto":
        return run
    whole = datasets >= MANY or run.recordings_per_job is not None
    return replace(run, one_job_per="recording" if whole else "stage")


def check_batches(run: RunSettings, source: str) -> None:
    """Refuse several recordings a job where the other keys leave no such job."""
    for wrong, problem, remedy in (
        (run.one_job_per == "stage", "runs all stages of each", "one_job_per: recording"),
        (run.report != "none", "makes no reports", "report: none"),
    ):
        if wrong and run.recordings_per_job is not None:
            problem = f"a job of several recordings {problem}"
            remedy = f"write {remedy}, or remove the key"
            raise InputError(source, problem, remedy, "recordings_per_job")


def check_setups(run: RunSettings, datasets: Mapping[str, object], source: str) -> None:
    """Refuse set-ups that are no data sets of this run, or whose results are packed."""
    for structure, names in (run.setups or {}).items():
        missing = [name for name in names if name not in datasets]
        problem, remedy = "", "name each of its data sets once"
        if run.shard or run.recordings_per_job is not None:
            problem, remedy = "it cannot stand beside shard or recordings_per_job", "remove one"
        elif missing or len(set(names)) < len(names):
            problem = f"there is no data set {missing[0]}" if missing else "a data set comes twice"
        if problem:
            raise InputError(source, problem, remedy, f"setups.{structure}")


def batches_of(
    datasets: Mapping[str, DatasetSettings], per_job: int | Literal["auto"] | None
) -> dict[str, tuple[str, ...]]:
    """Divide data sets into batches of neighbours, numbered from 1; none for None.

    With ``"auto"`` by an estimate of their work, the same on every computer.
    """
    if per_job is None:
        return {}
    least, longest = (LEAST_SECONDS, SECONDS_OF_A_BATCH) if per_job == "auto" else (0.0, math.inf)
    most = len(datasets) // LEAST_BATCHES if per_job == "auto" else per_job
    batches: list[list[str]] = [[]]
    seconds = 0.0
    for name, settings in datasets.items():
        if (len(batches[-1]) >= most and seconds >= least) or seconds >= longest:
            batches.append([])
            seconds = 0.0
        batches[-1].append(name)
        seconds += recording_seconds(settings)
    return {str(number): tuple(batch) for number, batch in enumerate(batches, start=1)}


MARGIN_MINUTES = 10  # of every job that estimates

SECONDS_OF_RECIPE = 3.5  # processor time of a short recording by the automatic recipe


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


def estimation_memory(settings: DatasetSettings, threads: int, attempt: int) -> int:
    """MB of Snakemake and of the processes that estimate candidates, or models of channels."""
    if not are_one(settings.channels.outputs):  # compared on all samples, not on the first ones
        return int(attempt * (1200 + 200e-6 * recording_bytes(settings)))
    processes = threads + 1 if threads > 1 else 1
    samples = max_samples(settings)
    # The least squares of many parameters work in stretches: long recordings need no more for them.
    per_process = min(250 + 80e-6 * _largest_fit(settings), 400 + 400e-6 * samples)
    return int(attempt * (400 + processes * per_process))


def recording_seconds(settings: DatasetSettings) -> float:
    """Processor time of all stages of a recording without figures, roughly.

    A few times too many samples, as of :func:`max_samples`, do no harm here.
    """
    if settings.automatic is not None:
        return SECONDS_OF_RECIPE + 1e-4 * max_samples(settings)
    structure, grid = settings.order_grid.structure, settings.order_grid
    count = sum(max_candidates_per_part(phase, grid, "auto") for phase in phases_of(structure))
    return 1.0 + count * (0.05 + 6e-8 * _largest_fit(settings))


def estimation_time(
    settings: DatasetSettings,
    phase: str | None,
    candidates_per_job: int | str,
    threads: int,
    attempt: int,
) -> int:
    """Minutes of a job that estimates the candidates of a phase, or of all phases for None."""
    if settings.automatic is not None:
        return int(attempt * (60 + 60e-6 * recording_bytes(settings)))
    count = sum(
        max_candidates_per_part(one_phase, settings.order_grid, candidates_per_job)
        for one_phase in ([phase] if phase else phases_of(settings.order_grid.structure))
    )
    seconds = 2 + 2e-9 * settings.search.evaluations * _largest_fit(settings)
    return int(attempt * (MARGIN_MINUTES + 3 * count * seconds / threads / 60))


def _largest_fit(settings: DatasetSettings) -> float:
    """Samples times parameters of a data set's largest model."""
    return max_samples(settings) * sample_requirements(settings).parameters


def blas_code(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, str]:
    """Environment in which OpenBLAS takes its code for AVX2 on newer processors as well.

    The fastest for a processor rounds differently, and a search follows its last bits. Empty where
    the processor has no AVX2 or cannot be asked (Linux tells).
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
    """Variables to set, of those that are not set yet: machine code of BLAS and places of caches.

    Without a home folder that can be written to, as in many containers, libraries keep their caches
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
