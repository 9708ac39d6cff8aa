"""The keys of what a model is fitted for and must meet: ``focus`` and ``constraints``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.constraints import Constraints
from evopem.config.settings import FitSettings
from evopem.config.strict_yaml import Keys
from evopem.files.json_form import to_json

FIT_KEYS = ("focus", "constraints")


def merged_fit(defaults: Keys, written: Keys) -> dict[str, Any]:
    """Lay a data set's keys over those of ``defaults:``, each constraint as a whole.

    Examples
    --------
    >>> merged_fit({"focus": 5, "constraints": {"static_gain": 2}}, {"focus": "simulation"})
    {'focus': 'simulation', 'constraints': {'static_gain': 2}}
    >>> merged_fit({}, {})
    {}
    """
    together = {**defaults, **written}
    merged = {"focus": together["focus"]} if "focus" in together else {}
    constraints = {**defaults.get("constraints", {}), **written.get("constraints", {})}
    return merged | ({"constraints": constraints} if constraints else {})


def keys_of_fit(fit: FitSettings) -> dict[str, Any]:
    """List the keys that give these settings, without built-in values.

    Examples
    --------
    >>> keys_of_fit(FitSettings(constraints=Constraints(frequency_band=(1.0, 5.0))))
    {'constraints': {'frequency_band': [1.0, 5.0]}}
    """
    keys: dict[str, Any] = {} if fit.focus == FitSettings().focus else {"focus": fit.focus}
    if fit.constraints is None:
        return keys
    return keys | {"constraints": given_constraints(fit.constraints)}


def given_constraints(constraints: Constraints) -> dict[str, Any]:
    """The constraints that differ from the built-in ones, as YAML has them."""
    built_in = to_json(Constraints())
    return {
        key: _plain(value) for key, value in to_json(constraints).items() if value != built_in[key]
    }


def _plain(value: Any) -> Any:
    """Turn tuples, which YAML does not have, into lists; leave out what a pole does not state."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items() if each is not None}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
