"""The few lines about a data set agree with its summary."""

from dataclasses import replace

import pytest

from evopem.report.numbers import with_error
from evopem.report.results_text import results_html, results_text, run_text
from evopem.report.verdict import verdict
from evopem.results.fleet import summarize
from evopem.results.identity import IncompleteDataset
from evopem.validation.checks import Check


@pytest.fixture
def summary(identified):
    results = identified.results
    return summarize(results.evidence)


def test_a_data_set_has_its_verdict_its_modes_and_its_failed_checks(identified, summary):
    results = identified.results
    page = "results/bench/report.html"
    text = results_text("bench", verdict(results).sentence, summary, page)
    words = " ".join(text.split())
    assert words.startswith(f"bench: {' '.join(verdict(results).sentence.split())}")
    for mode in results.model.modes:
        assert with_error(mode.frequency_hz, mode.frequency_se_hz) in text
    for check in results.checks:
        for word in ("failed", "caution"):
            assert (f"{word} {check.name}:" in words) == (check.word.lower() == word)
    doubted = len(results.model.modes) - len(results.validation.modes.trusted)
    assert text.count("not to be trusted: see the report") == doubted
    assert str(results.model.orders) in text
    assert text.endswith("report  results/bench/report.html")
    assert max(map(len, text.splitlines())) <= 100


def test_cautions_come_after_failed_checks_and_notes_are_not_listed(summary):
    listed = tuple(
        Check(g.title(), False, "It is.", grade=g) for g in ("note", "caution", "defect")
    )
    judged = replace(summary, checks=listed)
    lines = results_text("a", "Good.", judged).splitlines()
    assert lines[-2:] == ["  failed  Defect: It is.", "  caution Caution: It is."]
    assert "Note: It is." not in "".join(lines)
    html = results_html("a", "Good.", judged)
    assert "<summary>1 failed check, 1 caution</summary>" in html
    assert "Note" not in html


def test_what_a_failed_check_found_is_a_whole_sentence(summary):
    statements = {
        "The input is of order 4; the model needs 22. More follows.": "The input is of order 4.",
        "At the upper end: nf = 5; nf from 1 to 5 was tried": "At the upper end: nf = 5.",
        "Poles at 0.5 and 0.6. They are close.": "Poles at 0.5 and 0.6.",
    }
    listed = tuple(Check("Name", False, statement) for statement in statements)
    shown = results_text("a", "Good.", replace(summary, checks=listed)).splitlines()
    found = [line.removeprefix("  failed  Name: ") for line in shown if "failed" in line]
    assert found == list(statements.values())


def test_many_data_sets_have_a_line_each(summary):
    entries = {f"set{number}": summary for number in range(45)}
    entries["set1"] = IncompleteDataset("failed", "set1.csv: the file is empty; export it again.")
    lines = run_text(entries, "report.html", ["results/index.html"]).splitlines()
    assert lines[1] == "set1: failed. set1.csv: the file is empty; export it again."
    assert lines[40] == "… and 5 more"
    assert lines[-1] == "All data sets: results/index.html"
    assert len(lines) == 43
