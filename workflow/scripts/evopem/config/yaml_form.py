"""The settings of a data set as the keys of ``config.yaml``, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from evopem.config.automatic_keys import NO_TRANSFORMS, automatic_content, automatic_keys
from evopem.config.fit_keys import FIT_KEYS, given_constraints, keys_of_fit
from evopem.config.geometry_keys import geometry_keys, geometry_of
from evopem.config.input_ranges import input_range_keys, input_ranges_of
from evopem.config.settings import (
    AutomaticSettings,
    ChannelSettings,
    DatasetSettings,
    FitSettings,
    OrderGrid,
    OrderRanges,
    PreparationSettings,
    Range,
    RecordedSource,
    Reference,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    StateSpaceSearchSettings,
    Structure,
    SyntheticSource,
    TransformSettings,
    UnitSettings,
    is_pattern,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import has_input, phases_of
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

COLUMN_KEYS = (
    *("sampling_rate", "time", "time_unit", "header_lines", "decimal_mark"),
    "uneven_time",
)
CHANNEL_KEYS = ("input", "output", "input_unit", "output_unit", *COLUMN_KEYS)
FILE_KEYS = ("file", *CHANNEL_KEYS, "validation_file")
SYNTHESIS_KEYS = tuple(field.name for field in fields(SyntheticSource))
GRID_KEYS = ("structure", "level", "delay", "orders")
ANALYSIS_KEYS = (
    *("recipe", "purpose", "resample", "transforms", "split", "spectrum"),
    *(*GRID_KEYS, "search", *FIT_KEYS),
)

STRUCTURE = "state_space"
OWN_KEYS = ("form", "weighting", "geometry")
"""Keys that single-channel structures do not have."""

STATE_SPACE_ONLY = ("form", "weighting")
"""Keys that polynomial structures do not have."""

RANGES = ("nx", "joint", "na", "nc", "nd")
RANGES_OF_INPUTS = ("nb", "nf")
SEARCH_KEYS = ("seed", "evaluations", "max_root_radius", "objective")
NO_RESAMPLING = "none"
NO_INPUT = "none"

Settings = TypeVar("Settings")
Value = TypeVar("Value")


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


def is_state_space(written: Keys, defaults: Keys) -> bool:
    """Whether a data set has several channels, no input, or keys of state-space models."""
    structure = written.get("structure", defaults.get("structure"))
    inputs, outputs = listed(written.get("input", 1)), listed(written.get("output", 2))
    if structure == STRUCTURE or any(key in written for key in OWN_KEYS):
        return True
    if len(inputs) > 1 or len(outputs) != 1 or any(map(is_pattern, (*inputs, *outputs))):
        return True
    if "nx" in written.get("orders", {}):
        return True
    return not inputs and (structure is None or has_input(structure))


def settings_of(name: str, keys: Keys) -> DatasetSettings:
    """Build the settings of a data set from its complete, checked keys.

    Of an automatic recipe, keys that are missing are decided from the recording.
    """
    if is_state_space(keys, {}):
        return _state_space_settings(name, keys)
    source: dict[str, Any]
    if "file" in keys:
        # A missing input is none: complete keys have one wherever the structure has.
        told = keys.get("output") is None
        channels = {key: keys[key] for key in COLUMN_KEYS if key in keys}
        if not told:
            inputs = keys.get("input")
            channels |= {"inputs": [] if inputs in (None, NO_INPUT) else [inputs]}
            channels |= {"outputs": [keys["output"]]}
        for role in ("input", "output"):
            channels[f"{role}_units"] = {"all": keys.get(f"{role}_unit", "")}
        source = {"channels_from_file": told, "files": files_of(keys["file"]), "channels": channels}
        source["validation_files"] = files_of(keys.get("validation_file"))
    else:
        source = {key: keys[key] for key in SYNTHESIS_KEYS if key in keys}
    resample = keys.get("resample", NO_RESAMPLING)
    automatic = keys.get("recipe") == "auto"
    grid = {} if automatic else {key: keys[key] for key in GRID_KEYS if key in keys}
    content = {
        "name": name,
        "source": source,
        "preparation": {
            "transforms": (NO_TRANSFORMS if automatic else {}) | dict(keys.get("transforms", {})),
            "split": ({"discard": 0} if automatic else {}) | dict(keys["split"]),
            "resample": None if resample == NO_RESAMPLING else resample,
        },
        "spectrum": keys["spectrum"],
        "order_grid": grid,
        "search": keys["search"],
        "automatic": automatic_content(keys) if automatic else None,
        "fit": {key: keys[key] for key in FIT_KEYS if key in keys},
    }
    return from_json(DatasetSettings, content, f"datasets.{name}")


def keys_of(settings: DatasetSettings) -> dict[str, Any]:
    """List the keys that give these settings; what is not set is left out."""
    if not settings.is_single_channel:
        return _keys_of_state_space(settings)
    source = settings.source
    if isinstance(source, RecordedSource):
        channels = source.channels
        own = {
            "file": one_or_list(source.files),
            "input": one_or_list(channels.inputs),
            "output": channels.outputs[0],
            **{key: getattr(channels, key) for key in COLUMN_KEYS},
            "input_unit": channels.input_units.all if channels.inputs else None,
            "output_unit": channels.output_units.all,
            "validation_file": one_or_list(source.validation_files),
        }
        if source.channels_from_file:
            own |= {"input": None, "output": None}
    else:
        own = to_json(source)
    present = {key: value for key, value in own.items() if value is not None}
    fit = keys_of_fit(settings.fit)
    if settings.automatic is not None:
        return present | automatic_keys(settings, settings.automatic) | fit
    return present | {"recipe": "chapter"} | analysis_keys(settings.preparation, settings) | fit


def files_of(written: Any) -> list[str]:
    """The paths under a key: none, one, or a list of them."""
    if written is None:
        return []
    return [written] if isinstance(written, str) else list(written)


def one_or_list(values: Sequence[Value]) -> Value | list[Value] | None:
    """What stands under a key that has one value or a list, such as that of :func:`files_of`."""
    return list(values) if len(values) > 1 else next(iter(values), None)


def analysis_keys(
    preparation: PreparationSettings,
    settings: DatasetSettings | None = None,
    structure: Structure = "armax",
) -> dict[str, Any]:
    """List the keys of the analysis, by default with their built-in values for a structure."""
    grid = settings.order_grid if settings else OrderGrid(structure=structure)
    prepared = to_json(preparation)
    return {
        "resample": prepared["resample"] or NO_RESAMPLING,
        "transforms": prepared["transforms"],
        "split": prepared["split"],
        "spectrum": to_json(settings.spectrum if settings else SpectrumSettings()),
        **_grid_keys(grid),
        "search": to_json(settings.search if settings else SearchSettings()),
    }


def _grid_keys(grid: OrderGrid) -> dict[str, Any]:
    """The keys of an order grid, without those of phases that its structure does not have."""
    keys: dict[str, Any] = _as_lists(to_json(grid))
    phases = phases_of(grid.structure)
    keys["orders"] = {name: each for name, each in keys["orders"].items() if name in phases}
    own = [name for name in GRID_KEYS if name != "delay" or "delay" in phases]
    return {name: keys[name] for name in own}


def _as_lists(value: Any) -> Any:
    """Turn tuples, which YAML does not have, into lists."""
    if isinstance(value, Mapping):
        return {key: _as_lists(each) for key, each in value.items()}
    return list(value) if isinstance(value, tuple) else value


def yaml_text(settings: DatasetSettings) -> str:
    """Write a configuration with this one data set, ready to be run again."""
    return dataset_yaml(settings.name, keys_of(settings))


def dataset_yaml(name: str, keys: Keys) -> str:
    """Write a configuration with one data set of any number of channels."""
    return yaml.safe_dump(
        {"datasets": {name: keys}}, sort_keys=False, allow_unicode=True, default_flow_style=None
    )


def read_settings(path: str | Path) -> DatasetSettings:
    """Read the settings that :func:`yaml_text` wrote.

    Raises
    ------
    InputError
        When the file is missing or holds something else.
    """
    return read_dataset(path, settings_of)


def read_single_channel_settings(path: str | Path) -> DatasetSettings:
    """The same of a data set with one input and one output, or an output alone."""
    settings = read_settings(path)
    if not settings.is_single_channel:
        raise InputError(
            str(path),
            "holds a data set with several channels, and one with a single output is needed",
            "name another folder",
        )
    return settings


def read_dataset(path: str | Path, settings_of_keys: Callable[[str, Keys], Settings]) -> Settings:
    """Read the settings of the one data set that :func:`dataset_yaml` wrote.

    Parameters
    ----------
    path : path-like
    settings_of_keys : callable
        Of a name and its keys.

    Raises
    ------
    InputError
        When the file is missing or holds something else.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        ((name, keys),) = content["datasets"].items()
        return settings_of_keys(name, keys)
    except (OSError, yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            str(path),
            f"does not hold the complete configuration of one data set ({error})",
            "delete the file and run snakemake again, which writes it anew",
        ) from None


def _state_space_settings(name: str, keys: Keys) -> DatasetSettings:
    """The settings of complete, checked keys."""
    channels = ChannelSettings(
        inputs=listed(keys.get("input", 1)),
        outputs=listed(keys.get("output", 2)),
        input_units=_units(keys.get("input_unit", "")),
        output_units=_units(keys.get("output_unit", "")),
        **{key: keys[key] for key in COLUMN_KEYS if key in keys},
    )
    written = keys["search"]
    search = {key: written[key] for key in SEARCH_KEYS if key in written}
    search = to_json(StateSpaceSearchSettings()) | search
    resample = keys.get("resample", "none")
    given = {key: keys[key] for key in ("structure", "focus", *STATE_SPACE_ONLY) if key in keys}
    geometry = keys.get("geometry")
    return DatasetSettings(
        name=name,
        source=RecordedSource(
            tuple(files_of(keys["file"])),
            channels,
            tuple(files_of(keys.get("validation_file"))),
        ),
        preparation=PreparationSettings(
            transforms=from_json(TransformSettings, NO_TRANSFORMS),
            split=from_json(SplitSettings, {"discard": 0, **keys["split"]}),
            resample=None if resample == "none" else float(resample),
        ),
        spectrum=SpectrumSettings(),
        order_grid=OrderGrid(),
        search=from_json(SearchSettings, {k: v for k, v in search.items() if v is not None}),
        automatic=AutomaticSettings(
            purpose=keys.get("purpose", "auto"),
            orders=_ranges(keys.get("orders", {}), keys.get("delay", {})),
            start_given=bool(keys["split"].get("discard")),
            rate_given="resample" in keys,
            evaluations=written.get("evaluations"),
            **given,
        ),
        fit=from_json(FitSettings, {k: keys[k] for k in ("constraints",) if k in keys}),
        geometry=None if geometry is None else geometry_of(geometry),
    )


def _keys_of_state_space(settings: DatasetSettings) -> dict[str, Any]:
    """List the keys that give these settings; what is decided from the recording is left out."""
    source, choices, channels = settings.source, settings.automatic, settings.channels
    assert isinstance(source, RecordedSource)
    assert choices is not None
    preparation = settings.preparation
    orders, nk = _range_keys(choices.orders), input_range_keys(choices.orders.nk)
    split = ("discard", "estimation", *(["by"] if len(source.files) > 1 else []))
    keys: dict[str, Any] = {
        "file": one_or_list(source.files),
        "input": list(channels.inputs) or NO_INPUT,
        "output": list(channels.outputs),
        "input_unit": _unit_keys(channels.input_units),
        "output_unit": _unit_keys(channels.output_units),
        **{key: getattr(channels, key) for key in COLUMN_KEYS},
        "validation_file": one_or_list(source.validation_files),
        "recipe": "auto",
        "purpose": choices.purpose,
        "resample": (preparation.resample or "none") if choices.rate_given else None,
        "split": {key: getattr(preparation.split, key) for key in split},
        "structure": choices.structure,
        "form": choices.form,
        "focus": choices.focus,
        "weighting": choices.weighting,
        "delay": {"nk": nk} if nk else None,
        "orders": orders or None,
        "search": {k: v for k, v in to_json(settings.state_space_search).items() if v is not None},
        "geometry": None if settings.geometry is None else geometry_keys(settings.geometry),
        "constraints": None
        if settings.fit.constraints is None
        else given_constraints(settings.fit.constraints),
    }
    return {key: value for key, value in keys.items() if value is not None and value != ""}


def _ranges(orders: Keys, delay: Keys) -> OrderRanges:
    """The ranges of checked keys."""
    nx, joint, na, nc, nd = (range_of(orders.get(name)) for name in RANGES)
    nb, nf = (input_ranges_of(orders.get(name)) for name in RANGES_OF_INPUTS)
    return OrderRanges(nx, joint, na, nc, nd, nb, nf, input_ranges_of(delay.get("nk")))


def _range_keys(ranges: OrderRanges) -> dict[str, Any]:
    """The keys that give the ranges of orders."""
    limits = {name: getattr(ranges, name) for name in RANGES}
    keys = {name: each and list(each) for name, each in limits.items()}
    keys |= {name: input_range_keys(getattr(ranges, name)) for name in RANGES_OF_INPUTS}
    return {name: each for name, each in keys.items() if each}


def _units(given: Any) -> UnitSettings:
    if isinstance(given, Mapping):
        return UnitSettings(by_name=dict(given))
    if isinstance(given, list | tuple):
        return UnitSettings(in_order=tuple(given))
    return UnitSettings(all=given)


def _unit_keys(units: UnitSettings) -> Any:
    return units.by_name or list(units.in_order) or units.all
