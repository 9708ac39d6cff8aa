"""Conditions of recordings, by which their modes are ordered, corrected and compared."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from fnmatch import fnmatchcase

from evopem.errors import InputError

Conditions = Mapping[str, Mapping[str, float | str]]
"""Numbers or dates by the name of the condition, by that of the recording."""


@dataclass(frozen=True)
class Positions:
    """Recordings ordered by a condition."""

    name: str  # what the places are, for people
    places: dict[str, float]  # by the name of the recording; of dates, days since the earliest one


def order_of(conditions: Conditions, follow: str, source: str) -> Positions:
    """Order recordings by one of their conditions, which all have, as numbers or as dates."""
    for name, recorded in conditions.items():
        if follow not in recorded:
            problem = f"{name} has no condition {follow}, which `follow` names"
            remedy = f"give it, as conditions: {{{follow}: 21.5}}, or correct `follow`"
            raise InputError(source, problem, remedy, f"datasets.{name}.conditions")
    values = {name: recorded[follow] for name, recorded in conditions.items()}
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


@dataclass(frozen=True)
class Following:
    """How the recordings of a structure are compared."""

    order: Positions | None = None
    corrected: dict[str, dict[str, float]] = field(default_factory=dict)
    """What is regressed out of modes: by the name of the condition, by that of the recording."""
    reference: int | tuple[str, ...] | None = None
    """Recordings in which nothing has changed: so many first ones of each structure, or names."""
    false_alarms: float = 0.01


def following_of(
    conditions: Conditions,
    follow: str | None,
    correct_for: Sequence[str],
    reference: int | str | None,
    false_alarms: float,
    source: str,
) -> Following:
    """Check and complete how recordings are compared; InputError for what they do not have."""
    order = order_of(conditions, follow, source) if follow else None
    corrected = {}
    for condition in correct_for:
        if condition == follow:
            problem = f"{condition} is regressed out, so that nothing follows it"
            raise InputError(source, problem, "follow another condition", "correct_for")
        corrected[condition] = {
            name: _number(recorded, name, condition, source)
            for name, recorded in conditions.items()
        }
    if isinstance(reference, str):
        names = tuple(name for name in conditions if fnmatchcase(name, reference))
        if not names:
            problem, remedy = f"no data set is named {reference}", "correct the name or pattern"
            raise InputError(source, problem, remedy, "reference")
        return Following(order, corrected, names, false_alarms)
    return Following(order, corrected, reference, false_alarms)


def _number(recorded: Mapping[str, float | str], name: str, condition: str, source: str) -> float:
    value = recorded.get(condition)
    if isinstance(value, int | float):
        return float(value)
    problem = f"{name} has no number for {condition}, whose effect is to be regressed out"
    remedy = f"give it, as conditions: {{{condition}: 21.5}}, or correct for other conditions"
    raise InputError(source, problem, remedy, f"datasets.{name}.conditions")
