"""Small runs of the comparison by Snakemake, as a user starts them."""

import csv
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import yaml
from setuptools import find_packages
from workflow.forked_runs import FORKED

from evopem.config.source_checks import is_valid
from evopem.files.json_form import to_json
from fletcher_powell import experiments
from fletcher_powell.runs import run_cases
from fletcher_powell.settings import read_settings

ROOT = Path(__file__).parents[2]
BENCHMARK = ROOT / "benchmarks" / "fletcher_powell"
PACKAGES = ("cma", "optproblems")
SMALL = {
    "algorithms": ["hybrid", "hybrid-best", "ga"],
    "dimension": 4,
    "evaluations": 3000,
    "instances": 1,
    "runs": 3,
    "slow_runs": 1,
    "scale": {"dimensions": [2, 3], "runs": 2},
}


@dataclass(frozen=True)
class Folder:
    """A user's folder, with data sets for the product and settings for the comparison."""

    path: Path

    @property
    def results(self):
        return self.path / "results" / "fletcher_powell"

    def configure(self, **settings):
        self.path.mkdir(exist_ok=True)
        config = {"datasets": {"arm": {"synthesis": "flexible_arm"}}}
        (self.path / "config.yaml").write_text(yaml.safe_dump(config))
        (self.path / "fletcher_powell.yaml").write_text(yaml.safe_dump(SMALL | settings))
        return self

    def run(self, *targets, snakefile=ROOT / "Snakefile", options=(), missing=()):
        """Run Snakemake with this folder as its directory; all it printed is in `stdout`."""
        arguments = ["--nocolor", "--cores", "1", "--snakefile", str(snakefile)]
        arguments += ["--directory", str(self.path), *options, "--", *targets]
        return FORKED.run(arguments, self.path.parent, missing=missing)

    def planned(self, *targets, missing=()):
        """Jobs that a run would make: how many of each rule."""
        options = ("--dry-run", "--quiet", "rules")
        run = self.run(*targets, options=options, missing=missing)
        assert run.returncode == 0, run.stdout
        if "Nothing to be done" in run.stdout:
            return {}
        table = run.stdout.split("Job stats:", 1)[1].split("\n\n", 1)[0]
        rows = (line.split() for line in table.splitlines()[3:])
        return {row[0]: int(row[1]) for row in rows if row and row[0] != "total"}

    def table(self, name="table.csv"):
        with (self.results / name).open(encoding="utf-8") as stream:
            return list(csv.DictReader(stream))


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path / "own")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished run and what it printed; nobody changes it."""
    pytest.importorskip("optproblems")
    folder = Folder(tmp_path_factory.mktemp("comparison") / "own").configure()
    run = folder.run("fletcher_powell")
    assert run.returncode == 0, run.stdout
    return folder, run.stdout


@pytest.fixture(scope="module")
def compared(made):
    return made[0]


def test_nothing_is_printed_but_progress(made):
    """No rule of the product may try to make the comparison's files."""
    _, printed = made
    for word in ("Traceback", "Exception", "KeyError", "Error", "Warning"):
        assert word not in printed, printed


def test_it_makes_its_tables_figures_and_page_and_nothing_else(compared):
    for name in ("report.html", "table.csv", "table.md", "runs.csv", "convergence.csv"):
        assert (compared.results / name).stat().st_size > 0, name
    for figure in experiments.FIGURES:
        assert "<svg" in (compared.results / "figures" / f"{figure}.svg").read_text()
    assert [path.name for path in (compared.path / "results").iterdir()] == ["fletcher_powell"]


def test_a_plain_run_has_no_part_of_it_and_needs_no_packages_of_it(folder):
    planned = folder.configure().planned(missing=PACKAGES)
    assert "report" in planned
    assert not [rule for rule in planned if "fletcher_powell" in rule]


def test_its_own_snakefile_makes_the_same_files(compared):
    run = compared.run(snakefile=BENCHMARK / "Snakefile", options=("--dry-run",))
    assert "Nothing to be done" in run.stdout, run.stdout


def test_the_table_agrees_with_the_runs(compared):
    rows = {(row["study"], row["dimension"], row["algorithm"]): row for row in compared.table()}
    runs = compared.table("runs.csv")
    assert len(runs) == 3 * 3 + 2 * 3 + 2 * 2 + 2 + 2 * 3
    hybrid = rows["table", "4", "hybrid"]
    own = [r for r in runs if r["study"] == "table" and r["algorithm"] == "hybrid"]
    assert hybrid["runs"] == hybrid["successes"] == "3"
    assert all(run["evaluations"] == "3000" for run in own)
    assert all(
        int(run["success_values"]) + 4 * int(run["success_gradients"])
        == int(run["success_evaluations"])
        for run in own
    )
    mean = sum(int(run["success_evaluations"]) for run in own) / 3
    assert float(hybrid["expected_evaluations"]) == pytest.approx(mean)
    assert float(hybrid["expected_if_differences"]) == pytest.approx(mean)
    precise = rows["precise", "4", "hybrid"]
    assert float(precise["P_max"]) < -20.0
    ga = rows["table", "4", "ga"]
    assert ga["gradient"] == "none"
    assert float(ga["P_mean"]) > float(hybrid["P_mean"]) + 3.0
    # The chapter's numbers are for n = 20 and stand beside no other setting.
    assert {row["chapter_mean"] for row in rows.values()} == {""}


def test_no_hypothesis_is_tested_without_its_runs(compared):
    tested = json.loads((compared.results / "hypotheses.json").read_text())
    statements = " ".join(each["statement"] for each in tested)
    assert "solves every run" in statements
    assert "refining the best" in statements
    assert "of the chapter’s" not in statements
    assert "hopping" not in statements
    assert "refining all" not in statements
    text = (compared.results / "table.md").read_text(encoding="utf-8")
    verdicts = [each["holds"] for each in tested]
    assert f"{verdicts.count(True)} hold, {verdicts.count(None)} are undecided" in text
    rejected = [each for each in tested if each["holds"] is False]
    assert all(each["statement"] in text and each["evidence"] in text for each in rejected)


def test_runs_do_not_depend_on_their_division_into_jobs(folder):
    folder.configure()
    settings = read_settings(folder.path / "fletcher_powell.yaml")

    def records(runs_per_job, block):
        cut = replace(settings, runs_per_job=runs_per_job)
        cases = experiments.cases("table", "hybrid", block, cut)
        return to_json(run_cases("hybrid", "cec2005-f12", cases, settings.seed, lambda _: None))

    whole = records(3, 1)
    for block in (1, 3):
        assert records(1, block) == [record for record in whole if record["run"] == block]


def test_more_runs_keep_those_that_are_there(compared, folder):
    shutil.copytree(compared.path, folder.path, copy_function=shutil.copy2)
    folder.configure(runs_per_job=3, runs=6)
    assert folder.planned("fletcher_powell")["fletcher_powell_run_algorithm"] == 3 + 1


def test_missing_packages_are_named_before_any_job(folder):
    folder.configure(algorithms=["hybrid", "cma-es"])
    run = folder.run("fletcher_powell", missing=PACKAGES)
    assert run.returncode == 1
    last = run.stdout.splitlines()[-1]
    assert last.startswith(
        "fletcher_powell: the Python packages cma and optproblems are not installed; run `"
    )
    assert str(BENCHMARK / "requirements.txt") in last
    assert "Traceback" not in run.stdout
    assert "rule " not in run.stdout
    assert not (folder.path / "results").exists()


def test_a_wrong_setting_is_named(folder):
    folder.configure(dimension=1)
    run = folder.run("fletcher_powell")
    assert run.returncode != 0
    assert "fletcher_powell.yaml, dimension: 1 is below 2; give" in run.stdout
    assert "Traceback" not in run.stdout


def test_a_data_set_cannot_take_its_folder():
    assert not is_valid("fletcher_powell")


def test_changed_code_of_the_product_and_of_the_comparison_reruns(tmp_path):
    """The digest covers the modules of both packages that a script imports."""
    scripts, product = tmp_path / "own", tmp_path / "product"
    shutil.copytree(BENCHMARK / "scripts", scripts)
    shutil.copytree(ROOT / "workflow" / "scripts" / "evopem", product / "evopem")
    before = digest(scripts, product)
    for changed in (
        scripts / "fletcher_powell" / "objective.py",
        product / "evopem" / "estimation" / "search" / "memetic.py",
    ):
        text = changed.read_text(encoding="utf-8")
        changed.write_text(text + "changed = 1\n", encoding="utf-8")
        assert digest(scripts, product) != before
        changed.write_text(text, encoding="utf-8")
    (scripts / "fletcher_powell" / "page.py").write_text("")
    (product / "evopem" / "report" / "page.py").write_text("")
    assert digest(scripts, product) == before


def digest(scripts, product):
    """Digest of the script that runs an algorithm, in a fresh process: files are read once."""
    command = (
        "import sys; from evopem.config.rule_digest import code_version as v;"
        " print(v(sys.argv[1], (), [sys.argv[2]]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", command, str(scripts / "run_algorithm.py"), str(product)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "workflow" / "scripts")},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout


def test_the_product_does_not_import_it_and_does_not_ship_it():
    product = ROOT / "workflow"
    sources = [*product.rglob("*.py"), *product.rglob("*.smk"), *product.rglob("*.j2")]
    named = [path.name for path in sources if "fletcher_powell" in path.read_text("utf-8")]
    # The name of its folder of results is reserved, and its target is offered where it is there.
    assert sorted(named) == ["source_checks.py", "stages.smk"]
    packages = find_packages(str(product / "scripts"))
    assert "evopem.estimation" in packages
    assert not [name for name in packages if "fletcher" in name]


def test_the_page_works_in_a_browser(compared):
    selenium = pytest.importorskip("selenium.webdriver")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("no Chromium here (Debian packages chromium and chromium-driver)")
    options = selenium.ChromeOptions()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with selenium.Chrome(options=options, service=selenium.ChromeService(driver)) as browser:
        for width in (360, 1200):
            browser.execute_cdp_cmd(
                "Emulation.setDeviceMetricsOverride",
                {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
            )
            browser.get((compared.results / "report.html").as_uri())
            assert browser.get_log("browser") == []
            assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert len(browser.find_elements("css selector", "figure svg")) == 5
        assert len(browser.find_elements("css selector", ".tools button")) >= 5
