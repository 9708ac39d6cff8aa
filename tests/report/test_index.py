"""The list of all data sets."""

import math
import re
from dataclasses import replace

from test_pages import HOSTILE, TEMPLATES, Page

from evopem.report import build_index
from evopem.results.fleet import IncompleteDataset
from evopem.validation.checks import Check


def outcomes(*passed):
    return tuple(Check(f"check {place}", each, "") for place, each in enumerate(passed))


def test_the_worst_come_first_and_each_links_its_report(summary):
    entries = {
        "good": replace(summary, checks=outcomes(True, True, True)),
        "a / b?#": replace(summary, checks=outcomes(True, None, True)),
        "failed little": replace(
            summary, checks=outcomes(True, False, True), simulation_error_percent=5.0
        ),
        "failed much": replace(
            summary, checks=outcomes(True, False, True), simulation_error_percent=50.0
        ),
        HOSTILE: replace(
            summary, checks=outcomes(False, False, None), simulation_error_percent=math.nan
        ),
        "gone": IncompleteDataset("failed", "gone.csv: <no> file"),
    }
    html = build_index(entries, TEMPLATES)
    page = Page(html)
    links = [
        reference for reference in page.references if reference.endswith(("report.html", "logs/"))
    ]
    assert links == [
        "gone/logs/",
        "%3Cscript%3Ealert%28%22x%22%29%3C%2Fscript%3E%27%26/report.html",
        "failed%20much/report.html",
        "failed%20little/report.html",
        "a%20%2F%20b%3F%23/report.html",
        "good/report.html",
    ]
    assert "gone.csv: <no> file" in page.text
    assert "0 passed, 2 failed, 1 not judged: check 0; check 1; check 2" in page.text
    assert "2 passed, 1 not judged: check 1" in page.text
    assert "3 passed" in page.text
    assert page.tags.count("script") == html.count("<script") == 1
    assert HOSTILE in page.text
    assert re.findall(r"\b(?:nan|NaN|inf|None)\b", page.text) == []


def test_each_row_has_the_numbers_of_its_data_set(summary):
    page = Page(build_index({"bench": summary}, TEMPLATES, page="model.json"))
    assert f"{summary.prediction_error_percent:.1f}" in page.text
    assert f"{summary.simulation_error_percent:.1f}" in page.text
    assert str(summary.orders) in page.text
    assert "bench/model.json" in page.references
