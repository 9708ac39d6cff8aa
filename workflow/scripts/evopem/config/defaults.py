"""Complete a configuration: built-in values, then ``defaults:``, then a data set's own keys."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from evopem.config.sample_sheet import Origin, expand, shard_of
from evopem.config.schema import check_schema, key_path
from evopem.config.settings import (
    Configuration,
    PreparationSettings,
    RunSettings,
    SyntheticSource,
)
from evopem.config.yaml_form import (
    ANALYSIS_KEYS,
    FILE_KEYS,
    SYNTHESIS_KEYS,
    analysis_keys,
    settings_of,
)
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

_CHANNEL_DEFAULTS = {"input": 1, "output": 2, "input_unit": "", "output_unit": ""}
_ALL_SAMPLES = 1.0
# Names of other files and folders of the results.
RESERVED_NAMES = (
    "index.html",
    "fleet.csv",
    "fleet.parquet",
    "logs",
    "benchmarks",
    "checksums",
    "fletcher_powell",
)
_DATASET_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


def complete(
    config: Mapping[str, Any], schema_path: str | Path, source: str = "config.yaml"
) -> Configuration:
    """Check a configuration and fill in every value the user left out.

    Parameters
    ----------
    config : mapping
        The configuration as the user wrote it.
    schema_path : path
        The JSON schema, as YAML.
    source : str
        Name of the configuration in an error.

    Returns
    -------
    Configuration

    Raises
    ------
    InputError
        In one sentence that names the key, its value, what is wrong and what to do.
    """
    schema = yaml.safe_load(Path(schema_path).read_text(encoding="utf-8"))
    config = dict(_without_integral_floats(config, source))
    datasets, origin = expand(config.get("datasets"), source)
    try:
        if "datasets" in config:
            config["datasets"] = _without_integral_floats(datasets, source, ("datasets",))
        check_schema(config, schema, source)
        return _completed(config, origin, source)
    except InputError as error:
        raise _placed(error, datasets, origin) from None


def _completed(config: Mapping[str, Any], origin: Origin, source: str) -> Configuration:
    """Fill in every value of a configuration that the schema accepts."""
    _check_names(config["datasets"], origin)
    built_in = analysis_keys(PreparationSettings())
    defaults = config.get("defaults", {})
    _check_analysis(defaults, _merged(built_in, defaults), source, "defaults")
    datasets = {}
    for name, written in config["datasets"].items():
        place = f"datasets.{name}"
        own_source = _completed_source(written, source, place)
        lowest = built_in
        if "validation_file" in written:
            lowest = _merged(built_in, {"split": {"estimation": _ALL_SAMPLES}})
        analysis = _merged(_merged(lowest, defaults), written)
        _check_analysis(written, analysis, source, place)
        _check_something_left(written, analysis, source, place)
        datasets[name] = settings_of(name, own_source | analysis)
    if "shard" in config:
        datasets = shard_of(datasets, config["shard"], source)
    names = [field.name for field in fields(RunSettings)]
    run = {name: config[name] for name in names if name in config}
    return Configuration(datasets, from_json(RunSettings, run, source))


def _placed(error: InputError, datasets: Any, origin: Origin) -> InputError:
    """Name the place in a table or a pattern's entry where an error's key was written."""
    names = datasets if isinstance(datasets, Mapping) else ()
    for name in sorted(names, key=len, reverse=True):
        place = f"datasets.{name}"
        rest = error.place.removeprefix(place)
        if rest != error.place and (not rest or rest[0] == "."):
            here = origin.of_key(name, rest.removeprefix("."))
            return InputError(origin.source, error.problem, error.remedy, here)
    return error


def _without_integral_floats(value: Any, source: str, path: tuple[str | int, ...] = ()) -> Any:
    """Copy a configuration with 6.0 written as 6, so that equal settings are equal everywhere.

    All samples as a fraction, 1.0, are not one sample, 1.
    """
    if isinstance(value, Mapping):
        return {
            key: _without_integral_floats(each, source, (*path, str(key)))
            for key, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [
            _without_integral_floats(each, source, (*path, index))
            for index, each in enumerate(value)
        ]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(
                source, f"{value} is not a finite number", "give a finite one", key_path(path)
            )
        if value == _ALL_SAMPLES and path[-2:] == ("split", "estimation"):
            return value
        return int(value) if value.is_integer() else value
    return value


def _check_names(datasets: Mapping[str, Any], origin: Origin) -> None:
    """Refuse names that are no safe folder names, or one folder on a careless file system."""
    folders: dict[str, str] = {}
    for name in datasets:
        if name.lower() in RESERVED_NAMES:
            raise InputError(
                origin.source,
                f"{name} is the name of something else among the results",
                "give the data set another name",
                origin.of_name(name),
            )
        if not _DATASET_NAME.fullmatch(name) or ".." in name or name.endswith("."):
            raise InputError(
                origin.source,
                f"the data set name {name!r} cannot be the name of a folder everywhere",
                "use letters, digits, _, - and single dots, a letter or digit first",
                origin.of_name(name),
            )
        twin = folders.setdefault(name.lower(), name)
        if twin != name:
            raise InputError(
                origin.source,
                f"{twin} and {name} are one folder where letter case does not count",
                "rename one of them",
                origin.of_name(name),
            )


def _merged(lower: Mapping[str, Any], upper: Mapping[str, Any]) -> dict[str, Any]:
    """Lay one mapping over another, key by key, in the lower one's order."""
    return {
        key: _merged(value, upper.get(key, {}))
        if isinstance(value, Mapping)
        else upper.get(key, value)
        for key, value in lower.items()
    }


def _completed_source(written: Mapping[str, Any], source: str, place: str) -> dict[str, Any]:
    """Check and complete the keys that say where a data set's samples come from."""
    kinds = [key for key in ("file", "synthesis") if key in written]
    if len(kinds) != 1:
        found = "are both given" if kinds else "are both missing"
        raise InputError(
            source, f"file and synthesis {found}", "give exactly one of the two", place
        )
    kind = kinds[0] if kinds[0] == "file" else written["synthesis"]
    own_keys = [key for key in written if key not in ANALYSIS_KEYS]
    foreign = next((key for key in own_keys if key not in _known_keys(kind)), None)
    if foreign:
        other = "a synthetic" if kind == "file" else "a recorded"
        if kind == "flexible_arm" and foreign == "noise":
            other = "an armax"
        raise InputError(
            source,
            f"the key belongs to {other} data set, and this one has `{kinds[0]}: "
            f"{written[kinds[0]]}`",
            "remove it",
            f"{place}.{foreign}",
        )
    if kind == "file":
        return _completed_file(written, own_keys, source, place)
    completed = to_json(SyntheticSource(written["synthesis"]))
    if kind == "armax":
        completed["noise"] = 0.1
    return completed | {key: written[key] for key in own_keys}


def _known_keys(kind: str) -> set[str]:
    """The keys of a kind of source."""
    if kind == "file":
        return set(FILE_KEYS)
    return set(SYNTHESIS_KEYS) - ({"noise"} if kind == "flexible_arm" else set())


def _completed_file(
    written: Mapping[str, Any], own_keys: list[str], source: str, place: str
) -> dict[str, Any]:
    if "time" in written and "sampling_rate" in written:
        raise InputError(
            source, "both sampling_rate and time are given", "give one of the two", place
        )
    completed = dict.fromkeys(FILE_KEYS) | _CHANNEL_DEFAULTS
    completed |= {key: written[key] for key in own_keys}
    _check_channels(completed, source, place)
    return completed


def _check_channels(recorded: Mapping[str, Any], source: str, place: str) -> None:
    for key in ("file", "validation_file"):
        if {"{", "}"} & set(recorded[key] or ""):
            raise InputError(
                source,
                f"the braces in {recorded[key]} have a meaning of their own in a workflow",
                "rename the file",
                f"{place}.{key}",
            )
    for one, other in (("input", "output"), ("time", "input"), ("time", "output")):
        if recorded[one] == recorded[other]:
            raise InputError(
                source,
                f"{recorded[one]} is both {one} and {other}",
                "name two different columns",
                f"{place}.{other}",
            )
    if recorded["validation_file"] == recorded["file"]:
        raise InputError(
            source,
            f"{recorded['file']} is also the estimation file",
            "give an independent recording, or leave the key out to cut this one",
            f"{place}.validation_file",
        )


def _ranges(analysis: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for group in ("delay", "orders"):
        for key, value in analysis[group].items():
            yield f"{group}.{key}", value


def _check_analysis(
    written: Mapping[str, Any], merged: Mapping[str, Any], source: str, place: str
) -> None:
    """Check what no schema can say, of values laid over the defaults.

    `written` decides which of the two keys in a conflict an error names: the one that stands
    in this part of the file.
    """
    for key, value in _ranges(merged):
        if isinstance(value, list) and value[0] > value[1]:
            raise InputError(
                source,
                f"the lower end of {value} is above the upper one",
                f"write [{value[1]}, {value[0]}]",
                f"{place}.{key}",
            )
    for key, value in merged["split"].items():
        if isinstance(value, float) and value > 1:
            raise InputError(
                source,
                f"{value} is neither a whole number nor a fraction",
                "give a whole number of samples or a fraction between 0 and 1",
                f"{place}.split.{key}",
            )
    search = merged["search"]
    own = written.get("search", {})
    for low, high, meaning in (
        ("mu", "lambda", "as many offspring as parents are needed"),
        ("nu", "lambda", "no more individuals can be improved than there are offspring"),
    ):
        if search[low] > search[high]:
            key = low if low in own or high not in own else high
            raise InputError(
                source,
                f"{low} is {search[low]} and {high} is {search[high]}, but {meaning}",
                f"give {low} no more than {high}",
                f"{place}.search.{key}",
            )


def _check_something_left(
    written: Mapping[str, Any], analysis: Mapping[str, Any], source: str, place: str
) -> None:
    """Refuse to estimate on all samples of a recording that is also to be validated on."""
    chosen = analysis["split"]["estimation"]
    if isinstance(chosen, float) and chosen == _ALL_SAMPLES and "validation_file" not in written:
        raise InputError(
            source,
            f"{chosen} takes all samples, so none are left to validate on",
            "give a smaller fraction such as 0.8, or a validation_file",
            f"{place}.split.estimation",
        )
