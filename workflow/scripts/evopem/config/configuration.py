"""The whole configuration: data sets, the jobs of a run, and the order of the recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from evopem.config.resources import recording_seconds
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError

Number = Annotated[int, Field(ge=1)] | Literal["auto"]


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
    recordings_per_job: Number | None = None
    """the recordings that [one job identifies](fleets.md#several-recordings-a-job). With `report:
    none`"""


@dataclass(frozen=True)
class Positions:
    """Recordings ordered by a condition."""

    name: str  # what the places are, for people
    places: dict[str, float]  # by the name of the recording; of dates, days since the earliest one


def order_of(
    conditions: Mapping[str, Mapping[str, float | str]], follow: str, source: str
) -> Positions:
    """Order recordings by one of their conditions, which all have, as numbers or as dates."""
    for name, own in conditions.items():
        if follow not in own:
            problem = f"{name} has no condition {follow}, which `follow` names"
            remedy = f"give it, as conditions: {{{follow}: 21.5}}, or correct `follow`"
            raise InputError(source, problem, remedy, f"datasets.{name}.conditions")
    values = {name: own[follow] for name, own in conditions.items()}
    if not any(isinstance(value, str) for value in values.values()):
        return Positions(follow, {name: float(value) for name, value in values.items()})
    dates = {}
    for name, value in values.items():
        try:
            date = datetime.fromisoformat(str(value))
        except ValueError:
            problem = f"{value} is no date, and the condition of another data set is no number"
            remedy = "write all as numbers or all as dates such as 2026-03-01T12:30"
            place = f"datasets.{name}.conditions.{follow}"
            raise InputError(source, problem, remedy, place) from None
        dates[name] = date if date.tzinfo else date.replace(tzinfo=UTC)
    first = min(dates.values())
    days = {name: (date - first).total_seconds() / 86_400.0 for name, date in dates.items()}
    return Positions(f"{follow} (days since {first:%Y-%m-%d %H:%M})", days)


def positions(content: Mapping[str, Any]) -> Positions | None:
    """The order of the recordings from a rule's parameters; None where they are empty."""
    return Positions(content["name"], dict(content["places"])) if content else None


@dataclass(frozen=True)
class Configuration:
    """A checked and completed configuration."""

    datasets: dict[str, DatasetSettings]
    run: RunSettings
    order: Positions | None = None  # of the recordings, where modes are followed
    batches: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the recordings that one job identifies, by the number of the batch; empty where each
    recording has jobs of its own."""

    @property
    def single_channel(self) -> dict[str, DatasetSettings]:
        """The data sets with one input and one output, or an output alone."""
        items = self.datasets.items()
        return {name: each for name, each in items if each.is_single_channel}


SECONDS_OF_A_BATCH = 120.0
"""Work of a job, by estimate, beside which the 2 s of its start are less than a fiftieth."""

LEAST_BATCHES = 16
"""So many batches, or one for each recording, keep the cores busy to the end of a run."""

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


def batches_of(
    datasets: Mapping[str, DatasetSettings], per_job: int | Literal["auto"] | None
) -> dict[str, tuple[str, ...]]:
    """Divide data sets into batches of neighbours, numbered from 1; none for None.

    With ``"auto"`` a batch ends when its work takes :data:`SECONDS_OF_A_BATCH` by estimate, or
    when fewer than :data:`LEAST_BATCHES` would result from more recordings. Nothing of the
    computer counts, so that the batches are the same on every one.
    """
    if per_job is None:
        return {}
    most = max(1, len(datasets) // LEAST_BATCHES) if per_job == "auto" else per_job
    batches: list[list[str]] = [[]]
    seconds = 0.0
    for name, settings in datasets.items():
        if len(batches[-1]) >= most or (per_job == "auto" and seconds >= SECONDS_OF_A_BATCH):
            batches.append([])
            seconds = 0.0
        batches[-1].append(name)
        seconds += recording_seconds(settings)
    return {str(number): tuple(batch) for number, batch in enumerate(batches, start=1)}
