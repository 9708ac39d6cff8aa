"""Complete a configuration: built-in values, then ``defaults:``, then a data set's own keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.checks import (
    check_analysis,
    check_automatic,
    check_chapter,
    check_one_channel,
    check_orders_of,
    check_several_channels,
    check_several_recordings,
    check_something_left,
    orders_of,
)
from evopem.config.configuration import (
    Configuration,
    RunSettings,
    batches_of,
    check_batches,
    order_of,
    with_jobs,
)
from evopem.config.keys import CONFIGURATION, STATE_SPACE, input_ranges_of
from evopem.config.sample_sheet import Origin, check_names, expand, shard_of, with_matching_files
from evopem.config.schema import checked, normalized
from evopem.config.settings import DatasetSettings
from evopem.config.source_checks import Place, check_no_results, check_source
from evopem.config.strict_yaml import Keys
from evopem.config.structures import is_polynomial, phases_of
from evopem.config.yaml_form import (
    CHANNEL_SEARCH,
    OF_INPUTS,
    STATE_SPACE_KEYS,
    has_several_channels,
    recipe_of,
    settings_of,
)
from evopem.errors import InputError

_GROUPS = ("transforms", "split", "spectrum", "delay", "orders", "search", "constraints")
# What ``defaults:`` says of these is for data sets with one input and one output.
_OF_ONE_CHANNEL = ("transforms", "spectrum", "level", "focus", "constraints")


def complete(config: Keys, source: str = "config.yaml") -> Configuration:
    """Check a configuration and fill in every value the user left out.

    Parameters
    ----------
    config : mapping
        The configuration as the user wrote it.
    source : str
        Name of the configuration in an error.

    Raises
    ------
    InputError
        In one sentence that names the key, its value, what is wrong and what to do.
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
    written = config["datasets"]
    check_names(written, origin)
    defaults = config.get("defaults", {})
    _check_defaults(defaults, source)
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


def _check_defaults(defaults: Keys, source: str) -> None:
    own, at = _of_one_channel(defaults), Place(source, "defaults")
    if "structure" in own:
        check_orders_of(own["structure"], own, at)
    check_analysis(own, own, at)


def _dataset(name: str, entry: Keys, defaults: Keys, source: str) -> DatasetSettings:
    """Fill in every value of one data set."""
    at = Place(source, f"datasets.{name}")
    written = {key: each for key, each in entry.items() if key != "conditions"}
    check_source(written, at)
    structure = {key: defaults[key] for key in ("structure",) if key in defaults}
    if has_several_channels(structure | written):
        inherited = _of_several_channels(defaults, structure | written)
        keys = _laid_over(inherited, written)
        check_several_channels(written, keys, at)
    else:
        inherited = _of_one_channel(defaults)
        check_one_channel(written, at)
        keys = _laid_over(inherited, written)
        if recipe_of(keys) == "chapter":
            check_chapter(written, keys, at)
            phases = phases_of(keys.get("structure", "armax"))
            kept = {key: each for key, each in keys.get("orders", {}).items() if key in phases}
            keys |= {"orders": kept}
        else:
            check_automatic(inherited, Place(source, "defaults"))
            check_automatic(written, at)
    check_analysis(written, keys, at)
    check_something_left(keys, at)
    settings = settings_of(name, keys)
    check_several_recordings(settings, at)
    return settings


def _of_one_channel(defaults: Keys) -> dict[str, Any]:
    """What ``defaults:`` says to data sets with one input and one output."""
    own = {key: each for key, each in defaults.items() if key not in STATE_SPACE_KEYS}
    if own.get("structure") == STATE_SPACE:
        del own["structure"]
    by_input = {
        (group, key)
        for group, key in OF_INPUTS
        if key in own.get(group, {}) and not input_ranges_of(own[group][key]).all
    }
    for group in ("delay", "orders"):
        if group in own:
            own[group] = {
                key: each
                for key, each in own[group].items()
                if key not in ("nx", "nf") and (group, key) not in by_input
            }
    return own


def _of_several_channels(defaults: Keys, written: Keys) -> dict[str, Any]:
    """What ``defaults:`` says to data sets with several channels."""
    structure = written.get("structure")
    polynomial = structure is not None and is_polynomial(structure)
    left_out = (*_OF_ONE_CHANNEL, *(("form", "weighting") if polynomial else ()))
    own = {key: each for key, each in defaults.items() if key not in left_out}
    known = {"delay": ("nk",), "orders": orders_of(structure), "search": CHANNEL_SEARCH}
    for group, names in known.items():
        if group in own:
            own[group] = {key: each for key, each in own[group].items() if key in names}
    return own


def _laid_over(lower: Keys, upper: Keys) -> dict[str, Any]:
    """Lay keys over others, those of a mapping one by one."""
    merged = {**lower, **upper}
    for group in _GROUPS:
        if group in lower and group in upper:
            merged[group] = {**lower[group], **upper[group]}
    return merged


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
