"""The workflow as a module of another project, with that project's configuration and data."""

import shutil
import subprocess

import numpy as np
import pytest
import yaml

from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load

from .conftest import ROOT, TINY
from .forked_runs import OF_ANY_CHECKOUT

SNAKEFILE = """
configfile: "project.yaml"

module identification:
    snakefile: {snakefile}
    config: config["identification"]
    {prefix}

use rule * from identification as identification_*

rule first_mode:
    input: "{folder}results/bench/modes.csv"
    output: "first_mode.txt"
    shell: "head -n 2 {{input}} | tail -n 1 > {{output}}"

rule everything:
    default_target: True
    input: "first_mode.txt", rules.identification_all.input
"""

CHECKOUT = repr(str(ROOT / "Snakefile"))


@pytest.fixture
def project(tmp_path):
    """Another project: its own Snakefile, configuration and recording."""
    (tmp_path / "measured").mkdir()
    # Not a configuration of this workflow, and not even one that it would accept.
    (tmp_path / "config.yaml").write_text("project: of somebody else\nproject: twice\n")

    def write(prefix="", snakefile=CHECKOUT, **more):
        folder = f"{prefix}/" if prefix else ""
        given = f"prefix: {prefix!r}" if prefix else ""
        text = SNAKEFILE.format(snakefile=snakefile, prefix=given, folder=folder)
        (tmp_path / "Snakefile").write_text(text)
        source = {"file": "measured/bench.csv", "sampling_rate": 100}
        config = {"defaults": TINY["defaults"], "datasets": {"bench": source}} | more
        (tmp_path / "project.yaml").write_text(yaml.safe_dump({"identification": config}))
        return tmp_path

    return write


def snakemake(folder, *arguments, **environment):
    arguments = ("--nocolor", "--cores", "1", *arguments)
    return OF_ANY_CHECKOUT.run(arguments, folder, **environment)


def test_another_project_uses_the_workflow_under_a_prefix(project, finished, recorded):
    folder = project("models", one_job_per="recording", report="none")
    np.savetxt(folder / "measured" / "bench.csv", recorded, delimiter=",", fmt="%.17g")
    run = snakemake(folder)
    assert run.returncode == 0, run.stdout
    assert not (folder / "results").exists()
    made = load(ModelRecord, folder / "models" / "results" / "bench" / "model.json")
    own = load(ModelRecord, finished.files_of("truth").model)
    for name in "ABC":
        np.testing.assert_array_equal(getattr(made.model, name), getattr(own.model, name))
    frequency = float((folder / "first_mode.txt").read_text().split(",")[1])
    assert frequency == own.modes[0].frequency_hz
    assert "Nothing to be done" in snakemake(folder).stdout


def test_rules_keep_their_folders_without_a_prefix(project):
    folder = project()
    (folder / "measured" / "bench.csv").write_text("1,2\n")
    run = snakemake(folder, "--dry-run", "--quiet", "rules")
    assert run.returncode == 0, run.stdout
    assert "identification_estimate_candidates" in run.stdout


def test_an_error_names_the_modules_configuration(project):
    run = snakemake(project(candidates_per_job=0), "--dry-run")
    assert run.returncode != 0
    assert "config of the module, candidates_per_job: 0 is below 1" in run.stdout
    assert "Traceback" not in run.stdout


@pytest.fixture
def repository(tmp_path):
    """The workflow in a repository of its own, with a tag."""
    folder = tmp_path / "repository"
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for part in ("workflow", "benchmarks"):
        shutil.copytree(ROOT / part, folder / part, ignore=ignored)
    author = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    for command in (("init",), ("add", "."), (*author, "commit", "-m", "1"), ("tag", "v1")):
        subprocess.run(["git", "-C", folder, *command], check=True, capture_output=True)
    return folder


def test_a_tagged_repository_is_used_with_the_installed_package(
    project, repository, recorded, tmp_path
):
    """As from a hosting service: nothing of the workflow is a file beside the Snakefile."""
    address = f'gitfile({str(repository)!r}, path="workflow/Snakefile", tag="v1")'
    folder = project(snakefile=address, one_job_per="recording", report="none")
    np.savetxt(folder / "measured" / "bench.csv", recorded, delimiter=",", fmt="%.17g")
    missing = snakemake(folder, "--dry-run")
    assert missing.returncode != 0
    assert "its package evopem is not installed" in missing.stdout

    installed = tmp_path / "installed"
    shutil.copytree(ROOT / "workflow" / "scripts" / "evopem", installed / "evopem")
    for part in ("templates", "schemas"):
        shutil.copytree(ROOT / "workflow" / part, installed / "evopem" / part)
    # The trigger `code` stops Snakemake with a TypeError of its own where a module is a gitfile.
    triggers = ("--rerun-triggers", "mtime", "params", "input", "software-env")
    run = snakemake(folder, *triggers, PYTHONPATH=str(installed))
    assert run.returncode == 0, run.stdout
    assert (folder / "results" / "bench" / "summary.json").exists()
