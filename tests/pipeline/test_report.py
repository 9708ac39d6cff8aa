"""The stage that writes the report: the commit that it names, and the times that it finds."""

import shutil
import subprocess
from pathlib import Path

import pytest

from evopem.config.structures import PHASES
from evopem.pipeline.planning.stages import STAGES
from evopem.pipeline.report import commit_of, write_report
from evopem.report.page import BEFORE
from evopem.report.page_sections import PHASE_NAMES
from evopem.results.layout import FIGURES, DatasetFiles

WORKFLOW = Path(__file__).parents[2] / "workflow"

needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


@pytest.fixture
def workflow(tmp_path):
    """A folder with the layout of the workflow's own."""
    folder = tmp_path / "checkout" / "workflow"
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(WORKFLOW / "scripts" / "run_stage.py", folder / "scripts")
    (folder.parent / "Snakefile").write_text("")
    return folder


def git(folder, *arguments):
    identity = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
    run = subprocess.run(
        ["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return run.stdout.strip()


def test_outside_a_checkout_the_commit_is_unknown(workflow):
    assert commit_of(workflow) == "unknown"


@needs_git
def test_inside_the_checkout_of_another_project_it_is_unknown(workflow):
    git(workflow.parent, "init", "--quiet")
    git(workflow.parent, "commit", "--quiet", "--allow-empty", "-m", "another project")
    assert commit_of(workflow) == "unknown"


@needs_git
def test_the_commit_and_changes_to_it_are_named(workflow):
    git(workflow.parent, "init", "--quiet")
    git(workflow.parent, "add", ".")
    git(workflow.parent, "commit", "--quiet", "-m", "all")
    commit = git(workflow.parent, "rev-parse", "HEAD")
    assert commit_of(workflow) == commit
    (workflow.parent / "results.txt").write_text("not part of the workflow")
    assert commit_of(workflow) == commit
    (workflow.parent / "Snakefile").write_text("# changed")
    assert commit_of(workflow) == f"{commit}, with changes that are not committed"


def test_the_times_shown_are_those_of_the_stages():
    assert set(BEFORE) <= {stage.name for stage in STAGES}
    assert set(PHASE_NAMES) <= {*PHASES}


def test_figures_and_times_stand_on_the_page(identified, undrawn, tmp_path):
    files = DatasetFiles(str(shutil.copytree(identified.files.folder, tmp_path / "bench")))
    benchmark = Path(files.benchmark("estimate_spectrum"))
    benchmark.parent.mkdir()
    benchmark.write_text("s\n98.76\n")
    write_report(files)
    page = Path(files.report).read_text(encoding="utf-8")
    assert "98.8" in page
    assert page.count("<svg") == len(FIGURES)
