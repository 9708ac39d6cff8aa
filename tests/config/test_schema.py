"""The keys as types: files written from them are current, and every key is described."""

import runpy
from pathlib import Path
from typing import get_args

import pytest

from evopem.config.defaults import complete
from evopem.config.keys import ANALYSIS, CONFIGURATION, SOURCE, SYNTHESIS
from evopem.config.schema import adapter, schema_file
from evopem.config.settings import CHAPTER_RANGES, SearchSettings, Structure
from evopem.config.structures import PHASES, STRUCTURES
from evopem.errors import InputError

ROOT = Path(__file__).parents[2]
WRITER = runpy.run_path(str(ROOT / "docs" / "write_keys.py"))


def test_the_schema_for_editors_is_current():
    """Else run python docs/write_keys.py."""
    assert schema_file().read_text(encoding="utf-8") == WRITER["schema_text"]()


def test_the_schema_of_verdicts_is_current():
    """Else run python docs/write_keys.py."""
    file = schema_file().with_name("verdict.schema.json")
    assert file.read_text(encoding="utf-8") == WRITER["verdict_schema_text"]()


def test_the_tables_of_the_documentation_are_current():
    """Else run python docs/write_keys.py."""
    page = WRITER["PAGE"].read_text(encoding="utf-8")
    assert page == WRITER["documentation"](page)
    for key in (*SOURCE, *SYNTHESIS, *ANALYSIS):
        assert f"`{key}` |" in page


def test_the_phases_are_the_grids_of_the_order_search():
    assert {name for name, each in vars(CHAPTER_RANGES).items() if each} == {*PHASES, "nk"}


def test_the_structures_are_those_of_the_package():
    assert set(get_args(Structure)) == set(STRUCTURES)


def test_built_in_settings_of_the_search_are_those_of_the_package():
    """One search, whether a configuration or a notebook starts it."""
    config = complete({"datasets": {"arm": {"synthesis": "flexible_arm", "recipe": "chapter"}}})
    assert config.datasets["arm"].search == SearchSettings()


def test_every_key_has_a_description():
    """An editor shows it, and an error ends with it."""
    schema = adapter(CONFIGURATION).json_schema()

    def walk(node, place):
        if "$ref" in node:
            node = schema["$defs"][node["$ref"].rpartition("/")[2]] | node
        assert node.get("description") or not place, place
        for key, below in node.get("properties", {}).items():
            if "priors" not in place and "poles" not in place:
                walk(below, f"{place}.{key}")
        if place == ".datasets":
            walk(node["additionalProperties"], f"{place}.NAME")

    walk(schema, "")


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"structure": "armx"}, "armx is not known (did you mean armax?); give the structure of"),
        ({"constraints": {"fixed_poles": [{"rael": 1}]}}, "fixed_poles[0].rael: there is no such"),
        ({"constraints": {"priors": [{"mean": 1}]}}, "priors[0]: the key quantity is missing"),
        ({"constraints": {"static_gain": {"u": "x"}}}, "static_gain.u: x cannot be used"),
        ({"orders": {"nb": {"u": [1, 99]}}}, "orders.nb.u[1]: 99 is above 60"),
        ({"input": [1, None]}, "input[1]: there is no value"),
    ],
)
def test_a_member_of_a_union_is_named_by_its_path(keys, sentence):
    with pytest.raises(InputError) as caught:
        complete({"datasets": {"a": {"file": "a.csv"} | keys}})
    assert sentence in str(caught.value)


def test_one_file_may_have_a_list_and_another_a_name(tmp_path, monkeypatch):
    """The form of a value decides alone what it is, whatever the other data sets have."""
    monkeypatch.chdir(tmp_path)
    config = complete(
        {
            "datasets": {
                "one": {"file": "a.csv", "input": "u", "output": "y"},
                "two": {"file": "b.csv", "input": ["a", "b"], "output": "y"},
            },
            "one_job_per": "recording",
        }
    )
    one, two = config.datasets.values()
    assert (one.channels.inputs, two.channels.inputs) == (("u",), ("a", "b"))
