"""A configuration completed: built-in values, then ``defaults:``, then a data set's own keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from evopem.config.channels import (
    NONE,
    ChannelSettings,
    RecordedSource,
    Reference,
    SyntheticSource,
    listed,
)
from evopem.config.checks import (
    GROUPS,
    OF_INPUTS,
    STATE_SPACE_KEYS,
    Kind,
    check_settings,
    check_values,
    paths_of,
)
from evopem.config.configuration import (
    Configuration,
    RunSettings,
    batches_of,
    check_batches,
    order_of,
    with_jobs,
)
from evopem.config.constraints import Constraints
from evopem.config.keys import (
    ANALYSIS,
    COLUMNS,
    CONFIGURATION,
    SOURCE,
    SYNTHESIS,
    mapping,
)
from evopem.config.schema import ALL_SAMPLES, checked, normalized
from evopem.config.settings import (
    CHAPTER_RANGES,
    AutomaticSettings,
    DatasetSettings,
    FitSettings,
    OrderGrid,
    OrderRanges,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.config.source_checks import Place, check_names, check_no_results, check_source
from evopem.config.strict_yaml import Keys
from evopem.config.structures import phases_of
from evopem.config.table import Origin, expand, shard_of, with_matching_files
from evopem.errors import InputError
from evopem.files.json_form import to_json

Read = TypeVar("Read")

# Poles this close to the unit circle act as integrators in any record.
MAX_ROOT_RADIUS = 1.0 - 1e-7
_ORDER = tuple(SOURCE | SYNTHESIS | ANALYSIS)
_ONE_FILE = mapping("Dataset", SOURCE | SYNTHESIS | ANALYSIS)


def complete(config: Keys, source: str = "config.yaml") -> Configuration:
    """Check a configuration as a user wrote it, and fill in every value that was left out.

    Raises InputError in one sentence that names the key, its value, what is wrong and what to do.
    """
    config = dict(normalized(config, source))
    datasets, origin = expand(config.get("datasets"), source)
    try:
        if "datasets" in config:
            datasets = with_matching_files(datasets, source)
            config["datasets"] = normalized(datasets, source, ("datasets",))
        return _completed(checked(CONFIGURATION, config, source), origin, source)
    except InputError as error:
        raise _placed(error, datasets, origin) from None


def _completed(config: Keys, origin: Origin, source: str) -> Configuration:
    """Fill in every value of a configuration whose keys are checked."""
    written, defaults = config["datasets"], config.get("defaults", {})
    check_names(written, origin)
    datasets = {name: _dataset(name, keys, defaults, source) for name, keys in written.items()}
    check_no_results(written, source)
    run = RunSettings(**{key: config[key] for key in config if key not in ("datasets", "defaults")})
    check_batches(run, source)
    run = with_jobs(run, len(datasets))
    batches = batches_of(datasets, run.recordings_per_job)
    if batches and run.shard:
        # Whole batches: the run that makes the lists has the same ones.
        batches = shard_of(batches, run.shard, source)
        datasets = {name: datasets[name] for batch in batches.values() for name in batch}
    elif run.shard:
        datasets = shard_of(datasets, run.shard, source)
    conditions = {name: keys.get("conditions", {}) for name, keys in written.items()}
    order = order_of(conditions, run.follow, source) if run.follow else None
    return Configuration(datasets, run, order, batches)


def _dataset(name: str, entry: Keys, defaults: Keys, source: str) -> DatasetSettings:
    """Lay the keys of a data set over those of ``defaults:`` that it has, and check them."""
    written = {key: each for key, each in entry.items() if key != "conditions"}
    decisive = {key: defaults[key] for key in ("structure", "recipe") if key in defaults}
    kind, at = Kind.of(decisive | written), Place(source, f"datasets.{name}")
    kinds = [key for key in ("file", "synthesis") if key in written]
    if len(kinds) != 1:
        found = "are both given" if kinds else "are both missing"
        at.refuse("", f"file and synthesis {found}", "give exactly one of the two")
    absent = kind.absent()
    for path in paths_of(written):
        if path in absent:
            at.refuse(path, *absent[path])
    check_source(written, kind.inputs, kind.outputs, at)
    inherited = _inherited(defaults, kind, absent)
    paths = frozenset(paths_of(inherited)).difference(paths_of(written))
    at = Place(source, at.name, paths)
    keys = _of_one_channel(_laid_over(inherited, written), kind)
    check_values(keys, kind, at)
    settings = settings_of(name, keys)
    check_settings(settings, written, at)
    return settings


def _inherited(defaults: Keys, kind: Kind, absent: Mapping[str, object]) -> dict[str, Any]:
    """What ``defaults:`` says to data sets of a kind."""
    own = {
        key: {name: each for name, each in value.items() if f"{key}.{name}" not in absent}
        if key in GROUPS
        else value
        for key, value in defaults.items()
        if key not in absent
    }
    if kind.several:
        # Said of data sets with one input and one output.
        left_out = ["focus", "constraints"] + ["recipe"] * (own.get("recipe") == "chapter")
        return {key: each for key, each in own.items() if key not in left_out}
    own = {key: each for key, each in own.items() if key not in STATE_SPACE_KEYS}
    own.get("orders", {}).pop("nx", None)
    for group, key in OF_INPUTS:
        given = own.get(group, {}).get(key)
        if given is not None and not isinstance(next(iter(given)), int):
            del own[group][key]
    return own


def _laid_over(lower: Keys, upper: Keys) -> dict[str, Any]:
    """Lay keys over others, those of a mapping one by one."""
    both = [group for group in GROUPS if group in lower and group in upper]
    return {**lower, **upper} | {group: {**lower[group], **upper[group]} for group in both}


def _of_one_channel(keys: dict[str, Any], kind: Kind) -> dict[str, Any]:
    """Keys with a list of one, or a mapping from the one input or output, as the value alone."""

    def alone(value: Any, channels: Sequence[Reference]) -> Any:
        if isinstance(value, Mapping) and list(value) == list(channels):
            return value[channels[0]]
        return value[0] if isinstance(value, tuple) and len(value) == 1 else value

    for role, channels in (("input", kind.inputs), ("output", kind.outputs)):
        if len(channels) == 1 and f"{role}_unit" in keys:
            keys[f"{role}_unit"] = alone(keys[f"{role}_unit"], channels)
    if len(kind.inputs) == 1:
        gains = () if kind.several else ("static_gain", "static_gain_bounds")
        for group, names in (("delay", ("nk",)), ("orders", ("nb", "nf")), ("constraints", gains)):
            if group in keys:
                keys[group] = {
                    key: alone(each, kind.inputs) if key in names else each
                    for key, each in keys[group].items()
                }
    return keys


def _placed(error: InputError, datasets: Any, origin: Origin) -> InputError:
    """Name the place in a table or a pattern's entry where an error's key was written."""
    names = datasets if isinstance(datasets, Mapping) else ()
    for name in sorted(map(str, names), key=len, reverse=True):
        place = f"datasets.{name}"
        rest = error.place.removeprefix(place)
        if rest != error.place and (not rest or rest[0] == "."):
            here = origin.of_key(name, rest.removeprefix("."))
            return InputError(origin.source, error.problem, error.remedy, here)
    return error


def settings_of(name: str, keys: Keys) -> DatasetSettings:
    """Build the settings of a data set from its checked keys; what is missing is built in.

    Of an automatic recipe, most of that is decided from the recording.
    """
    kind = Kind.of(keys)
    groups = {group: dict(keys.get(group, {})) for group in GROUPS}
    split, transforms, search = groups["split"], groups["transforms"], groups["search"]
    if "validation_file" in keys:
        split = {"estimation": ALL_SAMPLES} | split
    grid, automatic = OrderGrid(), None
    ranges = {key: None if each == "auto" else each for key, each in groups["orders"].items()}
    ranges |= {"delay" if key == "orders" else key: each for key, each in groups["delay"].items()}
    if kind.by_chapter:
        own = {key: keys[key] for key in ("structure", "level") if key in keys}
        phases = phases_of(kind.structure or "armax")
        own_ranges = {key: each for key, each in ranges.items() if key in phases or key == "nk"}
        grid = OrderGrid(replace(CHAPTER_RANGES, **own_ranges), **own)
    else:
        automatic = _automatic_of(keys, groups, kind, OrderRanges(**ranges))
        split = {"discard": 0} | split
        transforms = {"box_cox": NONE, "difference": 0, "difference_input": 0} | transforms
        best = {"objective": "quadratic"} if kind.several else {"max_root_radius": MAX_ROOT_RADIUS}
        search = best | search
    resample = keys.get("resample", NONE)
    constraints = Constraints(**groups["constraints"]) if "constraints" in keys else None
    settings = DatasetSettings(
        name=name,
        keys=keys,
        is_single_channel=not kind.several,
        source=_source_of(keys, kind),
        preparation=PreparationSettings(
            TransformSettings(**transforms),
            SplitSettings(**split),
            None if resample == NONE else float(resample),
        ),
        spectrum=SpectrumSettings(**groups["spectrum"]),
        order_grid=grid,
        search=SearchSettings(**{"lambda_" if k == "lambda" else k: v for k, v in search.items()}),
        automatic=automatic,
        fit=FitSettings(keys.get("focus", "prediction"), constraints),
        geometry=keys.get("geometry"),
    )
    # However they were written: results that depend on them are those of their values.
    plain = keys_of(settings)
    alone = {key for key in COLUMNS if isinstance(plain.get(key), list) and len(plain[key]) == 1}
    plain |= {key: plain[key][0] for key in alone}
    return replace(settings, keys={key: plain[key] for key in _ORDER if key in plain})


def _source_of(keys: Keys, kind: Kind) -> RecordedSource | SyntheticSource:
    if "file" not in keys:
        lowest = {"noise": 0.1} if keys["synthesis"] == "armax" else {}
        return SyntheticSource(**(lowest | {key: keys[key] for key in SYNTHESIS if key in keys}))
    named = any(key in keys for key in ("input", "output", "sampling_rate", "time"))
    own = {name: keys[name] for name in (*COLUMNS, "input_unit", "output_unit") if name in keys}
    return RecordedSource(
        listed(keys["file"]),
        ChannelSettings(kind.inputs, kind.outputs, **own),
        listed(keys.get("validation_file")),
        channels_from_file=bool(kind.inputs) and not kind.several and not named,
    )


def _automatic_of(
    keys: Keys, groups: Mapping[str, Keys], kind: Kind, orders: OrderRanges
) -> AutomaticSettings:
    search, transforms = groups["search"], groups["transforms"]
    # Constraints are those of the model after the transforms, which must then be known.
    known = "constraints" in keys and not kind.several
    given = ("purpose", "structure", "form", "weighting", *(["focus"] if kind.several else []))
    return AutomaticSettings(
        **{name: keys[name] for name in given if name in keys},
        orders=orders,
        start_given="discard" in groups["split"],
        rate_given="resample" in keys,
        differences_given=known or any(key.startswith("difference") for key in transforms),
        box_cox_given=known or "box_cox" in transforms,
        objective=search.get("objective"),
        evaluations=search.get("evaluations") if kind.several else None,
    )


def keys_of(settings: DatasetSettings) -> dict[str, Any]:
    """List the keys that give these settings, those of built-in values too."""
    prepared, automatic = settings.preparation, settings.automatic
    split, search = to_json(prepared.split), to_json(settings.search)
    kind = Kind.of(settings.keys)
    built_in: dict[str, Any] = {
        **({"noise": 0.1} if kind.synthesis == "armax" else {}),
        "recipe": settings.recipe,
        "split": split,
        "search": search,
    }
    if automatic is None:
        grid = settings.order_grid
        orders = {name: getattr(grid.ranges, name) for name in kind.orders}
        built_in |= {"resample": NONE, "transforms": to_json(prepared.transforms), "orders": orders}
        built_in |= {"structure": grid.structure, "level": grid.level}
        if "delay" in phases_of(grid.structure):
            built_in["delay"] = {"orders": grid.ranges.delay, "nk": grid.ranges.nk}
    else:
        built_in["purpose"] = automatic.purpose
        # What the recording decides.
        del split["discard"], search["objective"]
    if kind.several:
        absent = kind.absent()
        del search["evaluations"]
        built_in["search"] = {k: v for k, v in search.items() if f"search.{k}" not in absent}
    else:
        built_in["spectrum"] = to_json(settings.spectrum)
    plain: dict[str, Any] = to_json(_laid_over(built_in, settings.keys))
    return plain


def yaml_text(settings: DatasetSettings) -> str:
    """Write a configuration with this one data set, ready to be run again."""
    content = {"datasets": {settings.name: keys_of(settings)}}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)


def read_settings(path: str | Path) -> DatasetSettings:
    """Read the settings that :func:`yaml_text` wrote."""

    def completed(name: str, keys: Keys) -> DatasetSettings:
        if "recipe" not in keys:
            raise KeyError("recipe")
        return settings_of(name, checked(_ONE_FILE, keys, name))

    return read_dataset(path, completed)


def read_dataset(path: str | Path, of: Callable[[str, Keys], Read]) -> Read:
    """Read the one data set that :func:`yaml_text` wrote, by a function of its name and keys."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        ((name, keys),) = content["datasets"].items()
        return of(name, keys)
    except (OSError, yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        problem = f"does not hold the complete configuration of one data set ({error})"
        remedy = "delete the file and run snakemake again, which writes it anew"
        raise InputError(str(path), problem, remedy) from None
