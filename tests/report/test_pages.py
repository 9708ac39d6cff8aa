"""The report: complete, escaped, self-contained, and true to the results."""

import base64
import hashlib
import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from browsing import NAMED, TEMPLATES, renamed_channels
from identified import with_outcome, with_output_name, without_covariance

from evopem.config.channels import RecordedSource
from evopem.config.structures import phases_of
from evopem.report.numbers import number, with_error
from evopem.report.page import read_wall_clock
from evopem.report.templates import environment
from evopem.results.layout import FIGURES
from evopem.signals.recording_info import FileOrigin
from evopem.validation.checks import CHECKS, Check

PHASES = phases_of("armax")
MEANINGS = environment(TEMPLATES).get_template("parts.html.j2").module.MEANINGS

HIDDEN = ("style", "script")
HOSTILE = """<script>alert("x")</script>'&"""


class Page(HTMLParser):
    """Tags, ids and text of a page."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.ids, self.references, self.words = [], [], [], []
        self.shown = True
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append(tag)
        self.shown = self.shown and tag not in HIDDEN
        if "id" in attributes:
            self.ids.append(attributes["id"])
        self.references += [
            attributes[key] for key in ("href", "src", "xlink:href") if key in attributes
        ]

    handle_startendtag = handle_starttag

    def handle_endtag(self, tag):
        self.shown = self.shown or tag in HIDDEN

    def handle_data(self, data):
        if self.shown:
            self.words.append(data)

    @property
    def text(self):
        """What is shown, with single spaces and none before a comma."""
        return " ".join(" ".join(self.words).split()).replace(" ,", ",")


@pytest.fixture(scope="session")
def page(html):
    return Page(html)


@pytest.fixture(scope="session")
def stand_in(results):
    """The results as those of the data set that stands in for the chapter's recording."""
    source = replace(results.settings.source, synthesis="flexible_arm")
    return replace(results, settings=replace(results.settings, source=source))


def test_every_figure_is_in_the_page(page):
    assert page.tags.count("svg") == len(FIGURES)
    assert set(FIGURES) <= set(page.ids)


def test_ids_are_unique_and_every_reference_has_its_target(html, page):
    assert len(page.ids) == len(set(page.ids))
    inner = [reference[1:] for reference in page.references if reference.startswith("#")]
    inner += re.findall(r"url\(#([^)]+)\)", html)
    assert inner
    assert set(inner) <= set(page.ids)


def test_nothing_is_loaded_from_elsewhere(html, page):
    assert not {"img", "iframe", "object", "embed"} & set(page.tags)
    assert "@import" not in html
    outside = [r for r in page.references if re.match(r"[a-z]+:|//", r)]
    assert [r for r in outside if not r.startswith("data:")] == []
    assert "default-src 'none'" in html


def test_the_scripts_are_the_project_s_and_uplot_with_its_licence_allowed_by_digest(html, page):
    own = (TEMPLATES / "page.js").read_text()
    uplot = TEMPLATES / "uplot"
    licence = (uplot / "LICENSE").read_text()
    library = (uplot / "uPlot.iife.min.js").read_text()
    first, second = re.findall(r"<script[^>]*>(.*?)</script>", html, re.DOTALL)
    assert first == own
    assert second.startswith(f"/*\n{licence}")
    assert "Permission is hereby granted" in licence
    assert library in second
    drawn = [(TEMPLATES / name).read_text() for name in ("panels.js", "figures.js")]
    assert second.endswith("\n".join(drawn))
    for script in (first, second):
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in html
        assert "</script" not in script
    assert page.tags.count("script") == 2


def test_no_link_has_another_name_for_screen_readers_than_its_text(html):
    assert re.findall(r"<a [^>]*aria-label", html) == []


def tables_in(page):
    """The tables in the page's links, in their order."""
    links = [r for r in page.references if r.startswith("data:text/csv")]
    return [pd.read_csv(io.StringIO(unquote(link.partition(",")[2]))) for link in links]


def test_every_figure_offers_its_numbers_inside_the_page(results, page):
    tables = dict(zip(FIGURES, tables_in(page), strict=True))
    density = results.spectrum["density"].iloc[1:]  # above 0 Hz
    np.testing.assert_allclose(tables["spectrum"]["density"], density, rtol=1e-5)
    simulation = results.validation_tables.simulation
    for name in ("output", "predicted", "simulated", "simulation_error"):
        found = tables["simulation"][f"{name}_output"]
        np.testing.assert_allclose(found, simulation[f"{name}_output"], rtol=1e-4, atol=1e-6)
    roots = tables["poles_zeros"]
    poles = roots[roots["kind"] == "pole"]
    model = results.model.model
    np.testing.assert_allclose(np.poly(poles["real"] + 1j * poles["imag"]), model.A, atol=1e-4)
    assert len(poles) == model.orders.na
    assert (poles["variance_real"] > 0).all()
    assert set(tables["record"]["stage"]) == {"recorded", "estimation", "validation"}
    assert set(tables["frequency_response"]["source"]) == {"model", "noise filter", "measured"}
    assert len(tables["delay"]) + len(tables["phases"]) == len(results.candidates)
    assert len(tables["stabilization"]) == len(results.validation.modes.poles)
    history = results.phases["nb"].selected.diagnostics.convergence
    assert tables["convergence"]["evaluations"].tolist() == [spent for spent, _ in history]


def test_the_summary_is_true_to_the_results(results, page):
    validation = results.validation
    assert str(results.model.orders) in page.text
    assert f"{validation.prediction_error_percent:.1f} %" in page.text
    assert f"{validation.simulation_error_percent:.1f} %" in page.text
    assert page.text.index("Good for") < page.text.index("White residuals")
    for mode in results.model.modes:
        shown = with_error(mode.frequency_hz, mode.frequency_se_hz)
        assert f"{shown} {with_error(100 * mode.damping_ratio, 100 * mode.damping_se)}" in page.text
    assert "number of B coefficients" in page.text
    recorded = validation.outputs[0].recorded
    assert f"In recorded units {number(recorded.prediction_error_percent, 4)}" in page.text
    passed = [check.name for check in results.checks if check.passed]
    assert f"{len(passed)} checks passed Passed {passed[0]}." in page.text


def test_truth_and_chapter_are_beside_the_estimate(build, stand_in):
    text = Page(build(stand_in)).text
    for words in ("Truth", "Chapter", "37.00", "17.50", "The true delay is 3 samples"):
        assert words in text
    assert "Model ARMAX(7,6,6,3) ARMAX(7,6,7,3)" in text
    assert text.count("Frontiers in Evolutionary Robotics") == 1
    assert "Plant order 7 7" in text


def test_a_recorded_data_set_has_neither_truth_nor_chapter(build, results):
    origin = FileOrigin("data/bench.csv", "ab" * 32, 123456, "text", ("torque",), (2,), 1000)
    recorded = replace(
        results,
        truth=None,
        recording_info=replace(results.recording_info, files=(origin,)),
        settings=replace(
            results.settings, source=RecordedSource(("data/bench.csv",), results.settings.source)
        ),
    )
    text = Page(build(recorded)).text
    assert "Truth" not in text
    assert "chapter" not in text.lower().replace("recipe: chapter", "")  # of the configuration
    assert f"File data/bench.csv SHA-256 {'ab' * 32} Size 123 456 bytes" in text
    assert "Input channel torque Output channel 2" in text


def test_the_configuration_and_the_command_are_complete(page, config_text):
    assert len(config_text.splitlines()) > 10
    for line in config_text.splitlines():
        assert " ".join(line.split()) in page.text
    assert "snakemake --snakefile" in page.text


def test_every_check_is_in_the_page(results, page):
    """Verdict, name, statement and advice of each, the failed ones first."""
    checks = results.checks
    assert len({check.name for check in checks}) == len(checks) >= 15
    assert [check.name for check in checks if check.passed is False] != []
    for check in checks:
        meaning = MEANINGS[check.name] if check.passed is False else ""
        words = [f"{check.word} {check.name}.", meaning or check.statement]
        if meaning or check.advice:
            found = check.statement if meaning else ""
            words += [f"What to do : {check.name}", found, check.advice]
        shown = " ".join(" ".join(words).split())
        assert shown in page.text, check.name
    places = [page.text.index(f"{check.word} {check.name}.") for check in checks]
    last_failed = max(p for p, c in zip(places, checks, strict=True) if c.passed is False)
    first_passed = min(p for p, c in zip(places, checks, strict=True) if c.passed)
    assert last_failed < first_passed


def test_every_check_has_a_meaning_in_plain_words():
    assert MEANINGS.keys() == {judge.name for judge in CHECKS}
    for meaning in MEANINGS.values():
        assert meaning.endswith(".")
        assert len(meaning.split()) <= 15


def test_an_order_at_the_end_of_a_given_range_is_no_failed_check(results, page):
    assert results.model.orders.single.nk == 3
    assert results.settings.order_grid.ranges.nk == (2, 3)
    assert "Note Orders inside their search ranges." in page.text
    assert "Failed Orders" not in page.text


@pytest.fixture(scope="session")
def unknown(results):
    """Results in which errors, a test and all standard errors are not known."""
    table = results.validation.modes
    modes = tuple(
        replace(mode, frequency_se_hz=error, damping_se=error)
        for mode, error in zip(
            results.model.modes, (math.inf, *[math.nan] * len(table.modes[1:])), strict=True
        )
    )
    judged = tuple(replace(each, mode=mode) for each, mode in zip(table.modes, modes, strict=True))
    unknown = with_outcome(
        results,
        simulation_error_percent=math.nan,
        outputs={"ljung_box": replace(results.validation.outputs[0].ljung_box, p_value=math.nan)},
        modes=replace(table, modes=judged),
    )
    return replace(unknown, model=replace(without_covariance(results.model), modes=modes))


def test_what_is_not_known_is_said(build, unknown, draw):
    text = Page(build(unknown, draw(unknown, "poles_zeros", "gain"))).text
    assert "Not judged White residuals." in text
    assert "simulation of the transformed output : the error is not known" in text
    assert "The Ljung-Box test was not possible." in text
    assert "no ellipse is drawn" in text
    for mode in unknown.model.modes:
        assert f"{mode.frequency_hz:.4g} ± not known" in text
    # Two for each mode and one for each coefficient.
    expected = 2 * len(unknown.model.modes) + unknown.model.orders.parameters
    assert text.count("not known") >= expected
    assert re.findall(r"\b(?:nan|NaN|inf|None)\b", text) == []


def test_wall_clock_commit_and_validation_file_are_in_the_provenance(build, results):
    origin = FileOrigin("data/fresh.csv", "cd" * 32, 99, "text", (1,), (2,), 500)
    validated = replace(
        results,
        validation_recording_info=replace(results.recording_info, files=(origin,)),
    )
    seconds = {"estimate_spectrum": 12.34, "nb": 98.76, "identification": 321.0}
    text = Page(build(validated, wall_clock=seconds, commit="1234abcd")).text
    assert "Estimate spectrum – – 12.3" in text
    assert "98.8" in text
    assert "All stages, in one job – – 321.0" in text
    assert "Commit of the workflow 1234abcd" in text
    assert "git -C PATH checkout 1234abcd" in text
    assert f"File for validation data/fresh.csv SHA-256 for validation {'cd' * 32}" in text
    evaluations = results.candidates["evaluations"]
    assert f"{evaluations.sum():,}".replace(",", " ") in text
    for phase in PHASES:
        own = evaluations[results.candidates["phase"] == phase]
        assert f"{len(own)} {own.sum():,}".replace(",", " ") in text


def test_times_of_jobs_are_summed_over_each_stage(tmp_path):
    def benchmark(name, text):
        file = tmp_path / f"{name}.tsv"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    benchmark("spectrum", "s\th:m:s\n12.34\t0:00:12\n")
    benchmark("estimate_candidates/delay/1", "s\n1.5\n")
    benchmark("estimate_candidates/delay/2", "s\n2.25\n")
    benchmark("select_candidate/delay", "s\n0.25\n")
    benchmark("model", "")
    benchmark("figures", "memory\n3\n")
    assert read_wall_clock(tmp_path) == {"spectrum": 12.34, "delay": 4.0}
    assert read_wall_clock(tmp_path / "absent") == {}


def test_an_unknown_commit_is_said(page):
    assert "Commit of the workflow unknown" in page.text
    assert "git -C" not in page.text


def test_checks_that_all_passed_are_said(build, results, monkeypatch):
    passed = [Check(check.name, True, check.statement) for check in results.checks]
    monkeypatch.setattr(type(results), "checks", property(lambda _: passed))
    text = Page(build(results)).text
    assert "Failed" not in text
    assert "failed" not in text


def test_hostile_names_do_no_harm(build, draw, results):
    renamed = replace(
        with_output_name(results, HOSTILE, input_units=(HOSTILE,)),
        settings=replace(results.settings, name=HOSTILE),
        recording_info=renamed_channels(results.recording_info, HOSTILE, HOSTILE),
    )
    html = build(renamed, draw(renamed, *NAMED))
    page = Page(html)
    assert page.tags.count("script") == html.count("<script") == 2
    assert page.text.count(HOSTILE) >= 4
    assert len(page.ids) == len(set(page.ids))


def test_the_page_is_small(html):
    assert len(html) < 2_000_000


def test_equal_results_give_equal_pages(build, results, html):
    assert build(results) == html
