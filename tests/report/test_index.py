"""The list of all data sets."""

import math
import re
from dataclasses import replace

import pytest
from test_pages import HOSTILE, Page

from evopem.report.index_page import build_index
from evopem.report.numbers import to_its_error
from evopem.results.followed_modes import group_of
from evopem.results.identity import IncompleteDataset
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
        "gone": IncompleteDataset("failed", "gone.csv: <no> file", "logs/recording.log"),
        "never": IncompleteDataset("unfinished", "not all of its jobs have run"),
    }
    html = build_index(entries)
    page = Page(html)
    links = [
        reference for reference in page.references if reference.endswith(("report.html", ".log"))
    ]
    assert links == [
        "gone/logs/recording.log",
        "gone/logs/recording.log",
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
    page = Page(build_index({"bench": summary}, page="model.json"))
    assert f"{summary.prediction_error_percent:.1f}" in page.text
    assert f"{summary.simulation_error_percent:.1f}" in page.text
    assert str(summary.orders) in page.text
    assert "bench/model.json" in page.references


def test_each_row_has_its_modes_and_gain(summary):
    html = build_index({"bench": summary})
    for mode, trusted in zip(summary.modes, summary.trusted, strict=True):
        shown = to_its_error(mode.frequency_hz, mode.frequency_se_hz)
        assert (f"<strong>{shown}</strong>" in html) == trusted
        assert shown in html
    assert html.count("<svg") == 1
    assert html.count('class="mark"') == sum(summary.trusted)
    top = max(summary.gain_db)
    assert f"Gain from 0 to 50 Hz, from {top:.0f} down to" in html.replace("−", "-")


def test_a_mode_has_the_digits_that_its_standard_error_leaves(summary):
    """Three digits said 37.0 Hz of 36.9874 ± 0.0002 Hz, so that changes were not seen."""
    mode = replace(summary.modes[0], frequency_hz=36.98741, frequency_se_hz=0.0002)
    html = build_index({"bench": replace(summary, modes=(mode,), trusted=(True,))})
    assert "<strong>36.9874</strong>" in html


def test_no_link_has_another_name_for_screen_readers_than_its_text(summary):
    gone = IncompleteDataset("failed", "gone.csv: no file", "logs/recording.log")
    html = build_index({"bench": summary, "gone": gone})
    assert re.findall(r"<a [^>]*aria-label", html) == []
    assert "Log" in html


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("bench-12", "bench"),
        ("bench12", "bench"),
        ("gearbox_left_3", "gearbox"),
        ("2024-05-run", "2024"),
        ("7", "7"),
        ("-x", "-x"),
    ],
)
def test_names_that_begin_alike_form_a_group(name, group):
    assert group_of(name) == group


def test_groups_are_shown_where_they_divide_the_data_sets(summary):
    def grouped(*names):
        page = Page(build_index(dict.fromkeys(names, summary)))
        return "Data set Group" in page.text

    assert grouped("arm-1", "arm-2", "bench-1")
    assert not grouped("arm-1", "arm-2")
    assert not grouped("arm", "bench")


def test_recordings_of_several_folders_are_grouped_by_them(summary):
    files = {"a-1": "north/a.csv", "b-1": "north/b.csv", "a-2": "south/a.csv"}
    entries = {name: replace(summary, file=file) for name, file in files.items()}
    html = build_index(entries)
    assert sorted(re.findall(r'<tr data-group="(\w*)"', html)) == ["north", "north", "south"]


def test_the_pages_of_merged_set_ups_are_linked(summary):
    page = Page(build_index({"a": summary}, setups=("beam", "frame 2")))
    assert {"setups/beam.html", "setups/frame%202.html"} <= set(page.references)
    assert "Merged set-ups: beam, frame 2" in page.text


def test_a_gain_that_is_zero_or_unknown_is_drawn_or_left_out(summary):
    flat = replace(summary, gain_db=(-math.inf, 3.0, 3.0))
    assert build_index({"a": flat}).count("<svg") == 1
    unknown = replace(summary, gain_db=(math.nan, math.nan))
    assert build_index({"a": unknown}).count("<svg") == 0
