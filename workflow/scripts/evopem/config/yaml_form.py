"""The settings of a data set as the keys of ``config.yaml``, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from evopem.config.channels import (
    ChannelSettings,
    RecordedSource,
    Reference,
    SyntheticSource,
    UnitSettings,
    is_pattern,
)
from evopem.config.constraints import Constraints
from evopem.config.keys import (
    ANALYSIS,
    COLUMNS,
    NONE,
    SOURCE,
    STATE_SPACE,
    SYNTHESIS,
    geometry_of,
    input_ranges_of,
    listed,
    mapping,
    units_of,
)
from evopem.config.schema import ALL_SAMPLES, checked
from evopem.config.settings import (
    AutomaticSettings,
    DatasetSettings,
    DelaySettings,
    FitSettings,
    InputRanges,
    OrderGrid,
    OrderRanges,
    OrderSettings,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import AUTOMATIC_STRUCTURES, has_input, phases_of
from evopem.errors import InputError
from evopem.files.json_form import to_json

Settings = TypeVar("Settings")
Value = TypeVar("Value")

# Poles this close to the unit circle act as integrators in any record.
MAX_ROOT_RADIUS = 1.0 - 1e-7
STATE_SPACE_KEYS = ("form", "weighting", "geometry")
OF_INPUTS = (("delay", "nk"), ("orders", "nb"), ("orders", "nf"))
"""Groups and names of the keys of which each input has its own range."""
GAINS = ("static_gain", "static_gain_bounds")
CHANNEL_SEARCH = ("seed", "evaluations", "max_root_radius", "objective")
"""Keys of the search for models of several channels."""
_DIFFERENCES = ("difference", "difference_input")
_ONE_FILE = mapping("Dataset", SOURCE | SYNTHESIS | ANALYSIS)


def channels_of(keys: Keys) -> tuple[tuple[Reference, ...], tuple[Reference, ...]]:
    """The inputs and outputs of a data set, written or built in."""
    alone = keys.get("structure") == "arma" and "input" not in keys
    inputs = () if alone else listed(keys.get("input", 1))
    return inputs, listed(keys.get("output", 1 if alone else 2))


def has_several_channels(keys: Keys) -> bool:
    """Whether a data set has several channels, no input, or keys of state-space models."""
    (inputs, outputs), structure = channels_of(keys), keys.get("structure")
    if structure == STATE_SPACE or any(key in keys for key in STATE_SPACE_KEYS):
        return True
    if len(inputs) > 1 or len(outputs) != 1 or any(map(is_pattern, (*inputs, *outputs))):
        return True
    if "nx" in keys.get("orders", {}):
        return True
    return not inputs and (structure is None or has_input(structure))


def recipe_of(keys: Keys) -> str:
    """The recipe of a data set: the chapter's for structures that the automatic one has not."""
    of_chapter = keys.get("structure", "oe") not in (*AUTOMATIC_STRUCTURES, STATE_SPACE)
    several = has_several_channels(keys)
    recipe: str = keys.get("recipe", "chapter" if of_chapter and not several else "auto")
    return recipe


def of_one_input(value: Any, inputs: Sequence[Reference]) -> Any:
    """What a list of one, or a mapping from the one input, holds; anything else as it is."""
    if isinstance(value, Mapping) and list(value) == list(inputs):
        return value[inputs[0]]
    if isinstance(value, tuple) and len(value) == 1:
        return value[0]
    return value


def settings_of(name: str, keys: Keys) -> DatasetSettings:
    """Build the settings of a data set from its checked keys; what is missing is built in.

    Of an automatic recipe, most of that is decided from the recording.
    """
    several, by_chapter = has_several_channels(keys), recipe_of(keys) == "chapter"
    transforms, split = keys.get("transforms", {}), keys.get("split", {})
    search = {("lambda_" if k == "lambda" else k): v for k, v in keys.get("search", {}).items()}
    lowest: dict[str, Any] = {}
    if "validation_file" in keys:
        lowest["estimation"] = ALL_SAMPLES
    if not by_chapter:
        lowest["discard"] = 0
        transforms = {"box_cox": NONE, "difference": 0, "difference_input": 0} | dict(transforms)
        best = {"objective": "quadratic"} if several else {"max_root_radius": MAX_ROOT_RADIUS}
        search = best | search
    resample = keys.get("resample", NONE)
    inputs, _ = channels_of(keys)
    constraints = keys.get("constraints")
    if constraints is not None:
        gains = {key: constraints[key] for key in GAINS if key in constraints}
        if len(inputs) == 1 and not several:
            gains = {
                key: of_one_input(each, inputs) if isinstance(each, Mapping) else each
                for key, each in gains.items()
            }
        constraints = Constraints(**(dict(constraints) | gains))
    focus = {"focus": keys["focus"]} if "focus" in keys and not several else {}
    return DatasetSettings(
        name,
        _source_of(keys),
        PreparationSettings(
            TransformSettings(**transforms),
            SplitSettings(**(lowest | dict(split))),
            None if resample == NONE else float(resample),
        ),
        SpectrumSettings(**keys.get("spectrum", {})),
        _grid_of(keys) if by_chapter else OrderGrid(),
        SearchSettings(**search),
        None if by_chapter else _automatic_of(keys, several),
        FitSettings(constraints=constraints, **focus),
        geometry_of(keys["geometry"]) if "geometry" in keys else None,
    )


def _source_of(keys: Keys) -> RecordedSource | SyntheticSource:
    if "file" not in keys:
        lowest = {"noise": 0.1} if keys["synthesis"] == "armax" else {}
        return SyntheticSource(
            **(lowest | {name: keys[name] for name in SYNTHESIS if name in keys})
        )
    inputs, outputs = channels_of(keys)
    from_file = not any(key in keys for key in ("input", "output", "sampling_rate", "time"))
    from_file = from_file and bool(inputs) and not has_several_channels(keys)
    own: dict[str, Any] = {
        f"{role}_units": _units_of(keys[f"{role}_unit"], channels)
        for role, channels in (("input", inputs), ("output", outputs))
        if f"{role}_unit" in keys
    }
    own |= {name: keys[name] for name in COLUMNS if name in keys}
    channels = ChannelSettings(inputs, outputs, **own)
    validation = listed(keys.get("validation_file"))
    return RecordedSource(listed(keys["file"]), channels, validation, from_file)


def _units_of(value: Any, channels: Sequence[Reference]) -> UnitSettings:
    return units_of(of_one_input(value, channels) if len(channels) == 1 else value)


def _ranges_of(group: Keys, key: str, inputs: Sequence[Reference]) -> InputRanges:
    if key not in group:
        return InputRanges()
    value = group[key]
    return input_ranges_of(of_one_input(value, inputs) if len(inputs) == 1 else value)


def _grid_of(keys: Keys) -> OrderGrid:
    """The candidates of the chapter's recipe."""
    inputs, _ = channels_of(keys)
    ranges = {
        group: {
            key: of_one_input(each, inputs) if key in ("nk", "nb") else each
            for key, each in keys.get(group, {}).items()
        }
        for group in ("delay", "orders")
    }
    given = {key: keys[key] for key in ("structure", "level") if key in keys}
    return OrderGrid(DelaySettings(**ranges["delay"]), OrderSettings(**ranges["orders"]), **given)


def _automatic_of(keys: Keys, several: bool) -> AutomaticSettings:
    inputs, _ = channels_of(keys)
    orders, search = keys.get("orders", {}), keys.get("search", {})
    transforms = keys.get("transforms", {})
    # Constraints are those of the model after the transforms, which must then be known.
    known = "constraints" in keys and not several
    limits = {name: orders[name] for name in ("nx", "joint", "na", "nc", "nd") if name in orders}
    given = ("purpose", "structure", "form", "weighting", *(["focus"] if several else []))
    return AutomaticSettings(
        **{name: keys[name] for name in given if name in keys},
        orders=OrderRanges(
            **{name: each for name, each in limits.items() if each != "auto"},
            nb=_ranges_of(orders, "nb", inputs),
            nf=_ranges_of(orders, "nf", inputs),
            nk=_ranges_of(keys.get("delay", {}), "nk", inputs),
        ),
        start_given="discard" in keys.get("split", {}),
        rate_given="resample" in keys,
        differences_given=known or any(key in transforms for key in _DIFFERENCES),
        box_cox_given=known or "box_cox" in transforms,
        objective=search.get("objective"),
        evaluations=search.get("evaluations") if several else None,
    )


def keys_of(settings: DatasetSettings) -> dict[str, Any]:
    """List the keys that give these settings; what is not set, or decided, is left out."""
    automatic, constraints = settings.automatic, settings.fit.constraints
    keys = _source_keys(settings.source)
    if automatic is None:
        keys |= _chapter_keys(settings)
    else:
        keys |= _automatic_keys(settings, automatic)
    if settings.fit.focus != FitSettings().focus:
        keys["focus"] = settings.fit.focus
    if constraints is not None:
        keys["constraints"] = _given(constraints, Constraints())
    if settings.geometry is not None:
        keys["geometry"] = to_json(settings.geometry)
    plain: dict[str, Any] = _plain(keys)
    return plain


def _source_keys(source: RecordedSource | SyntheticSource) -> dict[str, Any]:
    if isinstance(source, SyntheticSource):
        return {key: each for key, each in to_json(source).items() if each is not None}
    channels = source.channels
    keys = {
        "file": one_or_list(source.files),
        "input": one_or_list(channels.inputs) or NONE,
        "output": one_or_list(channels.outputs),
        "input_unit": _unit_keys(channels.input_units),
        "output_unit": _unit_keys(channels.output_units),
        **{key: getattr(channels, key) for key in COLUMNS},
        "validation_file": one_or_list(source.validation_files),
    }
    if source.channels_from_file:
        del keys["input"], keys["output"]
    return {key: each for key, each in keys.items() if each is not None and each != ""}


def _unit_keys(units: UnitSettings) -> Any:
    return units.by_name or units.in_order or units.all


def _range_keys(ranges: InputRanges) -> Any:
    return ranges.all or ranges.in_order or ranges.by_name or None


def _chapter_keys(settings: DatasetSettings) -> dict[str, Any]:
    preparation, grid = settings.preparation, settings.order_grid
    phases = phases_of(grid.structure)
    keys = {
        "recipe": "chapter",
        "resample": preparation.resample or NONE,
        "transforms": to_json(preparation.transforms),
        "split": to_json(preparation.split),
        "spectrum": to_json(settings.spectrum),
        "structure": grid.structure,
        "level": grid.level,
        "delay": to_json(grid.delay),
        "orders": {name: getattr(grid.orders, name) for name in phases if name != "delay"},
        "search": to_json(settings.search),
    }
    return {key: each for key, each in keys.items() if key != "delay" or key in phases}


def _automatic_keys(settings: DatasetSettings, automatic: AutomaticSettings) -> dict[str, Any]:
    preparation, orders = settings.preparation, automatic.orders
    several = not settings.is_single_channel
    split, search = to_json(preparation.split), to_json(settings.search)
    transforms = to_json(preparation.transforms)
    if not automatic.start_given:
        del split["discard"]
    if automatic.objective is None:
        del search["objective"]
    if several:
        search = {key: search[key] for key in CHANNEL_SEARCH if key in search}
        search |= {"evaluations": automatic.evaluations}
    kept = (["box_cox"] if automatic.box_cox_given else []) + (
        list(_DIFFERENCES) if automatic.differences_given else []
    )
    ranges = {name: getattr(orders, name) for name in ("nx", "joint", "na", "nc", "nd")}
    ranges |= {"nb": _range_keys(orders.nb), "nf": _range_keys(orders.nf)}
    keys: dict[str, Any] = {
        "recipe": "auto",
        "purpose": automatic.purpose,
        "resample": (preparation.resample or NONE) if automatic.rate_given else None,
        "transforms": {key: transforms[key] for key in kept},
        "split": split,
        "spectrum": None if several else to_json(settings.spectrum),
        "structure": automatic.structure,
        "form": automatic.form,
        "weighting": automatic.weighting,
        "focus": automatic.focus,
        "delay": {"nk": _range_keys(orders.nk)},
        "orders": ranges,
        "search": search,
    }
    for group in ("transforms", "delay", "orders", "search"):
        keys[group] = {key: each for key, each in keys[group].items() if each is not None} or None
    return {key: each for key, each in keys.items() if each is not None}


def _given(value: Any, built_in: Any) -> dict[str, Any]:
    """The fields of settings that differ from the built-in ones."""
    content, lowest = to_json(value), to_json(built_in)
    return {
        each.name: content[each.name]
        for each in fields(value)
        if content[each.name] != lowest[each.name]
    }


def _plain(value: Any) -> Any:
    """Turn tuples, which YAML does not have, into lists; leave out what a pole does not state."""
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items() if each is not None}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def one_or_list(values: Sequence[Value]) -> Value | list[Value] | None:
    """What stands under a key that has one value or a list of them."""
    return list(values) if len(values) > 1 else next(iter(values), None)


def yaml_text(settings: DatasetSettings) -> str:
    """Write a configuration with this one data set, ready to be run again."""
    content = {"datasets": {settings.name: keys_of(settings)}}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)


def read_settings(path: str | Path) -> DatasetSettings:
    """Read the settings that :func:`yaml_text` wrote."""

    def complete(name: str, keys: Keys) -> DatasetSettings:
        if "recipe" not in keys:
            raise KeyError("recipe")
        return settings_of(name, checked(_ONE_FILE, keys, name))

    return read_dataset(path, complete)


def read_dataset(path: str | Path, settings_of_keys: Callable[[str, Keys], Settings]) -> Settings:
    """Read the one data set that :func:`yaml_text` wrote, by a function of its name and keys."""
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
