"""The names of the keys of a data set with several channels, and the forms of their values."""

from __future__ import annotations

from typing import Any

from evopem.config.settings import Range
from evopem.config.state_space_settings import Reference

STRUCTURE = "state_space"
NO_INPUT = "none"
OWN_KEYS = ("form", "weighting", "geometry")
"""Keys that single-channel structures do not have."""

STATE_SPACE_ONLY = ("form", "weighting")
"""Keys that polynomial structures do not have."""

CHANNEL_KEYS = ("input", "output")
UNIT_KEYS = ("input_unit", "output_unit")
COLUMN_KEYS = (
    *("sampling_rate", "time", "time_unit", "header_lines", "decimal_mark"),
    "uneven_time",
)
ANALYSIS_KEYS = (
    *("recipe", "purpose", "resample", "split", "structure", "form", "weighting"),
    *("delay", "orders", "search", "geometry", "focus", "constraints"),
)
KEYS = ("file", *CHANNEL_KEYS, *UNIT_KEYS, *COLUMN_KEYS, "validation_file", *ANALYSIS_KEYS)
OWN_ORDERS = ("nx", "nf")
"""Orders whose ranges single-channel data sets do not have."""
RANGES = ("nx", "joint", "na", "nc", "nd")
RANGES_OF_INPUTS = ("nb", "nf")
SEARCH_KEYS = ("seed", "evaluations", "max_root_radius", "objective")


def listed(given: Any) -> tuple[Reference, ...]:
    """Channels of a list, of one name or number, or of none."""
    if isinstance(given, list | tuple):
        return tuple(given)
    return () if given == NO_INPUT else (given,)


def range_of(given: Any) -> Range | None:
    """Both ends of a range, or of one number; None where it is decided from the recording."""
    if given is None or given == "auto":
        return None
    return (given[0], given[1]) if isinstance(given, list | tuple) else (given, given)
