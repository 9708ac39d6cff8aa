"""Write the keys of config.yaml from their types: the JSON schema, and the tables of a page.

The JSON schema of verdict.json comes from the types of its record.

    python docs/write_keys.py

A table stands between ``<!-- keys: NAME -->`` and ``<!-- end -->``; NAME is one of :data:`TABLES`.
"""

import json
import re
import sys
from dataclasses import fields
from pathlib import Path

import yaml
from pydantic import ConfigDict, TypeAdapter

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem.config.channels import ChannelSettings, SyntheticSource  # noqa: E402
from evopem.config.configuration import RunSettings  # noqa: E402
from evopem.config.keys import (  # noqa: E402
    ANALYSIS,
    CONFIGURATION,
    RUN,
    SOURCE,
    SOURCE_OF_ANY,
    SYNTHESIS,
    mapping,
)
from evopem.config.schema import adapter, described  # noqa: E402
from evopem.config.settings import (  # noqa: E402
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
    VaryingSettings,
)
from evopem.report.verdict import Use  # noqa: E402
from evopem.report.verdict_file import ListedMode, VerdictFile  # noqa: E402
from evopem.results.dataset import StatedDelay  # noqa: E402
from evopem.validation.checks import Check  # noqa: E402

PAGE = ROOT / "docs" / "configuration.md"
SCHEMA = ROOT / "workflow" / "schemas" / "config.schema.yaml"
VERDICT_SCHEMA = SCHEMA.with_name("verdict.schema.json")
HEAD = "# Written by docs/write_keys.py from the types in evopem.config.keys.\n"
DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
LINK = re.compile(r"\[([^]]*)\]\([^)]*\)")
GROUPS = ("transforms", "split", "spectrum", "delay", "orders", "search")
"""Mappings whose keys have rows of their own."""


def schema_text() -> str:
    """The JSON schema, for editors."""
    return HEAD + yaml.safe_dump(
        DRAFT | _plain(adapter(CONFIGURATION).json_schema()),
        sort_keys=False,
        allow_unicode=True,
        width=100,
    )


def verdict_schema_text() -> str:
    """The JSON schema of ``verdict.json``, with what the fields say of themselves."""
    for kind in (Check, ListedMode, StatedDelay, Use, VerdictFile):
        kind.__pydantic_config__ = ConfigDict(use_attribute_docstrings=True)
    schema = TypeAdapter(VerdictFile).json_schema(mode="serialization")
    return json.dumps(DRAFT | _plain(schema), indent=1, ensure_ascii=False) + "\n"


def _plain(node):
    """A schema without titles, and without links in its texts."""
    if isinstance(node, dict):
        return {
            key: _plain(each)
            for key, each in node.items()
            if key not in ("built_in", "title") or isinstance(each, dict)
        }
    if isinstance(node, list):
        return [_plain(each) for each in node]
    return LINK.sub(r"\1", node) if isinstance(node, str) else node


def _built_in(about: dict, name: str, kinds: tuple[type, ...]) -> str:
    """What a key has where it is not written: as it says, else the default of its field."""
    values = [
        each.default
        for kind in kinds
        for each in fields(kind)
        if each.name.rstrip("_") == name and isinstance(each.default, bool | int | float | str)
    ]
    shown = [f"`{each}`" if isinstance(each, str) else json.dumps(each) for each in values]
    return about.get("built_in") or next(iter(shown), "")


SHORT = {
    r"^the ": "",
    r"an? (whole )?number of at least (\S+?)(?=[ ,.]|$)": r"\1number ≥ \2",
    r"an? (whole )?number from (\d\S*) to (\S+?)(?=[ ,.]|$)": r"\1number \2–\3",
    r"a list of them or a mapping from names to them": "list, or mapping by name",
}


def _short(text: str) -> str:
    """A meaning as a table has it: what sentences need besides is left out."""
    for pattern, words in SHORT.items():
        text = re.sub(pattern, words, text)
    return text


def table(keys: dict, kinds: tuple[type, ...]) -> str:
    """The rows of some keys, those of a mapping below it."""
    schema = adapter(mapping("Table", keys)).json_schema()
    rows = ["| key | meaning | built in |", "|---|---|---|"]

    def add(name: str, about: dict, level: str) -> None:
        kinds_of = [each["$ref"] for each in (about, *about.get("anyOf", ())) if "$ref" in each]
        has_table = name in (*GROUPS, "varying") and not level
        below = schema["$defs"][kinds_of[0].rpartition("/")[2]]["properties"] if has_table else {}
        text = _short(". ".join(filter(None, described(about))))
        if below:
            text = text.partition(", a mapping of ")[0]
        built_in = _built_in(about, name, kinds)
        rows.append(f"| {level}`{name}` | {text} | {built_in} |")
        for key, inner in below.items():
            add(key, inner, "&nbsp; ")

    for name, about in schema["properties"].items():
        add(name, about, "")
    return "\n".join(rows)


TABLES = {
    "run": (RUN, (RunSettings,)),
    "source": (SOURCE | SOURCE_OF_ANY, (ChannelSettings,)),
    "synthesis": (SYNTHESIS, (SyntheticSource,)),
    "analysis": (
        ANALYSIS,
        (TransformSettings, SplitSettings, SpectrumSettings, SearchSettings, VaryingSettings),
    ),
}


def documentation(text: str) -> str:
    """A page with the tables between its markers written anew."""
    return re.sub(
        r"(<!-- keys: (\w+) -->\n).*?(<!-- end -->)",
        lambda found: f"{found[1]}\n{table(*TABLES[found[2]])}\n\n{found[3]}",
        text,
        flags=re.DOTALL,
    )


if __name__ == "__main__":
    SCHEMA.write_text(schema_text(), encoding="utf-8")
    VERDICT_SCHEMA.write_text(verdict_schema_text(), encoding="utf-8")
    PAGE.write_text(documentation(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
