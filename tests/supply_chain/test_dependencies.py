"""What is installed with evopem: pinned by hash, under licences that ask nothing, and no more."""

import importlib.metadata as metadata
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "requirements.lock").read_text()
PINS = re.findall(r"^([A-Za-z0-9_.-]+)==([^ ;\\]+)(.*(?:\n    .*)*)", LOCK, re.MULTILINE)

PERMISSIVE = re.compile(
    r"\b(MIT(-CMU)?|BSD|0BSD|BSD-[23]-Clause|Apache([ -](2\.0|License|Software License))?|PSF-2\.0"
    r"|Python Software Foundation License|Zlib|CC0-1\.0)\b"
)
# Others, each looked at: used as libraries, unchanged, so they ask nothing of evopem's users.
LOOKED_AT = {
    "certifi": "MPL-2.0, a file of certificates that Snakemake's downloads use",
    "docutils": "public domain; one Emacs file, which is not used, is under the GPL",
    "nptdms": "LGPL-3.0-only, imported to read TDMS files, and only where they are read",
}


def names(requirements):
    """Names of the distributions, evopem itself left out."""
    return {re.split(r"[<>=!~ \[]", each)[0] for each in requirements} - {"evopem"}


def licence(name):
    """What a distribution says of its licence: expression, classifiers, field, or licence file."""
    about = metadata.metadata(name)
    classifiers = [
        each.rpartition(" :: ")[2]
        for each in about.get_all("Classifier") or []
        if each.startswith("License")
    ]
    stated = [about.get("License-Expression"), *classifiers, (about.get("License") or "")[:60]]
    files = [
        file
        for file in metadata.files(name) or []
        if re.search(r"licen[cs]e|copying", file.name, re.IGNORECASE)
    ]
    stated += [file.read_text()[:200] for file in files if not any(stated)]
    return " ".join(filter(None, stated))


def test_every_dependency_is_pinned_with_its_hashes():
    named = re.findall(r"^[A-Za-z0-9]\S*", LOCK, re.MULTILINE)
    assert len(named) == len(PINS) > 50
    for name, _, rest in PINS:
        assert "--hash=sha256:" in rest, name


@pytest.mark.parametrize("name", sorted({name for name, _, _ in PINS}))
def test_the_licence_of_a_dependency_asks_nothing(name):
    try:
        stated = licence(name)
    except metadata.PackageNotFoundError:
        pytest.skip(f"{name} is for another platform")
    if name not in LOOKED_AT:
        assert PERMISSIVE.search(stated), stated
        assert not re.search(r"\bA?L?GPL|General Public", stated), stated


# Parts of the package that need the extra `report`; all others are the numerics.
OF_THE_EXTRA_REPORT = (
    *("figures", "notebook", "pipeline", "report", "results", "terminal", "validation"),
)
IMPORTS = """
import importlib, pathlib, sys

for name in HIDDEN:
    sys.modules[name] = None
root = pathlib.Path(sys.argv[1])
for file in sorted(root.rglob("*.py")):
    parts = file.relative_to(root.parent).with_suffix("").parts
    if parts[1] not in LEFT_OUT:
        importlib.import_module(".".join(part for part in parts if part != "__init__"))
"""


@pytest.mark.parametrize(
    ("extras", "left_out"), [((), OF_THE_EXTRA_REPORT), (("report",), ())], ids=["none", "report"]
)
def test_a_part_of_the_package_imports_only_what_it_is_installed_with(extras, left_out):
    """Import every module with all hidden that another extra brings along."""
    optional = PROJECT["optional-dependencies"]
    installed = names(PROJECT["dependencies"]) | {
        name for extra in extras for name in names(optional[extra])
    }
    hidden = {name for extra in optional.values() for name in names(extra)} - installed
    package = ROOT / "workflow" / "scripts" / "evopem"
    run = subprocess.run(
        [sys.executable, "-c", f"HIDDEN, LEFT_OUT = {hidden!r}, {left_out!r}\n{IMPORTS}", package],
        env=os.environ | {"PYTHONPATH": str(package.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


def test_the_extra_workflow_has_what_every_stage_and_the_archive_need():
    workflow = PROJECT["optional-dependencies"]["workflow"]
    assert {"evopem[report,formats]", "snakemake>=9.11", "pygments>=2.17"} <= set(workflow)
    assert {"pandas", "matplotlib", "jinja2", "h5py", "pyarrow", "pygments"} <= {
        name for name, _, _ in PINS
    }


def test_the_conda_environment_of_a_job_has_the_same_packages():
    """Jobs need what the extras `report` and `formats` bring, and no Snakemake."""
    listed = yaml.safe_load((ROOT / "workflow" / "envs" / "evopem.yaml").read_text())
    *conda, pip = listed["dependencies"]
    optional = PROJECT["optional-dependencies"]
    needed = [*PROJECT["dependencies"], *optional["report"], *optional["formats"]]
    # conda-forge has matplotlib without its user interfaces under another name.
    named = {each.replace(" ", "").replace("matplotlib-base", "matplotlib") for each in conda}
    named |= {each.replace(" ", "") for each in pip["pip"]}
    assert named - {"pip", f"python{PROJECT['requires-python']}"} == set(needed)


def test_every_import_of_the_package_is_a_named_dependency():
    distributions = metadata.packages_distributions()
    optional = PROJECT["optional-dependencies"].values()
    named = names([*PROJECT["dependencies"], *(one for extra in optional for one in extra)])
    named = {name.lower() for name in named}
    # Parts of numba and jinja2, which pin their versions.
    named |= {"llvmlite", "markupsafe"}
    imported = set()
    for file in (ROOT / "workflow" / "scripts").rglob("*.py"):
        lines = file.read_text().splitlines()
        imported |= {
            match[1]
            for line in lines
            if (match := re.match(r"\s*(?:from|import) ([A-Za-z0-9_]+)", line))
        }
    foreign = {name for name in imported - set(sys.stdlib_module_names) if name in distributions}
    unnamed = {name for name in foreign if distributions[name][0].lower() not in named}
    assert unnamed <= {"evopem"}, unnamed


def test_the_half_that_make_installs_for_a_search_is_what_the_package_requires():
    (pattern,) = re.findall(r"^SEARCH := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    needed, left = set(), names(PROJECT["dependencies"])
    while left:
        needed.add(name := left.pop().replace("_", "-"))
        plain = [each for each in metadata.requires(name) or [] if "extra ==" not in each]
        left |= {each.replace("_", "-") for each in names(plain)} - needed
    assert {name for name, *_ in PINS if re.fullmatch(pattern, name)} == needed
