"""The pages: complete, escaped, self-contained, and true to the result files."""

import base64
import hashlib
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from result_files import write_results

from evopem.errors import InputError
from evopem.figures import FIGURE_NAMES, draw_all, result_paths
from evopem.report import build_index, build_report
from evopem.results.fleet import summarize

TEMPLATES = Path(__file__).parents[2] / "workflow" / "templates"
HOSTILE = """<script>alert("x")</script>'&"""


class Page(HTMLParser):
    """Tags, ids and text of a page."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.ids, self.references, self.words = [], [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append(tag)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        self.references += [
            attributes[key] for key in ("href", "src", "xlink:href") if key in attributes
        ]

    handle_startendtag = handle_starttag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="session")
def html(results):
    return build_report(result_paths(results), TEMPLATES)


@pytest.fixture(scope="session")
def page(html):
    return Page(html)


def test_every_figure_is_in_the_page(page):
    assert page.tags.count("svg") == len(FIGURE_NAMES)
    assert set(FIGURE_NAMES) <= set(page.ids)


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


def test_the_only_script_is_the_projects_own_and_allowed_by_its_digest(html, page):
    own = (TEMPLATES / "page.js").read_text()
    assert re.findall(r"<script[^>]*>(.*?)</script>", html, re.DOTALL) == [own]
    digest = base64.b64encode(hashlib.sha256(own.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in html
    assert "</script" not in own
    assert page.tags.count("script") == 1


def tables_in(page):
    """The tables held by the page's links, by the names they are saved under."""
    links = [r for r in page.references if r.startswith("data:text/csv")]
    return [pd.read_csv(io.StringIO(unquote(link.partition(",")[2]))) for link in links]


def test_every_figure_offers_its_numbers_inside_the_page(results, page):
    tables = dict(zip(FIGURE_NAMES, tables_in(page), strict=True))
    spectrum = pd.read_csv(results / "spectrum.csv")
    np.testing.assert_allclose(tables["spectrum"]["density"], spectrum["density"], rtol=1e-5)
    simulation = pd.read_csv(results / "simulation.csv")
    assert list(tables["simulation"]) == list(simulation)
    np.testing.assert_allclose(tables["simulation"]["output"], simulation["output"], rtol=1e-5)
    model = json.loads((results / "model.json").read_text())
    roots = tables["poles_zeros"]
    poles = roots[roots["kind"] == "pole"]
    expected = np.roots(model["a"])
    np.testing.assert_allclose(np.poly(poles["real"] + 1j * poles["imag"]), model["a"], atol=1e-4)
    assert len(poles) == len(expected)
    assert (poles["variance_real"] > 0).all()
    assert set(tables["record"]["stage"]) == {"recorded", "estimation", "validation"}
    assert set(tables["frequency_response"]["source"]) == {"model", "multitaper"}
    assert len(tables["delay"]) + len(tables["phases"]) == len(
        pd.read_csv(results / "candidates.csv")
    )


def test_the_answer_is_true_to_the_files(results, page):
    validation = json.loads((results / "validation.json").read_text())
    assert "ARMAX(7, 6, 7, 3)" in page.text
    assert f"{validation['prediction_error_percent']:.2f}" in page.text
    assert f"{validation['simulation_error_percent']:.1f}" in page.text
    for mode in json.loads((results / "model.json").read_text())["modes"]:
        assert f"{mode['frequency_hz']:.2f}" in page.text
    assert "number of B coefficients" in page.text


def test_the_chapter_and_the_truth_stand_beside_the_estimate(page):
    for figure in ("Truth", "Chapter", "37.00", "17.50", "The true delay is 3 samples: found"):
        assert figure in page.text


def test_a_recorded_set_has_neither_truth_nor_chapter(results, tmp_path):
    directory = shutil.copytree(results, tmp_path / "bench")
    (directory / "truth.json").unlink()
    (directory / "config.yaml").write_text("datasets: {bench: {file: bench.csv}}\n")
    digest = "ab" * 32
    recording = json.loads((directory / "recording.json").read_text())
    recording |= {"kind": "file", "path": "data/bench.csv", "sha256": digest, "bytes": 123456}
    (directory / "recording.json").write_text(json.dumps(recording))
    page = Page(build_report(result_paths(directory), TEMPLATES))
    assert "Truth" not in page.text
    assert "Chapter" not in page.text
    assert digest in page.text
    assert "data/bench.csv" in page.text


def test_the_configuration_and_the_command_are_in_full(results, page):
    for line in (results / "config.yaml").read_text().splitlines():
        assert line.strip() in page.text
    assert "snakemake --snakefile" in page.text


def test_every_check_is_in_words_with_advice_where_it_failed(page):
    assert page.text.count("Passed") + page.text.count("Not judged ") >= 9
    # The delay 3 is the upper end of the range searched, 0 to 3.
    assert "Failed Orders inside their search ranges. At the edge: delay nk = 3 in 0–3." in (
        page.text
    )
    assert "Widen that range" in page.text


def test_stages_commit_and_validation_file_are_in_the_provenance(results, tmp_path):
    directory = shutil.copytree(results, tmp_path / "arm")
    (directory / "benchmarks").mkdir()
    (directory / "benchmarks" / "spectrum.tsv").write_text("s\th:m:s\n12.34\t0:00:12\n")
    (directory / "benchmarks" / "model.tsv").write_text("")
    origin = {"kind": "file", "path": "data/fresh.csv", "sha256": "cd" * 32, "bytes": 99}
    (directory / "validation_recording.json").write_text(json.dumps(origin))
    paths = result_paths(directory)
    text = Page(build_report(paths, TEMPLATES, commit="1234abcd")).text
    assert "Spectrum – – 12.3" in text
    assert "Model and covariance – – –" in text
    assert "Commit of the workflow 1234abcd" in text
    assert "git -C PATH checkout 1234abcd" in text
    assert "File for validation data/fresh.csv" in text
    assert "cd" * 32 in text
    candidates = pd.read_csv(directory / "candidates.csv")
    assert f"{candidates['evaluations'].sum():,}".replace(",", " ") in text
    for phase in ("delay", "common", "c", "b"):
        own = candidates[candidates["phase"] == phase]
        assert f"{len(own)} {own['evaluations'].sum():,}".replace(",", " ") in text


def test_an_unknown_commit_is_said(page):
    assert "Commit of the workflow unknown" in page.text
    assert "git -C" not in page.text


def test_missing_evidence_is_said(results, tmp_path):
    directory = shutil.copytree(results, tmp_path / "arm")
    validation = json.loads((directory / "validation.json").read_text())
    validation["ljung_box"]["p_value"] = None
    validation["simulation_error_percent"] = None
    del validation["excitation"]
    (directory / "validation.json").write_text(json.dumps(validation))
    page = Page(build_report(result_paths(directory), TEMPLATES))
    assert "Not judged White residuals." in page.text
    assert "Not judged Excitation adequate." in page.text
    assert "Not judged: White residuals; Excitation adequate." in page.text


def test_hostile_names_do_no_harm(tmp_path):
    directory = write_results(
        tmp_path / "hostile", samples=1500, output_name=HOSTILE, dataset=HOSTILE
    )
    draw_all(result_paths(directory), directory / "figures")
    html = build_report(result_paths(directory), TEMPLATES)
    page = Page(html)
    assert page.tags.count("script") == html.count("<script") == 1
    assert HOSTILE in page.text
    assert len(page.ids) == len(set(page.ids))


def test_the_page_is_small(html):
    assert len(html) < 1_500_000


def test_equal_results_give_equal_pages(results, html):
    assert build_report(result_paths(results), TEMPLATES) == html


def test_a_missing_file_is_named(results):
    paths = result_paths(results)
    del paths["model.json"]
    with pytest.raises(InputError, match=r"model\.json"):
        build_report(paths, TEMPLATES)


def test_a_damaged_file_is_named(results, tmp_path):
    directory = shutil.copytree(results, tmp_path / "arm")
    (directory / "spectrum.json").write_text("{")
    with pytest.raises(InputError, match=r"spectrum\.json.*not valid JSON"):
        build_report(result_paths(directory), TEMPLATES)


def test_a_figure_that_was_not_drawn_is_said(results):
    paths = result_paths(results)
    del paths["figures/delay.svg"]
    page = Page(build_report(paths, TEMPLATES))
    assert "This figure was not drawn." in page.text


@pytest.fixture
def datasets(results, tmp_path):
    """Three data sets: as it is, with all checks passed, and with a simulation that failed."""
    good = shutil.copytree(results, tmp_path / "good")
    table = pd.read_csv(good / "candidates.csv")
    extra = table[(table["phase"] == "delay") & (table["nk"] == 3)].assign(nk=4, selected=False)
    pd.concat([table, extra]).to_csv(good / "candidates.csv", index=False)
    bad = shutil.copytree(results, tmp_path / "bad")
    validation = json.loads((bad / "validation.json").read_text())
    validation["ljung_box"]["p_value"] = 1e-9
    validation["simulation_error_percent"] = None
    (bad / "validation.json").write_text(json.dumps(validation))
    return {
        "good": result_paths(good),
        HOSTILE: result_paths(bad),
        "a / b?#": result_paths(results),
    }


def test_index_has_the_worst_first_and_links_each_report(datasets):
    summaries = {name: summarize(paths) for name, paths in datasets.items()}
    html = build_index(summaries | {"gone": {"problem": "gone.csv: <no> file"}}, TEMPLATES)
    page = Page(html)
    links = [reference for reference in page.references if reference.endswith("report.html")]
    assert links == [
        "%3Cscript%3Ealert%28%22x%22%29%3C%2Fscript%3E%27%26/report.html",
        "a%20%2F%20b%3F%23/report.html",
        "good/report.html",
    ]
    assert page.references.index("gone/logs/") < page.references.index(links[0])
    assert "gone.csv: <no> file" in page.text
    assert "2 failed" in page.text
    assert "13 passed" in page.text
    assert page.tags.count("script") == html.count("<script") == 1
    assert HOSTILE in page.text
