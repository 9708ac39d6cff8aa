"""One version everywhere, and copies of one configuration."""

import subprocess
from pathlib import Path

import pytest
import yaml

import evopem

ROOT = Path(__file__).parents[2]


def test_the_citation_has_the_version_of_the_package():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == evopem.__version__


def test_a_tag_of_this_commit_is_the_version():
    run = subprocess.run(
        ["git", "-C", ROOT, "tag", "--points-at", "HEAD"],
        capture_output=True,
        text=True,
        check=False,
    )
    tags = [tag for tag in run.stdout.split() if tag.startswith("v")]
    if not tags:
        pytest.skip("this commit has no tag of a version")
    assert tags == [f"v{evopem.__version__}"]
    assert f"## {evopem.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_snakedeploy_copies_what_the_demonstration_simulates():
    """It takes the folder config/, without recordings; `snakemake` here reads the other file."""
    copied = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    shown = yaml.safe_load((ROOT / "config.yaml").read_text())["datasets"]
    simulated = {name: keys for name, keys in shown.items() if "synthesis" in keys}
    assert copied == {"datasets": simulated}


def test_editors_find_the_schema_of_every_configuration():
    for path in ("config.yaml", "config/config.yaml", "examples/motor_bench/config.yaml"):
        first = (ROOT / path).read_text().splitlines()[0]
        mark, _, schema = first.partition("$schema=")
        assert mark == "# yaml-language-server: "
        assert ((ROOT / path).parent / schema).is_file()


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150
