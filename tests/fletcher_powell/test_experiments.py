"""Which runs are made, with which budgets, and how they are divided into jobs."""

import os
import re
import subprocess
import sys
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from evopem.files.json_form import from_json, to_json
from fletcher_powell import experiments
from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.experiments import Case
from fletcher_powell.settings import ScaleSettings, Settings, read_settings

ROOT = Path(__file__).parents[2]
BENCHMARK = ROOT / "benchmarks" / "fletcher_powell"


@pytest.fixture
def settings():
    return Settings(
        algorithms=tuple(ALGORITHMS),
        dimension=20,
        evaluations=200_000,
        instances=3,
        runs=7,
        slow_runs=2,
        scale=ScaleSettings((5, 30, 10), 4),
        runs_per_job=3,
        seed=1,
    )


def test_the_table_and_its_analytic_twin_share_the_jobs(settings):
    assert experiments.cases("table", "hybrid", 1, settings) == [
        Case("table", 20, "differences", 200_000, (1, 2, 3)),
        Case("precise", 20, "analytic", 200_000, (1, 2, 3)),
    ]
    assert experiments.cases("table", "ga", 3, settings) == [
        Case("table", 20, "differences", 200_000, (7,))
    ]


def test_the_budget_is_proportional_to_the_dimension(settings):
    cases = experiments.cases("scale", "hybrid", 1, settings)
    assert [(case.dimension, case.evaluations) for case in cases] == [
        (5, 50_000),
        (30, 300_000),
        (10, 100_000),
    ]
    assert {case.gradient for case in cases} == {"analytic"}


def test_the_rejected_choices_run_in_the_largest_dimension_only(settings):
    for name in ("hybrid-all", "hybrid-best", "hybrid-random", "hybrid-small"):
        assert [case.dimension for case in experiments.cases("scale", name, 1, settings)] == [30]


def test_the_contest_is_in_the_tables_dimension_and_the_largest(settings):
    cases = experiments.cases("contest", "default", 3, settings)
    assert cases == [
        Case("contest", 20, "analytic", 200_000, (7,)),
        Case("contest", 30, "analytic", 300_000, (7,)),
    ]


@pytest.mark.parametrize(
    ("part", "algorithm", "runs"),
    [
        ("contest", "monotonic-basin-hopping", 7),
        ("table", "hybrid", 7),
        ("table", "cma-es", 2),
        ("scale", "multi-start", 4),
        ("scale", "basin-hopping", 2),
    ],
)
@pytest.mark.parametrize("per_job", [1, 2, 3, 7, 100])
def test_the_jobs_make_every_run_once(settings, part, algorithm, runs, per_job):
    settings = replace(settings, runs_per_job=per_job)
    blocks = range(1, experiments.block_count(part, algorithm, settings) + 1)
    jobs = [experiments.cases(part, algorithm, block, settings) for block in blocks]
    made = Counter(
        (case.study, case.dimension, run) for job in jobs for case in job for run in case.runs
    )
    assert set(made.values()) == {1}
    assert {run for _, _, run in made} == set(range(1, runs + 1))
    assert all(case.runs for job in jobs for case in job)
    assert max(len(case.runs) for job in jobs for case in job) <= per_job


def test_the_files_of_all_jobs(settings):
    chosen = replace(settings, algorithms=("hybrid", "ga", "hybrid-small", "cma-es"))
    files = experiments.run_files(chosen)
    counts = Counter(file.rsplit("/", 2)[0] for file in files)
    # ceil(7 / 3) = 3 jobs, ceil(4 / 3) = 2, and 1 where there are at most 2 runs.
    assert counts == {
        "table/hybrid": 3 * 3,
        "table/ga": 3 * 3,
        "table/cma-es": 3 * 1,
        "scale/hybrid": 3 * 2,
        "scale/hybrid-small": 3 * 2,
        "contest/hybrid": 3 * 3,
    }
    assert len(set(files)) == len(files)
    assert "table/hybrid/cec2005-f12/3.json" in files
    assert "scale/hybrid/seed-2/2.json" in files


def test_every_algorithm_that_is_named_exists():
    assert Settings().algorithms == tuple(ALGORITHMS)
    assert set(ALGORITHMS) == {
        name for taking_part in experiments.TAKING_PART.values() for name in taking_part
    }


def test_every_figure_that_is_named_exists():
    from fletcher_powell.figures import COMPARISON_FIGURES

    assert tuple(entry.name for entry in COMPARISON_FIGURES) == experiments.FIGURES


def test_cases_and_settings_survive_their_json_form(settings):
    case = experiments.cases("scale", "hybrid", 2, settings)[1]
    assert from_json(Case, to_json(case)) == case
    assert from_json(Settings, to_json(settings)) == settings


def test_the_built_in_settings_are_the_chapters(tmp_path):
    built_in = read_settings(tmp_path / "missing.yaml")
    assert (built_in.dimension, built_in.evaluations) == (20, 200_000)
    assert built_in.instances * built_in.runs == 100
    assert built_in.algorithms == tuple(ALGORITHMS)


def test_a_file_replaces_some_settings(tmp_path):
    file = tmp_path / "fletcher_powell.yaml"
    built_in = read_settings(file)
    file.write_text("# nothing yet\n\n")
    assert read_settings(file) == built_in
    file.write_text("runs: 3.0\nscale: {runs: 5}\n")
    scale = replace(built_in.scale, runs=5)
    assert read_settings(file) == replace(built_in, runs=3, scale=scale)
    assert isinstance(read_settings(file).runs, int)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("dimension: 1", "dimension: 1 is below 2; give the number of variables"),
        ("algorithms: [hybird]", "algorithms[0]: hybird is not known (did you mean hybrid?)"),
        ("scale: {runs: 0}", "scale.runs: 0 is below 1"),
        ("datasets: {}", "datasets: there is no such key"),
        ("runs: 1\nruns: 2", "line 2: the key runs stands here for the second time"),
    ],
)
def test_a_wrong_setting_is_named_in_one_sentence(tmp_path, text, sentence):
    file = tmp_path / "fletcher_powell.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"fletcher_powell\.yaml") as caught:
        read_settings(file)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_snakefile_imports_the_plan_without_numpy():
    command = "import sys, fletcher_powell.packages, fletcher_powell.experiments"
    scripts = (BENCHMARK / "scripts", ROOT / "workflow" / "scripts")
    run = subprocess.run(
        [sys.executable, "-c", f"{command}; print('numpy' in sys.modules)"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, scripts))},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == "False"


def test_the_conda_environment_has_every_package_the_comparison_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    own = (BENCHMARK / "requirements.txt").read_text().splitlines()
    wanted = [
        *project["dependencies"],
        *project["optional-dependencies"]["report"],
        *(line for line in own if not line.startswith("#")),
    ]
    needed = {re.match(r"[\w.-]+", line)[0] for line in wanted}
    listed = yaml.safe_load((BENCHMARK / "environment.yaml").read_text())["dependencies"]
    plain = [*listed[:-1], *listed[-1]["pip"]]
    present = {line.split()[0].removesuffix("-base") for line in plain}
    assert present == needed | {"python", "pip"}
