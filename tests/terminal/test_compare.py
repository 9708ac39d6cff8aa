"""`evopem compare`: folders of results in, one page out."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import finished_copy

import evopem
from evopem.files.checksums import GENERATOR, write_checksums, write_page
from evopem.pipeline.report import merge_setups
from evopem.results.layout import DatasetFiles
from evopem.terminal.command import main

PAGE = f"<!DOCTYPE html>{GENERATOR}"


@pytest.fixture
def folders(identified, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        finished_copy(tmp_path / "results" / name, identified)
    (tmp_path / "results" / "a" / "report.html").touch()
    return tmp_path


def test_the_page_has_errors_overlays_modes_and_checks(folders, capsys):
    assert main(["compare", "results/a", "results/b/", "--page", "pages.html"]) == 0
    printed = capsys.readouterr().out
    assert "All models were validated on the same samples." in printed
    assert printed.endswith("  page  pages.html\n")
    page = (folders / "pages.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 3
    assert re.findall('data-name="([A-Z][^"]*)"', page) == [
        *("Errors and verdicts", "Measured and simulated", "Frequency responses", "Modes"),
        *("Modes matched", "Checks"),
    ]
    assert 'href="results/a/report.html"' in page
    assert "results/b/report.html" not in page
    assert "src=" not in re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)


def test_the_job_of_set_ups_writes_the_page_and_a_table_of_shapes(folders, identified):
    merge_setups(DatasetFiles("results"), ("a", "b"), "beam")
    table = pd.read_csv(folders / "results" / "setups" / "beam.csv")
    assert table["mode"].tolist() == [1, 2, 3]
    np.testing.assert_allclose(
        table["frequency_se_hz"],
        [mode.frequency_se_hz / 2**0.5 for mode in identified.results.model.plant.modes()],
    )
    page = (folders / "results" / "setups" / "beam.html").read_text(encoding="utf-8")
    assert 'href="../a/report.html"' in page


def test_set_ups_of_one_structure_are_merged_on_the_page(folders, capsys):
    assert main(["compare", "results/a", "results/b", "--setups", "--page", "pages.html"]) == 0
    printed = capsys.readouterr().out
    assert "2 set-ups and 1 output; input and output in all set-ups. No set-up" in printed
    page = (folders / "pages.html").read_text(encoding="utf-8")
    assert "<h1>2 set-ups of one structure</h1>" in page
    assert re.findall('data-name="([A-Z][^"]*)"', page)[:4] == [
        *("Merged modes", "Set-ups", "Shapes and drives", "Errors and verdicts"),
    ]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["results/a"], "compare: the number of models is 1; give 2 to 6 of them."),
        (["results/a", "results/c"], "results/c: holds no results of a data set;"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_sentence(folders, capsys, arguments, sentence):
    assert main(["compare", *arguments]) == 1
    assert capsys.readouterr().err.startswith(sentence)
    assert not (folders / "comparison.html").exists()


@pytest.mark.parametrize("held", ["model.json", "text", "folder", "device"])
def test_only_a_page_of_evopem_is_replaced(folders, held, capsys, monkeypatch):
    monkeypatch.setattr("evopem.pipeline.report.read_whole_results", None)  # refused before work
    target = folders / "taken"
    if held == "folder":
        target.mkdir()
    elif held == "device":
        target.symlink_to("/dev/null")
    else:
        target.write_text("<!DOCTYPE html>" if held == "text" else '{"a": 1}')
    before = target.read_text() if target.is_file() else None
    assert main(["compare", "results/a", "results/b", "--page", "taken"]) == 1
    assert "not replaced" in capsys.readouterr().err
    assert target.is_symlink() or before is None or target.read_text() == before


def test_a_report_among_the_results_is_not_replaced(folders, capsys):
    """It is a page of evopem, and the results would no longer be as their run wrote them."""
    report = DatasetFiles("results/a").report
    write_page(report, PAGE)
    write_checksums([report], "results/a", "report")
    assert main(["compare", "results/a", "results/b", "--page", report]) == 1
    assert "is a result and is not replaced" in capsys.readouterr().err
    evopem.read_results("results/a")


def test_a_page_is_replaced(folders):
    write_page("comparison.html", PAGE)
    assert main(["compare", "results/a", "results/b"]) == 0
    assert len(Path("comparison.html").read_text()) > 2 * len(PAGE)
