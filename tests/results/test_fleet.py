"""The lists of all data sets: complete, failed and unfinished ones, and files that were changed."""

import csv
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import finish

from evopem.errors import InputError
from evopem.files.atomic import write_parquet, write_table
from evopem.files.job import job
from evopem.files.json_form import load, save
from evopem.pipeline.report import collect_fleet, collect_unfinished
from evopem.results.fleet import (
    DatasetSummary,
    fleet_table,
    read_entry,
    without_formulas,
)
from evopem.results.identity import IncompleteDataset
from evopem.results.layout import OVERVIEW, DatasetFiles
from evopem.terminal.command import main
from evopem.validation.checks import Check

SENTENCE = "x.csv, line 51: is not a number; correct it."


@pytest.fixture(scope="module")
def summary(identified):
    """The summary of an identified data set."""
    return load(DatasetSummary, identified.files.summary)


@pytest.fixture
def files(identified, summary, tmp_path, monkeypatch):
    """The files of a complete data set "a" below the working directory."""
    monkeypatch.chdir(tmp_path)
    files = DatasetFiles.of_dataset("a")
    shutil.copytree(identified.files.folder, files.folder)
    finish(files)
    return files


def required(*datasets):
    return {files.name: [files.model, files.validation] for files in datasets}


def unfinished(*datasets, pending=()):
    """List data sets as after a run that failed; the rows of the table by name."""
    collect_unfinished(required(*datasets), "report.html", pending)
    return rows()


def rows():
    with Path(OVERVIEW[1]).open(encoding="utf-8") as stream:
        return {row["dataset"]: row for row in csv.DictReader(stream)}


def fail(log, *outputs):
    """Run a job that fails as those of Snakemake do: its outputs are gone."""
    for output in outputs:
        Path(output).unlink(missing_ok=True)
    with pytest.raises(SystemExit), job(log, outputs=outputs):
        raise InputError("x.csv", "is not a number", "correct it", "line 51")


def test_a_summary_holds_the_results(identified, summary):
    results = identified.results
    assert summary.orders == results.model.orders
    assert summary.modes == tuple(results.model.modes)
    assert summary.bic == results.model.bic
    assert summary.estimation_samples == results.prepared.estimation.samples
    assert summary.simulation_error_percent == results.validation.simulation_error_percent
    assert list(summary.checks) == results.checks
    assert sum(summary.n_checks(passed) for passed in (True, False, None)) == len(results.checks)
    assert len(summary.trusted) == len(summary.modes)
    assert sum(summary.trusted) == len(results.validation.modes.trusted) > 0
    model = results.model.model
    peak = np.abs(model.frequency_response(np.linspace(0, 50, 20001)[1:])).max()
    assert max(summary.gain_db) == pytest.approx(20 * np.log10(peak), abs=0.2)


def test_complete_data_sets_have_a_row_for_each_mode(summary):
    still = replace(summary, modes=())
    table = fleet_table({"a": summary, "no modes": still})
    count = table.groupby("dataset", sort=False).size().to_dict()
    assert count == {"a": len(summary.modes), "no modes": 1}
    own = table[table["dataset"] == "a"]
    assert own["frequency_hz"].tolist() == [mode.frequency_hz for mode in summary.modes]
    assert own["damping_percent"].tolist() == [100 * mode.damping_ratio for mode in summary.modes]
    assert own["mode"].tolist() == list(range(1, len(summary.modes) + 1))
    assert own["na"].unique().tolist() == [summary.orders.na]
    # The range of the delay, which the configuration gave, ends at the delay: no defect.
    assert (own["check_orders_inside_their_search_ranges"] == False).all()  # noqa: E712
    assert own["failed_checks"].tolist() == [0] * len(summary.modes)
    bad = Check("Stable", False, "It is not.", "Do not simulate with it.")
    worse = replace(summary, checks=(*summary.checks, bad))
    assert fleet_table({"a": worse})["failed_checks"].unique().tolist() == [1]
    assert table["status"].unique().tolist() == ["complete"]


def test_csv_and_parquet_hold_the_same(summary, tmp_path):
    table = fleet_table({"a": summary, "b": IncompleteDataset("failed", SENTENCE)})
    write_parquet(tmp_path / "fleet.parquet", table)
    write_table(tmp_path / "fleet.csv", without_formulas(table))
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "fleet.parquet"), table)
    from_csv = pd.read_csv(tmp_path / "fleet.csv", dtype=table.dtypes.to_dict())
    pd.testing.assert_frame_equal(from_csv, table)


@pytest.mark.parametrize(
    "text", ["=cmd|' C calc'!A0.csv", "+1", "-1+2", "@SUM(1)", "\tx", "\rx", "＝1"]
)
def test_text_is_no_formula_in_a_spreadsheet(summary, text):
    summary = replace(summary, file=text, bic=-12.5, modes=summary.modes[:1])
    table = fleet_table({"a": summary, "b": IncompleteDataset("failed", text)})
    safe = without_formulas(table)
    assert safe["file"].iloc[0] == safe["problem"].iloc[1] == f"'{text}"
    assert safe["bic"].iloc[0] == -12.5
    unchanged = ["dataset", "status", *table.columns[table.dtypes != "string"]]
    pd.testing.assert_frame_equal(safe[unchanged], table[unchanged])


def test_complete_data_sets_are_listed(files, summary):
    collect_fleet(DatasetFiles("results"), ("a",), "report.html")
    assert rows()["a"]["status"] == "complete"
    html = Path(OVERVIEW[0]).read_text()
    assert '<a href="a/report.html">a</a></th>' in html
    assert f"<td>{summary.orders}</td>" in html
    assert f"{summary.n_checks(passed=True)} passed" in html
    assert unfinished(files)["a"] == rows()["a"]


@pytest.mark.parametrize("another_failed", [False, True])
def test_a_changed_result_is_listed_alike_whatever_became_of_others(files, another_failed):
    simulation = Path(files.simulation)
    simulation.write_text(simulation.read_text()[:300])
    if another_failed:
        listed = unfinished(files)
    else:
        collect_fleet(DatasetFiles("results"), ("a",), "report.html")
        listed = rows()
    assert listed["a"]["status"] == "failed"
    assert listed["a"]["problem"] == (
        f"{simulation}: was changed or damaged after it was written; delete it and run snakemake"
        " again."
    )


def test_a_data_set_that_was_complete_and_fails_is_not_listed_as_complete(files):
    """The files of its old results are still there, all but the outputs of the job that failed."""
    fail(files.log("model"), files.model)
    Path(files.log("model")).write_text("all that the job said")
    row = unfinished(files)["a"]
    assert (row["status"], row["problem"], row["na"]) == ("failed", SENTENCE, "")
    html = Path(OVERVIEW[0]).read_text()
    assert SENTENCE in html
    assert 'href="a/logs/model.log"' in html
    assert 'href="a/report.html"' not in html


def test_a_failed_part_of_a_phase_is_known_by_the_jobs_that_are_left(files):
    """The parts are no results: all required files exist."""
    fail(files.log("phases/delay/part-1"), files.part("delay", 1))
    assert unfinished(files, pending=["a"])["a"]["problem"] == SENTENCE


def test_a_first_run_that_fails_says_why(tmp_path, monkeypatch):
    """Also where other jobs of the data set succeeded, before and after it."""
    monkeypatch.chdir(tmp_path)
    bad, never = DatasetFiles.of_dataset("bad"), DatasetFiles.of_dataset("never")
    with job(bad.log("config"), outputs=[bad.config]):
        Path(bad.config).write_text("{}")
    fail(bad.log("recording"), bad.recording, bad.recording_info)
    with job(bad.log("spectrum")):
        pass
    listed = unfinished(bad, never, pending=["bad", "never"])
    assert (listed["bad"]["status"], listed["bad"]["problem"]) == ("failed", SENTENCE)
    assert listed["never"]["status"] == "unfinished"
    assert "results/never/model.json has not been made" in listed["never"]["problem"]


def test_a_data_set_that_the_run_did_not_reach_is_not_complete(files):
    """Its results are of other settings, or the run would have left no job of it."""
    row = unfinished(files, pending=["a"])["a"]
    assert row["status"] == "unfinished"
    assert "not all of its jobs have run" in row["problem"]


@pytest.mark.parametrize("how", ["cut off", "edited"])
def test_a_changed_summary_is_reported(files, how):
    path = Path(files.summary)
    text = path.read_text()
    path.write_text(text[:100] if how == "cut off" else text.replace('"bic": ', '"bic": 1'))
    row = unfinished(files)["a"]
    assert row["status"] == "failed"
    assert row["problem"].startswith(
        f"{files.summary}: was changed or damaged after it was written"
    )


def test_what_cannot_be_read_at_all_is_a_problem_of_one_data_set(files):
    """An error that nobody foresaw: a folder where a file should be."""
    other = DatasetFiles.of_dataset("b")
    shutil.copytree(files.folder, other.folder)
    Path(other.summary).unlink()
    Path(other.summary).mkdir()
    listed = unfinished(files, other)
    assert listed["a"]["status"] == "complete"
    assert listed["b"]["status"] == "failed"
    assert "results/b" in listed["b"]["problem"]


def test_no_outdated_list_remains_where_a_new_one_cannot_be_written(files, capsys, monkeypatch):
    unfinished(files)
    monkeypatch.setattr("evopem.pipeline.report.build_index", lambda *_, **__: 1 / 0)
    fail(files.log("model"), files.model)
    assert unfinished(files)["a"]["problem"] == SENTENCE
    assert not Path(OVERVIEW[0]).exists()
    message = capsys.readouterr().err.splitlines()[-1]
    assert message == "results/index.html: the list was not written (division by zero)."


def test_an_entry_is_complete_again_when_the_job_succeeds(files):
    model = Path(files.model).read_text()
    fail(files.log("model"), files.model)
    with job(files.log("model"), outputs=[files.model]):
        Path(files.model).write_text(model)
    assert isinstance(read_entry(files, [files.model]), DatasetSummary)


def test_the_form_of_a_summary_is_exact(summary, tmp_path):
    save(summary, tmp_path / "summary.json")
    assert repr(load(DatasetSummary, tmp_path / "summary.json")) == repr(summary)


def test_the_data_sets_of_several_folders_are_listed_together(files, tmp_path):
    for folder in ("monday/results", "tuesday/results"):
        shutil.copytree(files.folder, tmp_path / folder / "a")
    shutil.copytree(files.folder, tmp_path / "tuesday" / "results" / "b")
    (tmp_path / "monday" / "results" / "a" / "modes.csv").write_text("changed")
    assert main(["merge", "monday/results", "tuesday/results", "tuesday"]) == 0
    listed = pd.read_parquet("merged/fleet.parquet").groupby("dataset")["status"].first()
    assert listed.to_dict() == {
        "a (monday)": "failed",
        "a (tuesday)": "complete",
        "b": "complete",
    }
    page = Path("merged/index.html").read_text()
    assert re.findall(r'href="([^"]*report.html)">([^<]*)</a></th>', page) == [
        ("../tuesday/results/a/report.html", "a (tuesday)"),
        ("../tuesday/results/b/report.html", "b"),
    ]
    assert re.findall(r'<tr data-group="(\w*)"', page) == ["monday", "tuesday", "tuesday"]
    assert main(["merge", "monday"]) == 0  # its own lists are replaced


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["gone"], "gone: is not a folder; give folders of results, such as results."),
        (["empty"], "empty: holds no results of data sets; give folders"),
        (["results", "--to", "results"], "results: holds results; choose another folder"),
        (["results", "--to", "mine"], "mine: is no folder of such lists; choose another"),
    ],
)
def test_what_cannot_be_merged_is_said_in_a_sentence(files, tmp_path, capsys, arguments, sentence):
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "index.html").write_text("my own page")
    assert main(["merge", *arguments]) == 1
    assert capsys.readouterr().err.startswith(sentence)
    assert not Path("merged").exists()
    assert (tmp_path / "mine" / "index.html").read_text() == "my own page"
