"""The script that writes the report: the commit it names, and the times it finds."""

import importlib.util
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "workflow" / "scripts" / "write_report.py"

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


@pytest.fixture(scope="module")
def write_report():
    spec = importlib.util.spec_from_file_location("write_report", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def workflow(tmp_path):
    """A folder laid out as the workflow's own."""
    folder = tmp_path / "checkout" / "workflow"
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(SCRIPT, folder / "scripts")
    (folder.parent / "Snakefile").write_text("")
    return folder


def git(folder, *arguments):
    identity = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
    run = subprocess.run(
        ["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return run.stdout.strip()


def test_outside_a_checkout_the_commit_is_unknown(write_report, workflow):
    assert write_report.commit_of(workflow) == "unknown"


def test_inside_somebody_elses_checkout_too(write_report, workflow):
    git(workflow.parent, "init", "--quiet")
    git(workflow.parent, "commit", "--quiet", "--allow-empty", "-m", "not the workflow's")
    assert write_report.commit_of(workflow) == "unknown"


def test_the_commit_and_changes_to_it_are_named(write_report, workflow):
    git(workflow.parent, "init", "--quiet")
    git(workflow.parent, "add", ".")
    git(workflow.parent, "commit", "--quiet", "-m", "all")
    commit = git(workflow.parent, "rev-parse", "HEAD")
    assert write_report.commit_of(workflow) == commit
    (workflow.parent / "results.txt").write_text("not part of the workflow")
    assert write_report.commit_of(workflow) == commit
    (workflow.parent / "Snakefile").write_text("# changed")
    assert write_report.commit_of(workflow) == f"{commit}, with changes that are not committed"


def test_times_beside_the_results_reach_the_page(write_report, results, tmp_path):
    directory = shutil.copytree(results, tmp_path / "arm")
    (directory / "benchmarks").mkdir()
    (directory / "benchmarks" / "spectrum.tsv").write_text("s\n98.76\n")
    files = [str(file) for file in directory.rglob("*") if file.suffix != ".tsv" and file.is_file()]
    page = directory / "report.html"
    write_report.main(files, SCRIPT.parents[1], "arm", str(page))
    assert "98.8" in page.read_text(encoding="utf-8")
