"""The comparison on the Fletcher-Powell function, in a small setting, as a user runs it."""

import csv
import json
import shutil

import pytest
import yaml

from evopem.fletcher_powell import experiments

from .conftest import ROOT, Folder

SMALL = {
    "algorithms": ["hybrid", "hybrid-best", "ga", "multi-start"],
    "dimension": 4,
    "evaluations": 3000,
    "instances": 1,
    "runs": 3,
    "slow_runs": 1,
    "scale": {"dimensions": [2, 3], "runs": 2},
}
DATASETS = {"arm": {"synthesis": "flexible_arm"}}


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    pytest.importorskip("optproblems")
    folder = Folder(tmp_path_factory.mktemp("comparison"))
    folder.configure({"datasets": DATASETS, "fletcher_powell": SMALL})
    folder.finish("--cores", "1", "fletcher_powell")
    return folder


def table(folder, name="table.csv"):
    with (folder.results / "fletcher_powell" / name).open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_it_makes_its_tables_figures_and_page_and_nothing_else(compared):
    results = compared.results / "fletcher_powell"
    for name in ("report.html", "table.csv", "table.md", "runs.csv", "convergence.csv"):
        assert (results / name).stat().st_size > 0, name
    for figure in experiments.FIGURES:
        assert "<svg" in (results / "figures" / f"{figure}.svg").read_text()
    assert [path.name for path in compared.results.iterdir()] == ["fletcher_powell"]
    assert compared.planned("fletcher_powell") == {}
    assert "run_fletcher_powell" not in compared.planned()


def test_the_table_counts_what_the_runs_say(compared):
    rows = {(row["study"], row["dimension"], row["algorithm"]): row for row in table(compared)}
    runs = table(compared, "runs.csv")
    assert len(runs) == 4 * 3 + 3 * 3 + 2 * 2 * 2 + 2
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
    # The chapter's numbers are for n = 20 and stand beside nothing else.
    assert {row["chapter_mean"] for row in rows.values()} == {""}


def test_no_claim_is_made_without_its_runs(compared):
    claims = json.loads((compared.results / "fletcher_powell" / "claims.json").read_text())
    statements = " ".join(claim["statement"] for claim in claims)
    assert "solves every run" in statements
    assert "the best" in statements
    assert "chapter’s mean" not in statements
    assert "hopping" not in statements
    assert "everyone" not in statements


def test_runs_do_not_depend_on_how_they_are_cut_into_jobs(compared, tmp_path):
    folder = Folder(tmp_path)
    folder.configure({"datasets": DATASETS, "fletcher_powell": SMALL | {"runs_per_job": 1}})
    blocks = [f"results/fletcher_powell/runs/table/hybrid/cec2005-f12/{b}.json" for b in (1, 3)]
    folder.finish("--cores", "1", *blocks)
    whole = json.loads((compared.path / blocks[0]).read_text())
    for number, block in zip((1, 3), blocks, strict=True):
        cut = json.loads((folder.path / block).read_text())
        assert cut == [record for record in whole if record["run"] == number]


def test_more_runs_keep_those_that_are_there(compared, tmp_path):
    copy = Folder(tmp_path / "copy")
    shutil.copytree(compared.path, copy.path, copy_function=shutil.copy2)
    copy.configure(
        {"datasets": DATASETS, "fletcher_powell": SMALL | {"runs_per_job": 3, "runs": 6}}
    )
    planned = copy.planned("fletcher_powell")
    assert planned["run_fletcher_powell"] == 4


def test_the_page_stands_by_itself_in_a_browser(compared):
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
            browser.get((compared.results / "fletcher_powell" / "report.html").as_uri())
            assert browser.get_log("browser") == []
            assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert len(browser.find_elements("css selector", "figure svg")) == 5
        assert len(browser.find_elements("css selector", ".tools button")) >= 5


def test_a_data_set_cannot_take_its_folder(folder):
    folder.configure({"datasets": {"fletcher_powell": {"synthesis": "armax"}}})
    run = folder.run("--dry-run")
    assert run.returncode != 0
    assert "fletcher_powell is the name of something else" in run.stdout


def test_the_schema_and_the_plan_name_the_algorithms_there_are():
    from evopem.figures.fletcher_powell import COMPARISON_FIGURES
    from evopem.fletcher_powell.algorithms import ALGORITHMS

    schema = yaml.safe_load((ROOT / "workflow" / "schemas" / "config.schema.yaml").read_text())
    known = schema["$defs"]["fletcher_powell"]["properties"]["algorithms"]
    assert known["items"]["enum"] == known["default"] == list(ALGORITHMS)
    assert set(ALGORITHMS) == {
        *experiments.IN_TABLE,
        *experiments.IN_SCALE,
        *experiments.AT_LARGEST,
    }
    assert tuple(entry.name for entry in COMPARISON_FIGURES) == experiments.FIGURES
