"""The whole configuration, checked and completed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from evopem.config.settings import DatasetSettings, RunSettings
from evopem.errors import InputError


@dataclass(frozen=True)
class Positions:
    """Recordings ordered by a condition.

    Attributes
    ----------
    name : str
        What the places are, for people.
    places : dict of str to float
        By the name of the recording; of dates, days since the earliest one.
    """

    name: str
    places: dict[str, float]


def order_of(
    conditions: Mapping[str, Mapping[str, float | str]], follow: str, source: str
) -> Positions:
    """Order recordings by one of their conditions.

    Parameters
    ----------
    conditions : mapping of str to mapping
        Conditions of each data set.
    follow : str
        Name of the condition.
    source : str
        Name of the configuration in an error.

    Raises
    ------
    InputError
        When a data set does not have the condition, or values are not all numbers or all dates.
    """
    values = {}
    for name, own in conditions.items():
        if follow not in own:
            raise InputError(
                source,
                f"{name} has no condition {follow}, which `follow` names",
                f"give it, as conditions: {{{follow}: 21.5}}, or correct `follow`",
                f"datasets.{name}.conditions",
            )
        values[name] = own[follow]
    if not any(isinstance(value, str) for value in values.values()):
        return Positions(follow, {name: float(value) for name, value in values.items()})
    dates = {name: _date(value, source, name, follow) for name, value in values.items()}
    first = min(dates.values())
    days = {name: (date - first).total_seconds() / 86_400.0 for name, date in dates.items()}
    return Positions(f"{follow} (days since {first:%Y-%m-%d %H:%M})", days)


def positions(content: Mapping[str, Any]) -> Positions | None:
    """The order of the recordings from a rule's parameters; None where they are empty."""
    return Positions(content["name"], dict(content["places"])) if content else None


def _date(value: float | str, source: str, name: str, follow: str) -> datetime:
    """A date in ISO 8601; without a time zone it is taken for UTC."""
    try:
        date = datetime.fromisoformat(str(value))
    except ValueError:
        raise InputError(
            source,
            f"{value} is no date, and the condition of another data set is no number",
            "write all as numbers or all as dates such as 2026-03-01T12:30",
            f"datasets.{name}.conditions.{follow}",
        ) from None
    return date if date.tzinfo else date.replace(tzinfo=UTC)


@dataclass(frozen=True)
class Configuration:
    """A checked and completed configuration.

    Attributes
    ----------
    datasets : dict of str to DatasetSettings
    run : RunSettings
    order : Positions, optional
        What recordings are ordered by where modes are followed.
    batches : dict of str to tuple of str
        Names of the recordings that one job identifies, by the number of the batch; empty where
        each recording has jobs of its own.
    """

    datasets: dict[str, DatasetSettings]
    run: RunSettings
    order: Positions | None = None
    batches: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def single_channel(self) -> dict[str, DatasetSettings]:
        """The data sets with one input and one output, or an output alone."""
        items = self.datasets.items()
        return {name: each for name, each in items if each.is_single_channel}
