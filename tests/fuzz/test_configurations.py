"""Random configurations: valid ones are completed, all others are refused in one sentence."""

import copy
import json
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from evopem.config.defaults import complete, read_settings, yaml_text
from evopem.config.order_grid import part_count, sample_requirements, scoring_window
from evopem.config.structures import phases_of
from evopem.errors import InputError
from evopem.files.json_form import to_json

PHASES = phases_of("armax")

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"
KNOWN = yaml.safe_load(SCHEMA.read_text())


def ranges(lowest, highest):
    return st.tuples(*[st.integers(lowest, highest)] * 2).map(sorted)


TEXT = st.text(st.characters(exclude_categories=["Cs", "Cc"]))


def some(**keys):
    """A mapping with any of these keys."""
    return st.fixed_dictionaries({}, optional=keys)


ANALYSIS = {
    "resample": st.just("none") | st.floats(0.1, 1e6),
    "transforms": some(
        box_cox=st.sampled_from(["auto", "none"]) | st.floats(-5, 5),
        difference=st.integers(0, 4),
        difference_input=st.integers(0, 4),
    ),
    "split": some(
        discard=st.integers(0, 10_000) | st.floats(0.01, 0.9),
        estimation=st.integers(1, 10_000) | st.floats(0.1, 0.9),
    ),
    "spectrum": some(time_halfbandwidth=st.floats(1.5, 20), nfft=st.integers(64, 2**20)),
    "delay": some(orders=ranges(1, 60), nk=ranges(0, 1000)),
    "orders": some(plant=ranges(1, 60) | st.just("auto"), nc=ranges(1, 60), nb=ranges(1, 60)),
    "search": some(
        objective=st.sampled_from(["absolute", "quadratic"]),
        refine=st.sampled_from(["worst", "all", "best", "random"]),
        seed=st.integers(0, 2**63),
        evaluations=st.integers(1, 10**9),
        max_root_radius=st.floats(0.5, 0.99999),
        n_initial_discard=st.integers(0, 1000),
    ),
    "focus": st.sampled_from(["prediction", "simulation"]) | st.integers(1, 1000),
    "constraints": some(
        max_pole_radius=st.floats(0.5, 2),
        forbidden_bands=st.lists(st.tuples(st.floats(0, 10), st.floats(10, 100)), max_size=2),
        static_gain_bounds=st.tuples(st.none(), st.floats(-9, 9)),
        fixed_coefficients=st.dictionaries(st.sampled_from(["a1", "b0"]), st.floats(-9, 9)),
        fixed_poles=st.lists(some(real=st.floats(-1, 1)), max_size=2),
        priors=st.lists(
            st.fixed_dictionaries(
                {
                    "quantity": TEXT,
                    "mean": st.floats(-9, 9),
                    "standard_deviation": st.floats(0.1, 9),
                }
            ),
            max_size=2,
        ),
    ),
}


def told_apart(source):
    """A source whose input is not its output, which is 2 where it is left out."""
    return {"output": 3} | source if source.get("input") == 2 else source


NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,12}", fullmatch=True)
SOURCES = st.one_of(
    st.fixed_dictionaries({"synthesis": st.sampled_from(["armax", "flexible_arm"])}),
    st.fixed_dictionaries(
        {"file": st.just("bench ü.csv")},
        optional={
            "input": st.integers(1, 99) | TEXT.filter(lambda name: name and "*" not in name),
            "output": st.integers(100, 199),
            "input_unit": TEXT,
            "validation_file": st.just("independent.csv"),
        },
    ).map(told_apart),
)
DATASETS = st.builds(lambda source, keys: source | keys, SOURCES, some(**ANALYSIS))
# Every key of the analysis has a built-in value in the chapter's recipe alone.
VALID = st.fixed_dictionaries(
    {
        "datasets": st.dictionaries(NAMES, DATASETS, min_size=1, max_size=3),
        "defaults": some(**ANALYSIS).map(lambda keys: {"recipe": "chapter"} | keys),
    },
    optional={
        "candidates_per_job": st.integers(1, 100) | st.just("auto"),
        "one_job_per": st.sampled_from(["auto", "stage", "recording"]),
        "report": st.sampled_from(["html", "none"]),
    },
)
RESERVED = {"logs", "benchmarks", "checksums"}


@given(VALID.filter(lambda config: not RESERVED & set(config["datasets"])))
@settings(max_examples=30, deadline=None)
def test_a_valid_configuration_is_completed(tmp_path_factory, config):
    """What is written for each of its data sets gives the same settings again."""
    written = tmp_path_factory.getbasetemp() / "config.yaml"
    completed = complete(copy.deepcopy(config))
    assert list(completed.datasets) == list(config["datasets"])
    for name, dataset in completed.datasets.items():
        assert dataset.name == name
        assert {*ANALYSIS} - {"focus", "constraints"} <= set(dataset.keys)
        written.write_text(yaml_text(dataset), encoding="utf-8")
        assert read_settings(written) == dataset
        assert complete(yaml.safe_load(written.read_text(encoding="utf-8"))).datasets == {
            name: dataset
        }
        assert sample_requirements(dataset).loss_start == scoring_window(dataset).loss_start
        per_job = completed.run.candidates_per_job
        assert min(part_count(phase, dataset.order_grid, per_job) for phase in PHASES) >= 1
    json.dumps(to_json(completed), allow_nan=False)


def names_of(node):
    for key, child in node.get("properties", {}).items():
        yield key
        yield from names_of(child)


KEYS = sorted({key for node in (KNOWN, *KNOWN["$defs"].values()) for key in names_of(node)})
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


@given(VALID, st.data())
@settings(max_examples=80, deadline=None)
def test_a_changed_configuration_is_completed_or_refused_in_one_sentence(config, data):
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
        json.dumps(to_json(complete(config)), allow_nan=False)
    except InputError as refused:
        refusal = str(refused)
    else:
        return
    # Text below `datasets` is the path of a table, which an error names instead.
    table = config.get("datasets")
    source = ".*" if isinstance(table, str) else r"config\.yaml.*"
    assert re.fullmatch(rf"{source}: .+; .+\.", refusal)


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
