"""Chromium, and the pages that are tested in it."""

import importlib.util
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest
from identified import with_output_name

from evopem.report.comparison import build_comparison
from evopem.report.index_page import build_index
from evopem.report.templates import environment
from evopem.results.comparison import Comparison
from evopem.results.fleet import summarize
from evopem.results.identity import IncompleteDataset

TEMPLATES = Path(__file__).parents[2] / "workflow" / "templates"
# Figures that write the names of channels.
NAMED = ("record", "simulation", "measured_and_simulated", "simulation_as_recorded")
HOSTILE = """<script>document.title="harmed"</script>"'&"""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
needs_chromium = pytest.mark.skipif(
    not (CHROMIUM and DRIVER),
    reason="Chromium is not installed (Debian packages chromium and chromium-driver)",
)

AXE = importlib.util.find_spec("axe_playwright_python")
needs_axe = pytest.mark.skipif(
    AXE is None, reason="axe-core is not installed (axe-playwright-python)"
)
# Of a report outside its figures, for a reader who opens nothing.
MOST_WORDS = 600


def renamed_channels(info, input_name, output_name):
    """The same origin with other names of its channels."""
    (u,), (y,) = info.inputs, info.outputs
    return replace(
        info, inputs=(replace(u, name=input_name),), outputs=(replace(y, name=output_name),)
    )


@pytest.fixture(scope="session")
def browser():
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-extensions",
        "--disable-sync",
        "--no-first-run",
        "--hide-scrollbars",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_script_timeout(180)  # accessibility rules on a busy machine
    yield driver
    driver.quit()


@pytest.fixture(scope="session")
def report(html, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "report.html"
    file.write_text(html, encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def hostile(results, build, draw, tmp_path_factory):
    """A report in which the data set, its channels and their units are named by a script."""
    renamed = replace(
        with_output_name(results, HOSTILE, input_units=(HOSTILE,)),
        settings=replace(results.settings, name=HOSTILE),
        recording_info=renamed_channels(results.recording_info, HOSTILE, HOSTILE),
    )
    file = tmp_path_factory.mktemp("pages") / "hostile.html"
    file.write_text(build(renamed, draw(renamed, *NAMED)), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def summary(results):
    return summarize(results.evidence)


@pytest.fixture(scope="session")
def index(summary, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "index.html"
    gone = IncompleteDataset("failed", HOSTILE)
    entries = {"bench": summary, HOSTILE: summary, "gone": gone}
    file.write_text(build_index(entries), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def comparison(results, tmp_path_factory):
    """Two models, one of them named by a script, the other one with a comma."""
    file = tmp_path_factory.mktemp("pages") / "comparison.html"
    compared = Comparison.of([results, results], (HOSTILE, "bench, again"))
    file.write_text(build_comparison(compared), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def setups(results, tmp_path_factory):
    """Two set-ups of one structure, their modes merged."""
    file = tmp_path_factory.mktemp("pages") / "setups.html"
    compared = Comparison.of([results, results], ("left", "right"), setups=True)
    file.write_text(build_comparison(compared), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def thousand(summary, tmp_path_factory):
    """A list of a thousand data sets, the errors of their models in no order."""
    entries = {
        f"bench-{number}": replace(summary, simulation_error_percent=(number * 617) % 1000 / 10)
        for number in range(999)
    }
    problem = 'bench.csv, line 7: "x" is not a number; correct it.'
    entries["bench-999"] = IncompleteDataset("failed", problem)
    file = tmp_path_factory.mktemp("pages") / "thousand.html"
    file.write_text(build_index(entries), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def several(summary, tmp_path_factory):
    """A list of four data sets in two groups, one of them incomplete, that differ in one thing."""
    passed = tuple(replace(check, passed=True) for check in summary.checks)
    failed = tuple(replace(check, passed=check.name != "White residuals") for check in passed)
    high = tuple(replace(mode, frequency_hz=100.5) for mode in summary.modes)
    problem = 'bench.csv, line 7: "x" is not a number; correct it.'
    entries = {
        "arm-1": replace(summary, checks=passed),
        "arm-2": replace(summary, checks=failed),
        "bench-1": replace(summary, checks=passed, modes=high),
        "bench-2": IncompleteDataset("failed", problem, "logs/recording.log"),
    }
    file = tmp_path_factory.mktemp("pages") / "several.html"
    file.write_text(build_index(entries), encoding="utf-8")
    return file


def told(about, *given):
    """The paragraphs of one of the templates' sentences, as they are read."""
    module = environment(TEMPLATES).get_template("sentences.html.j2").module
    text = str(getattr(module, about)(*given))
    paragraphs = re.findall(r"<p>(.*?)</p>", text, re.DOTALL) or [text]
    plain = [re.sub(r"[ \n]+", " ", unescape(paragraph)).strip() for paragraph in paragraphs]
    return [paragraph for paragraph in plain if paragraph]


def visit(browser, file, width=1440, scheme="light"):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
    )
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": scheme}]},
    )
    browser.get(file.as_uri())


def open_everything(browser):
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    browser.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0], 100))")


def words_at_first(browser):
    """The words that a reader sees who opens nothing, outside figures."""
    text = browser.execute_script(
        """document.querySelectorAll('svg, .live').forEach(each => { each.hidden = true; });
        document.querySelectorAll('svg, .off-page').forEach(each => each.remove());
        return document.body.innerText"""
    )
    return re.findall(r"[A-Za-z][A-Za-z’'-]+", text)


def violations(browser):
    """The rules of accessibility that a page breaks, with where, and how many it keeps."""
    browser.execute_script((Path(AXE.origin).parent / "axe.min.js").read_text(encoding="utf-8"))
    violated, passed = browser.execute_async_script(
        """const done = arguments[arguments.length - 1];
        const rules = {'label-content-name-mismatch': {enabled: true}};
        axe.run(document, {rules, resultTypes: ['violations']}).then(
            result => done([
                result.violations.map(v => [v.id, v.nodes.map(n => n.html)]),
                result.passes.length,
            ]),
            error => done([String(error), 0]))"""
    )
    return violated, passed
