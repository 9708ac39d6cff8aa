"""A configuration completed: built-in values, then ``defaults:``, then a data set's own keys."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from evopem.config.channels import (
    NONE,
    ChannelSettings,
    RecordedSource,
    SyntheticSource,
    are_one,
    listed,
)
from evopem.config.checks import GROUPS, Kind, check_settings, check_values, paths_of
from evopem.config.conditions import following_of
from evopem.config.configuration import (
    Configuration,
    RunSettings,
    batches_of,
    check_batches,
    check_setups,
    with_jobs,
)
from evopem.config.constraints import Constraints
from evopem.config.keys import ANALYSIS, COLUMNS, CONFIGURATION, SOURCE, SYNTHESIS, mapping
from evopem.config.schema import ALL_SAMPLES, checked, normalized
from evopem.config.settings import (
    CHAPTER_RANGES,
    AutomaticSettings,
    DatasetSettings,
    FitSettings,
    GivenPreparation,
    OrderGrid,
    OrderRanges,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
    VaryingSettings,
)
from evopem.config.source_checks import Place, check_names, check_no_results, check_source
from evopem.config.strict_yaml import Keys
from evopem.config.structures import phases_of
from evopem.config.table import Origin, expand, shard_of, with_matching_files
from evopem.errors import InputError
from evopem.files.checksums import rewritten
from evopem.files.json_form import to_json

_ORDER = tuple(SOURCE | SYNTHESIS | ANALYSIS)
_LISTED = ("file", "validation_file", "input", "output")
_OF_EACH = ("input_unit", "output_unit", "nb", "nf", "nk", "static_gain", "static_gain_bounds")
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
    check_setups(run, datasets, source)
    run = with_jobs(run, len(datasets))
    batches = batches_of(datasets, run.recordings_per_job)
    if batches and run.shard:
        # Whole batches: the run that makes the lists has the same ones.
        batches = shard_of(batches, run.shard, source)
        datasets = {name: datasets[name] for batch in batches.values() for name in batch}
    elif run.shard:
        datasets = shard_of(datasets, run.shard, source)
    conditions = {name: keys.get("conditions", {}) for name, keys in written.items()}
    asked = run.follow, listed(run.correct_for or ()), run.reference, run.false_alarms
    return Configuration(datasets, run, following_of(conditions, *asked, source), batches)


def _dataset(name: str, entry: Keys, defaults: Keys, source: str) -> DatasetSettings:
    """Lay the keys of a data set over those of ``defaults:`` that it has, and check them."""
    written = {key: value for key, value in entry.items() if key != "conditions"}
    decisive = {key: defaults[key] for key in ("structure", "recipe") if key in defaults}
    kind, at = Kind.of(decisive | written), Place(source, f"datasets.{name}")
    kinds = [key for key in ("file", "synthesis") if key in written]
    if len(kinds) != 1:
        problem = "are both given" if kinds else "are both missing"
        at.refuse("", f"file and synthesis {problem}", "give exactly one of the two")
    absent = kind.absent()
    for path in paths_of(written):
        if path in absent:
            at.refuse(path, *absent[path])
    check_source(written, kind.inputs, kind.outputs, at)
    # Each data set takes the keys that it has.
    inherited = {
        key: {name: setting for name, setting in value.items() if f"{key}.{name}" not in absent}
        if key in GROUPS
        else value
        for key, value in defaults.items()
        if key not in absent
    }
    at = Place(source, at.name, frozenset(paths_of(inherited)).difference(paths_of(written)))
    keys = _alone(_laid_over(inherited, written), kind)
    check_values(keys, kind, at)
    settings = settings_of(name, keys)
    check_settings(settings, written, at)
    return settings


def _laid_over(lower: Keys, upper: Keys) -> Keys:
    """Lay keys over others, those of a mapping one by one."""
    both = [group for group in GROUPS if group in lower and group in upper]
    return {**lower, **upper} | {group: {**lower[group], **upper[group]} for group in both}


def _alone(keys: Keys, kind: Kind) -> Keys:
    """Keys with a list of one, or a mapping from the one input or output, as the value alone."""
    form = {}
    for key, value in keys.items():
        channels = kind.outputs if key == "output_unit" else kind.inputs
        if key in GROUPS and isinstance(value, Mapping):
            value = _alone(dict(value), kind)
        elif key in _LISTED or (key in _OF_EACH and len(channels) == 1):
            if isinstance(value, Mapping) and list(value) == list(channels):
                value = value[channels[0]]
            elif isinstance(value, tuple) and len(value) == 1:
                value = value[0]
        form[key] = value
    return form


def _placed(error: InputError, datasets: Any, origin: Origin) -> InputError:
    """Name the place in a table or a pattern's entry where an error's key was written."""
    names = datasets if isinstance(datasets, Mapping) else ()
    for name in sorted(map(str, names), key=len, reverse=True):
        rest = error.place.removeprefix(f"datasets.{name}")
        if rest != error.place and (not rest or rest[0] == "."):
            here = origin.of_key(name, rest.removeprefix("."))
            return InputError(origin.source, error.problem, error.remedy, here)
    return error


def _built_in(kind: Kind, keys: Keys) -> Keys:
    """The keys of a data set that are built in; of an automatic recipe few, the others decided."""
    split, search = to_json(SplitSettings()), to_json(SearchSettings())
    if "validation_file" in keys:
        split["estimation"] = ALL_SAMPLES
    built_in: Keys = {"noise": 0.1} if kind.synthesis == "armax" else {}
    built_in |= {"recipe": "chapter" if kind.by_chapter else "auto", "split": split}
    built_in["spectrum"] = to_json(SpectrumSettings())
    if kind.by_chapter:
        built_in |= {"structure": "armax", "level": False, "resample": NONE}
        built_in["transforms"] = to_json(TransformSettings())
        built_in["orders"] = {name: getattr(CHAPTER_RANGES, name) for name in kind.orders}
        if "delay" in phases_of(kind.structure or "armax"):
            built_in["delay"] = {"orders": CHAPTER_RANGES.delay, "nk": CHAPTER_RANGES.nk}
    else:
        built_in["purpose"] = "auto"
        if are_one(kind.outputs):
            built_in["varying"] = "auto"
        search = {"seed": search["seed"]}
        del split["discard"]
    return built_in | {"search": search}


def settings_of(name: str, written: Keys) -> DatasetSettings:
    """Build the settings of a data set from its checked keys; what is missing is built in.

    Of an automatic recipe, most of that is decided from the recording.
    """
    kind = Kind.of(written)
    keys = _laid_over(_built_in(kind, written), written)
    split, search, transforms = (keys.get(name, {}) for name in ("split", "search", "transforms"))
    orders, delay = keys.get("orders", {}), dict(keys.get("delay", {}))
    ranges = {key: None if limits == "auto" else limits for key, limits in orders.items()}
    ranges |= {"delay" if key == "orders" else key: limits for key, limits in delay.items()}
    grid, automatic = OrderGrid(), None
    if kind.by_chapter:
        grid = OrderGrid(replace(CHAPTER_RANGES, **ranges), keys["structure"], keys["level"])
    else:
        automatic = _automatic_of(keys, OrderRanges(**ranges))
        split = {"discard": 0} | split
        transforms = {"box_cox": NONE, "difference": 0, "difference_input": 0} | transforms
    resample, varying = keys.get("resample", NONE), keys.get("varying", NONE)
    moving = {} if varying == "auto" else varying
    constraints = Constraints(**keys["constraints"]) if "constraints" in keys else None
    # However they were written: results that depend on them are those of their values.
    left_out = kind.absent() if kind.of_responses else ()
    plain = to_json({key: keys[key] for key in _ORDER if key in keys and key not in left_out})
    plain |= {"recipe": "auto"} if kind.of_responses else {}
    return DatasetSettings(
        name=name,
        keys=plain,
        source=_source_of(keys, kind),
        preparation=PreparationSettings(
            TransformSettings(**transforms),
            SplitSettings(**split),
            None if resample == NONE else float(resample),
        ),
        spectrum=SpectrumSettings(**keys.get("spectrum", {})),
        order_grid=grid,
        search=SearchSettings(**{"lambda_" if k == "lambda" else k: v for k, v in search.items()}),
        automatic=automatic,
        fit=FitSettings(keys.get("focus", "prediction"), constraints),
        geometry=keys.get("geometry"),
        continuous_time=keys.get("continuous_time"),
        varying=None if varying == NONE else VaryingSettings(**moving),
    )


def _source_of(keys: Keys, kind: Kind) -> RecordedSource | SyntheticSource:
    if "file" not in keys:
        return SyntheticSource(**{key: keys[key] for key in SYNTHESIS if key in keys})
    named = any(key in keys for key in ("input", "output", "sampling_rate", "time"))
    columns = {name: keys[name] for name in (*COLUMNS, "input_unit", "output_unit") if name in keys}
    return RecordedSource(
        listed(keys["file"]),
        ChannelSettings(kind.inputs, kind.outputs, **columns),
        listed(keys.get("validation_file")),
        channels_from_file=bool(kind.inputs) and not named,
    )


def _automatic_of(keys: Keys, orders: OrderRanges) -> AutomaticSettings:
    transforms = keys.get("transforms", {})
    # Differences are taken back sample by sample, so that differenced signals are not decimated.
    differences = [t for key, t in transforms.items() if key.startswith("difference")]
    # Constraints are those of the model after the transforms, which must then be known.
    known = "constraints" in keys
    # Absolute errors have no covariance whose determinant could be taken.
    objective = "quadratic" if keys.get("weighting") == "determinant" else None
    given = ("purpose", "structure", "form", "weighting")
    return AutomaticSettings(
        **{name: keys[name] for name in given if name in keys},
        orders=orders,
        preparation=GivenPreparation(
            start=0 if "discard" in keys["split"] else None,
            factor=1 if "resample" in keys or any(differences) else None,
            differences=0 if known or differences else None,
            objective=keys["search"].get("objective", objective),
            box_cox=known or "box_cox" in transforms,
        ),
        evaluations=keys["search"].get("evaluations"),
        max_root_radius=keys["search"].get("max_root_radius"),
    )


def yaml_text(settings: DatasetSettings) -> str:
    """Write a configuration with this one data set, ready to be run again."""
    content = {"datasets": {settings.name: settings.keys}}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)


def read_settings(path: str | Path) -> DatasetSettings:
    """Read the settings that :func:`yaml_text` wrote."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        ((name, keys),) = content["datasets"].items()
        if "recipe" in keys:
            return settings_of(name, checked(_ONE_FILE, keys, name))
        problem: object = "no recipe"
    except (OSError, yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        problem = error
    problem = f"does not hold the complete configuration of one data set ({problem})"
    raise InputError(str(path), problem, rewritten(path)) from None
