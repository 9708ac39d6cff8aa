"""The digest of a script's code: what changes it, and what does not."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evopem.config.rule_digest import code_version, reached_files
from evopem.pipeline.planning.stages import STAGES

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"


@pytest.fixture
def scripts(tmp_path):
    package = tmp_path / "evopem"
    (package / "signals").mkdir(parents=True)
    (package / "formats").mkdir()
    for name, text in {
        "one.py": "from evopem.signals.a import x\n",
        "evopem/__init__.py": "",
        "evopem/signals/__init__.py": "",
        "evopem/signals/a.py": "def x():\n    from .b import y\n    return y\n",
        "evopem/signals/b.py": "import evopem.errors\ny = 1\n",
        "evopem/signals/c.py": "z = 1\n",
        "evopem/formats/text.py": "read = 1\n",
        "evopem/errors.py": (
            "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from evopem.signals.c import z\n"
        ),
    }.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def version(scripts):
    """Digest in a fresh process: one process reads each file once."""
    command = (
        "import sys; from evopem.config.rule_digest import code_version as v; print(v(sys.argv[1]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", command, scripts / "one.py"],
        env=os.environ | {"PYTHONPATH": str(SCRIPTS)},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout


def imported_modules(script, root=None):
    """The files a script reaches by its imports, relative to its own folder or another."""
    root = root or script.parent
    return sorted(path.relative_to(root).as_posix() for path in reached_files([script], (root,)))


def test_imports_are_followed_into_functions_and_not_into_type_checking(scripts):
    assert imported_modules(scripts / "one.py") == [
        "evopem/errors.py",
        "evopem/signals/__init__.py",
        "evopem/signals/a.py",
        "evopem/signals/b.py",
    ]


def test_modules_whose_names_are_put_together_are_found(scripts):
    (scripts / "two.py").write_text("import_module(f'evopem.formats.{name}')\n")
    assert imported_modules(scripts / "two.py") == ["evopem/formats/text.py"]


@pytest.mark.parametrize("name", ["one.py", "evopem/signals/b.py", "evopem/errors.py"])
def test_code_that_is_used_counts(scripts, name):
    before = version(scripts)
    (scripts / name).write_text((scripts / name).read_text() + "more = 1\n")
    assert version(scripts) != before


def test_code_that_is_not_used_times_and_places_do_not_count(scripts):
    before = version(scripts)
    (scripts / "evopem" / "signals" / "c.py").write_text("z = 2\n")
    os.utime(scripts / "one.py", (1, 1))
    moved = scripts.rename(scripts.parent / "moved")
    assert version(moved) == before


def test_templates_count(scripts):
    template = scripts / "page.html"
    template.write_text("<p>")
    with_template = code_version(scripts / "one.py", [template])
    assert with_template != code_version(scripts / "one.py")


def test_stages_reach_their_part_of_the_package_and_no_more():
    reached = {
        stage.function.partition(":")[2]: imported_modules(stage.module, SCRIPTS)
        for stage in STAGES
    }
    assert "evopem/signals/readers/matlab.py" in reached["read_recording"]
    assert "evopem/signals/readers/matlab.py" not in reached["prepare_samples"]
    assert "evopem/estimation/order_selection.py" in reached["estimate_candidates"]
    assert "evopem/signals/spectra.py" in reached["estimate_spectrum"]
    early = ("read_recording", "prepare_samples", "estimate_spectrum", "estimate_candidates")
    for name in (*early, "search_structures", "choose"):
        later = [each for each in reached[name] if "/figures/" in each or "/report/" in each]
        assert later == [], name
    for module in ("spectra", "peaks"):
        assert f"evopem/signals/{module}.py" not in reached["estimate_candidates"]
    assert "evopem/config/defaults.py" not in reached["estimate_candidates"]


@pytest.mark.parametrize(
    ("module", "users", "others"),
    [
        (
            "signals/peaks.py",
            {"estimate_spectrum"},
            {"read_recording", "estimate_candidates"},
        ),
        ("figures/style.py", {"write_report"}, {"estimate_spectrum", "complete_results"}),
        ("validation/tables.py", {"complete_results"}, {"estimate_candidates", "complete_model"}),
        (
            "estimation/pem/kernels/gradient.py",
            # Preparation is decided by models as well.
            {"estimate_candidates", "select_candidate", "prepare_samples"},
            {"read_recording", "estimate_spectrum"},
        ),
        ("config/order_grid.py", {"estimate_candidates"}, {"estimate_spectrum", "read_recording"}),
        ("signals/readers/matlab.py", {"read_recording"}, {"prepare_samples", "complete_model"}),
    ],
)
def test_changed_code_changes_the_digests_of_the_stages_that_use_it(
    tmp_path, module, users, others
):
    scripts = tmp_path / "scripts"
    shutil.copytree(SCRIPTS, scripts, ignore=shutil.ignore_patterns("__pycache__"))
    file = scripts / "evopem" / module
    file.write_text(file.read_text(encoding="utf-8") + "\n# changed\n", encoding="utf-8")

    def digest(folder, *modules):
        own = [folder / module.relative_to(SCRIPTS) for module in modules]
        return code_version(folder / "run_stage.py", modules=own)

    changed = {
        stage.function.partition(":")[2]
        for stage in STAGES
        if digest(SCRIPTS, stage.module) != digest(scripts, stage.module)
    }
    assert users <= changed
    every = [stage.module for stage in STAGES]
    assert digest(SCRIPTS, *every) != digest(scripts, *every)
    assert not others & changed


def test_scripts_name_submodules_and_not_the_package():
    """`from evopem import load` would hide the module behind it from the digest."""
    for script in SCRIPTS.rglob("*.py"):
        for line in script.read_text(encoding="utf-8").splitlines():
            assert not line.strip().startswith("from evopem import load"), script
