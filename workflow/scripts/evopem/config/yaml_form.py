"""The settings of a data set as the keys of ``config.yaml``, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from evopem.config.automatic_keys import NO_TRANSFORMS, automatic_content, automatic_keys
from evopem.config.fit_keys import FIT_KEYS, keys_of_fit
from evopem.config.settings import (
    ChannelSettings,
    DatasetSettings,
    OrderGrid,
    PreparationSettings,
    RecordedSource,
    SearchSettings,
    SpectrumSettings,
    Structure,
    SyntheticSource,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import phases_of
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

CHANNEL_KEYS = tuple(field.name for field in fields(ChannelSettings))
FILE_KEYS = ("file", *CHANNEL_KEYS, "validation_file")
SYNTHESIS_KEYS = tuple(field.name for field in fields(SyntheticSource))
GRID_KEYS = ("structure", "level", "delay", "orders")
ANALYSIS_KEYS = (
    *("recipe", "purpose", "resample", "transforms", "split", "spectrum"),
    *(*GRID_KEYS, "search", *FIT_KEYS),
)

NO_RESAMPLING = "none"

Settings = TypeVar("Settings")
Value = TypeVar("Value")


def settings_of(name: str, keys: Keys) -> DatasetSettings:
    """Build the settings of a data set from its complete, checked keys.

    Of an automatic recipe, keys that are missing are decided from the recording.
    """
    source: dict[str, Any]
    if "file" in keys:
        # A missing input is none: complete keys have one wherever the structure has.
        channels = {"input": None} | {key: keys[key] for key in CHANNEL_KEYS if key in keys}
        told = keys.get("output") is None
        if told:
            channels |= {"input": 1, "output": 2}
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
    source = settings.source
    if isinstance(source, RecordedSource):
        own = {"file": one_or_list(source.files), **to_json(source.channels)}
        own["validation_file"] = one_or_list(source.validation_files)
        if source.channels.input is None:
            own["input_unit"] = None
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
    settings = read_dataset(path, _single_channel_settings)
    if settings is None:
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


def _single_channel_settings(name: str, keys: Keys) -> DatasetSettings | None:
    return None if isinstance(keys.get("output"), list) else settings_of(name, keys)
