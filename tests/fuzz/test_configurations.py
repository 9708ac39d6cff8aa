"""Random configurations: right ones are completed, all others are refused in one sentence."""

import copy
import json
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from evopem.config.defaults import complete
from evopem.config.order_grid import PHASES, part_count, sample_needs, scoring_start
from evopem.errors import InputError

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"
KNOWN = yaml.safe_load(SCHEMA.read_text())


def ranges(lowest, highest):
    return st.tuples(*[st.integers(lowest, highest)] * 2).map(sorted)


def some(**keys):
    """A mapping with any of these keys."""
    return st.fixed_dictionaries({}, optional=keys)


ANALYSIS = {
    "resample": st.just("none") | st.floats(0.1, 1e6),
    "stationarity": some(
        box_cox=st.sampled_from(["auto", "none"]) | st.floats(-5, 5),
        difference=st.integers(0, 4),
        difference_input=st.integers(0, 4),
    ),
    "split": some(
        discard=st.integers(0, 10_000) | st.floats(0.01, 0.9),
        estimation=st.integers(1, 10_000) | st.floats(0.1, 0.9),
    ),
    "spectrum": some(time_halfbandwidth=st.floats(1.5, 20), nfft=st.integers(64, 2**20)),
    "delay": some(orders=ranges(1, 60), delays=ranges(0, 1000)),
    "orders": some(common=ranges(1, 60) | st.just("auto"), c=ranges(1, 60), b=ranges(1, 60)),
    "search": some(
        objective=st.sampled_from(["absolute", "quadratic"]),
        mutate=st.sampled_from(["worst", "all", "best", "random"]),
        seed=st.integers(0, 2**63),
        evaluations=st.integers(1, 10**9),
        max_root_radius=st.floats(0.5, 0.99999),
        burn_in=st.integers(0, 1000),
    ),
}
NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,12}", fullmatch=True)
SOURCES = st.one_of(
    st.fixed_dictionaries({"synthesis": st.sampled_from(["armax", "flexible_arm"])}),
    st.fixed_dictionaries({"file": st.just("bench.csv")}, optional={"input_unit": st.text()}),
)
DATASETS = st.builds(lambda source, keys: source | keys, SOURCES, some(**ANALYSIS))
RIGHT = st.fixed_dictionaries(
    {"datasets": st.dictionaries(NAMES, DATASETS, min_size=1, max_size=3)},
    optional={"defaults": some(**ANALYSIS), "candidates_per_job": st.integers(1, 100)},
)
RESERVED = {"logs", "benchmarks", "seals"}


@given(RIGHT.filter(lambda config: not RESERVED & set(config["datasets"])))
@settings(max_examples=50, deadline=None)
def test_a_right_configuration_is_completed(config):
    completed = complete(copy.deepcopy(config), SCHEMA)
    assert list(completed["datasets"]) == list(config["datasets"])
    for dataset in completed["datasets"].values():
        assert set(ANALYSIS) <= set(dataset)
        assert sample_needs(dataset)["start"] == scoring_start(dataset)
        parts = [part_count(phase, dataset, completed["candidates_per_job"]) for phase in PHASES]
        assert min(parts) >= 1
    json.dumps(completed, allow_nan=False)


def keys_of(node):
    for key, child in node.get("properties", {}).items():
        yield key
        yield from keys_of(child)


KEYS = sorted({key for node in (KNOWN, *KNOWN["$defs"].values()) for key in keys_of(node)})
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.sampled_from(["auto", "none", "armax", "bench.csv", 10**400, -0.0, 1.0, 1e308]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=5), inner, max_size=4),
    max_leaves=6,
)  # fmt: skip


def places(value, path=()):
    """Every place in a nested configuration."""
    yield path
    if isinstance(value, dict):
        for key, child in value.items():
            yield from places(child, (*path, key))


@given(RIGHT, st.data())
@settings(max_examples=120, deadline=None)
def test_a_spoilt_configuration_is_completed_or_refused_in_one_sentence(config, data):
    config = copy.deepcopy(config)
    for _ in range(data.draw(st.integers(1, 3))):
        *path, last = data.draw(st.sampled_from([each for each in places(config) if each]))
        place = config
        for key in path:
            place = place[key]
        if data.draw(st.booleans()):
            place[last] = data.draw(VALUES)
        else:
            place[data.draw(st.sampled_from(KEYS) | st.text(max_size=6))] = place.pop(last)
    try:
        json.dumps(complete(config, SCHEMA), allow_nan=False)
    except InputError as refused:
        refusal = str(refused)
    else:
        return
    assert re.fullmatch(r"config\.yaml.*: .+; .+\.", refusal)


@pytest.mark.parametrize("text", ["datasets: {a: {synthesis: armax}}", "datasets: 7", "[]"])
@given(noise=st.binary(min_size=1, max_size=3), place=st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_bytes_that_are_hardly_yaml_are_refused_in_one_sentence(
    tmp_path_factory, text, noise, place
):
    from evopem.config.strict_yaml import check_yaml_files

    at = int(place * len(text))
    file = tmp_path_factory.mktemp("yaml") / "config.yaml"
    file.write_bytes(text[:at].encode() + noise + text[at:].encode())
    try:
        check_yaml_files([file])
    except InputError as refused:
        refusal = str(refused)
    else:
        return
    assert refusal.startswith(str(file))
    assert "\n" not in refusal
