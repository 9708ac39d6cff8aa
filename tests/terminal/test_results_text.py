"""The few lines about a data set agree with its summary."""

from dataclasses import replace

import pytest

from evopem.report.numbers import with_error
from evopem.results.fleet import IncompleteDataset, summarize
from evopem.terminal.results_text import results_text, run_text, verdict


@pytest.fixture
def summary(identified):
    results = identified.results
    return summarize(
        results.model,
        results.validation,
        results.spectrum_summary,
        results.phases,
        results.recording_info,
    )


def with_outcome(summary, *outcomes):
    """The summary with these outcomes for its first checks, and all others passed."""
    padded = [*outcomes, *[True] * (len(summary.checks) - len(outcomes))]
    checks = [replace(one, passed=each) for one, each in zip(summary.checks, padded, strict=True)]
    return replace(summary, checks=tuple(checks))


def test_the_verdict_names_what_failed_and_what_is_open(summary):
    first, second = (f"“{check.name}”" for check in summary.checks[:2])
    assert verdict(with_outcome(summary)).startswith("the model passes all")
    failed = verdict(with_outcome(summary, False, None))
    assert failed.startswith(f"the model fails {first};")
    assert second not in failed
    assert verdict(with_outcome(summary, None)) == (
        f"the model fails no check, but {first} could not be judged."
    )


def test_a_data_set_has_its_modes_its_errors_and_its_report(summary):
    text = results_text("bench", summary, "results/bench/report.html")
    for mode in summary.modes:
        assert with_error(mode.frequency_hz, mode.frequency_se_hz) in text
    assert str(summary.orders) in text
    assert text.endswith("report  results/bench/report.html")
    assert max(map(len, text.splitlines())) <= 100


def test_many_data_sets_have_a_line_each(summary):
    entries = {f"set{number}": summary for number in range(45)}
    entries["set1"] = IncompleteDataset("failed", "set1.csv: the file is empty; export it again.")
    lines = run_text(entries, "report.html", ["results/index.html"]).splitlines()
    assert lines[1] == "set1: failed. set1.csv: the file is empty; export it again."
    assert lines[40] == "… and 5 more"
    assert lines[-1] == "All data sets: results/index.html"
    assert len(lines) == 43
