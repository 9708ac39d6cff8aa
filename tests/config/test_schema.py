"""The schema and the typed settings: the same keys, the same choices, the same defaults."""

from dataclasses import fields
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import pytest
import yaml

from evopem.config.constraints import Constraints
from evopem.config.defaults import complete
from evopem.config.settings import (
    DatasetSettings,
    DelaySettings,
    OrderSettings,
    RunSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    Structure,
    SyntheticSource,
    TransformSettings,
)
from evopem.config.state_space_checks import OWN_KEYS
from evopem.config.structures import PHASES, STRUCTURES
from evopem.config.yaml_form import ANALYSIS_KEYS, FILE_KEYS

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"
KEYS = yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))
MAPPINGS = {
    "transforms": TransformSettings,
    "split": SplitSettings,
    "spectrum": SpectrumSettings,
    "delay": DelaySettings,
    "orders": OrderSettings,
    "search": SearchSettings,
    "constraints": Constraints,
}


def names(*kinds):
    """Names of the fields of settings, as keys."""
    return {field.name.rstrip("_") for kind in kinds for field in fields(kind)}


@pytest.mark.parametrize(("mapping", "kind"), MAPPINGS.items())
def test_the_keys_of_a_mapping_are_the_fields_of_its_settings(mapping, kind):
    of_several_channels = {"nx", "nf"} if mapping == "orders" else set()
    assert set(KEYS["$defs"][mapping]["properties"]) == names(kind) | of_several_channels


def test_the_keys_of_a_data_set_are_its_source_and_its_analysis():
    keys = {"recipe", "purpose", "resample", "structure", "level", "focus", *MAPPINGS}
    assert set(ANALYSIS_KEYS) == keys
    source = names(SyntheticSource) | {*FILE_KEYS, "conditions"}
    analysis = {*ANALYSIS_KEYS, *OWN_KEYS}
    assert set(KEYS["$defs"]["dataset"]["properties"]) == source | analysis
    assert set(KEYS["properties"]["defaults"]["properties"]) == analysis


def test_the_keys_of_a_run_are_the_fields_of_its_settings():
    others = {"datasets", "defaults"}
    assert set(KEYS["properties"]) - others == names(RunSettings)


def choices(kind):
    """The fields of settings that hold one of a few words, with these."""
    for name, hint in get_type_hints(kind).items():
        if get_origin(hint) is Literal:
            yield name, set(get_args(hint))


@pytest.mark.parametrize(
    ("properties", "kind"),
    [
        (KEYS["properties"], RunSettings),
        (KEYS["$defs"]["search"]["properties"], SearchSettings),
        (KEYS["$defs"]["dataset"]["properties"], SyntheticSource),
    ],
)
def test_the_words_a_key_takes_are_those_of_its_field(properties, kind):
    listed = dict(choices(kind))
    assert listed
    assert {name: set(properties[name]["enum"]) for name in listed} == listed


def test_the_phases_are_the_grids_of_the_order_search():
    assert {"delay", *(field.name for field in fields(OrderSettings))} == set(PHASES)


def test_the_structures_are_those_of_the_package():
    assert set(KEYS["$defs"]["structure"]["enum"]) == {*STRUCTURES, "state_space"}
    assert set(get_args(Structure)) == set(STRUCTURES)


def test_built_in_settings_of_the_search_are_those_of_the_package():
    """One search, whether a configuration or a notebook starts it."""
    config = complete(
        {"datasets": {"arm": {"synthesis": "flexible_arm", "recipe": "chapter"}}}, SCHEMA
    )
    arm = config.datasets["arm"]
    assert isinstance(arm, DatasetSettings)
    assert arm.search == SearchSettings()


def test_every_key_has_a_description():
    """An editor shows it, and an error ends with it."""

    def resolved(node):
        return KEYS["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node

    def walk(node, place):
        node = resolved(node)
        assert node.get("description"), place
        for key, below in node.get("properties", {}).items():
            walk(below, f"{place}.{key}")

    walk(KEYS, "config")
    walk({"$ref": "#/$defs/dataset"}, "datasets.NAME")
