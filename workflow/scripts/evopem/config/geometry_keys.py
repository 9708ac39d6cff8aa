"""The keys of a geometry: points, lines between them, and where each output was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.settings import ChannelPlace, Geometry, Vector
from evopem.config.strict_yaml import Keys
from evopem.errors import InputError

_AXES: Mapping[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def check_geometry(written: Keys, source: str, place: str) -> None:
    """Refuse lines and channels at points that do not exist, and directions of no length.

    Parameters
    ----------
    written : mapping
        What the schema accepts under ``geometry``.
    source, place : str
        The configuration and its key, for an error to name.

    Raises
    ------
    InputError
    """
    points = written["points"]
    for index, line in enumerate(written.get("lines", [])):
        for end in line:
            _check_point(end, points, source, f"{place}.lines[{index}]")
    for name, channel in written["channels"].items():
        here = f"{place}.channels.{name}"
        _check_point(channel["point"], points, source, here)
        if not any(_direction(channel["direction"])):
            raise InputError(
                source,
                "the direction has no length",
                "give three numbers, not all 0, or one of x, y, z, -x, -y, -z",
                f"{here}.direction",
            )


def geometry_of(written: Keys) -> Geometry:
    """The geometry of checked keys."""
    return Geometry(
        points={name: _vector(each) for name, each in written["points"].items()},
        lines=tuple((str(one), str(other)) for one, other in written.get("lines", [])),
        channels={
            name: ChannelPlace(str(each["point"]), _direction(each["direction"]))
            for name, each in written["channels"].items()
        },
    )


def geometry_keys(geometry: Geometry) -> dict[str, Any]:
    """The keys that give a geometry."""
    return {
        "points": {name: list(each) for name, each in geometry.points.items()},
        "lines": [list(line) for line in geometry.lines],
        "channels": {
            name: {"point": each.point, "direction": list(each.direction)}
            for name, each in geometry.channels.items()
        },
    }


def _check_point(name: Any, points: Keys, source: str, place: str) -> None:
    if str(name) not in points:
        raise InputError(
            source,
            f"there is no point {name}",
            f"give one of {', '.join(list(points)[:20])}",
            place,
        )


def _direction(given: Any) -> Vector:
    if not isinstance(given, str):
        return _vector(given)
    x, y, z = _AXES[given.lstrip("+-")]
    sign = -1.0 if given.startswith("-") else 1.0
    return (sign * x, sign * y, sign * z)


def _vector(given: Any) -> Vector:
    x, y, *z = map(float, given)
    return (x, y, z[0] if z else 0.0)
