"""What is installed with evopem: pinned by hash, under licences that ask nothing, and no more."""

import importlib.metadata as metadata
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

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


def test_the_package_runs_on_its_own_dependencies_alone():
    """Estimate, draw and report with everything hidden that an extra or a test brings along."""
    own = {re.split(r"[<>=!~ ]", each)[0] for each in PROJECT["dependencies"]}
    extras = PROJECT["optional-dependencies"]
    hidden = {re.split(r"[<>=!~ ]", each)[0] for extra in extras.values() for each in extra}
    assert not own & hidden
    code = (
        "import sys, importlib, pathlib\n"
        f"for name in {sorted(hidden)!r}: sys.modules[name] = None\n"
        "root = pathlib.Path(sys.argv[1])\n"
        "for file in sorted(root.rglob('*.py')):\n"
        "    parts = file.relative_to(root.parent).with_suffix('').parts\n"
        "    importlib.import_module('.'.join(p for p in parts if p != '__init__'))\n"
    )
    package = ROOT / "workflow" / "scripts" / "evopem"
    run = subprocess.run(
        [sys.executable, "-c", code, package],
        env=os.environ | {"PYTHONPATH": str(package.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


def test_every_import_of_the_package_is_a_named_dependency():
    distributions = metadata.packages_distributions()
    named = {
        re.split(r"[<>=!~ \[]", each)[0].lower()
        for each in [
            *PROJECT["dependencies"],
            *[one for extra in PROJECT["optional-dependencies"].values() for one in extra],
        ]
    }
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
