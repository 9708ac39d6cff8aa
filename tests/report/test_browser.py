"""The pages in a real browser."""

import base64
import importlib.util
import io
import json
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from unicodedata import normalize

import pytest

from evopem.report import build_index
from evopem.results.fleet import IncompleteDataset, summarize
from evopem.results.layout import FIGURES

TEMPLATES = Path(__file__).parents[2] / "workflow" / "templates"
HOSTILE = """<script>document.title="harmed"</script>"'&"""
WIDTHS = (360, 768, 1440)

selenium = pytest.importorskip("selenium", reason="selenium is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not (CHROMIUM and DRIVER),
    reason="no Chromium here (Debian packages chromium and chromium-driver)",
)


@pytest.fixture(scope="module")
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


@pytest.fixture(scope="module")
def report(html, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "report.html"
    file.write_text(html, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def hostile(results, build, draw, tmp_path_factory):
    """A report in which the data set, its channels and their units are named by a script."""
    renamed = replace(
        results,
        settings=replace(results.settings, name=HOSTILE),
        recording=replace(results.recording, output_name=HOSTILE, input_unit=HOSTILE),
        recording_info=replace(results.recording_info, output_name=HOSTILE, input_name=HOSTILE),
    )
    file = tmp_path_factory.mktemp("pages") / "hostile.html"
    file.write_text(build(renamed, draw(renamed)), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def summary(results):
    return summarize(
        results.model,
        results.validation,
        results.spectrum_summary,
        results.phases,
        results.recording_info,
    )


@pytest.fixture(scope="module")
def index(summary, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "index.html"
    gone = IncompleteDataset("failed", HOSTILE)
    entries = {"bench": summary, HOSTILE: summary, "gone": gone}
    file.write_text(build_index(entries, TEMPLATES), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def thousand(summary, tmp_path_factory):
    """A list of a thousand data sets, the errors of their models in no order."""
    entries = {
        f"bench-{number}": replace(summary, simulation_error_percent=(number * 617) % 1000 / 10)
        for number in range(999)
    }
    problem = 'bench.csv, line 7: "x" is not a number; correct it.'
    entries["bench-999"] = IncompleteDataset("failed", problem)
    file = tmp_path_factory.mktemp("pages") / "thousand.html"
    file.write_text(build_index(entries, TEMPLATES), encoding="utf-8")
    return file


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


def requests(browser):
    """Addresses that were asked for since last looked at."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    return [
        message["params"]["request"]["url"]
        for message in messages
        if message["method"] == "Network.requestWillBeSent"
    ]


@pytest.mark.parametrize("name", ["report", "hostile", "index"])
def test_no_error_and_no_request_beyond_the_file(browser, request, name):
    file = request.getfixturevalue(name)
    browser.get_log("browser")
    browser.get_log("performance")
    visit(browser, file)
    assert browser.get_log("browser") == []
    asked = [url for url in requests(browser) if not url.startswith("data:")]
    assert asked == [file.as_uri()]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["report", "hostile", "index"])
def test_no_horizontal_overflow(browser, request, name, width):
    visit(browser, request.getfixturevalue(name), width)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width


def test_every_figure_is_drawn(browser, report):
    visit(browser, report)
    sizes = browser.execute_script(
        """return Array.from(document.querySelectorAll('figure svg')).map(svg => {
            const shapes = Array.from(svg.querySelectorAll('path, use'));
            const seen = shapes.filter(s => s.getBoundingClientRect().width > 0);
            const box = svg.getBoundingClientRect();
            return [box.width, box.height, seen.length, svg.getAttribute('aria-label')];
        })"""
    )
    assert len(sizes) == len(FIGURES)
    for width, height, shapes, label in sizes:
        assert width > 500
        assert height > 150
        assert shapes > 10
        assert label


def contrast(first, second):
    """WCAG 2 contrast ratio of two CSS colours rgb(r, g, b)."""

    def luminance(colour):
        channels = [int(c) / 255 for c in colour[colour.index("(") + 1 : -1].split(",")[:3]]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    light, dark = sorted((luminance(first), luminance(second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_figures_stand_out_in_both_themes(browser, report, scheme):
    visit(browser, report, scheme=scheme)
    colours = browser.execute_script(
        """const of = (selector, property) =>
            getComputedStyle(document.querySelector(selector))[property];
        return {
            paper: of('body', 'backgroundColor'),
            text: of('body', 'color'),
            caption: of('figcaption', 'color'),
            link: of('figcaption a', 'color'),
            verdict: of('.failed .verdict', 'color'),
            passed: of('.passed .verdict', 'color'),
            figure: of('figure svg text', 'fill'),
        }"""
    )
    paper = colours.pop("paper")
    dark = contrast(paper, "rgb(0, 0, 0)") < 2
    assert dark == (scheme == "dark")
    for name, colour in colours.items():
        assert contrast(paper, colour) >= 4.5, name


def test_hostile_names_are_shown_and_not_run(browser, hostile):
    visit(browser, hostile)
    assert browser.find_element("tag name", "h1").text == HOSTILE
    assert browser.title == f"{HOSTILE}: identification report"
    assert len(browser.find_elements("tag name", "script")) == 1
    names = browser.execute_script(
        "return Array.from(document.querySelectorAll('a[download]')).map(link => link.download)"
    )
    assert len(names) == len(FIGURES)
    assert not set("".join(names)) & set("<>\"'&/\\")


def test_everything_can_be_reached_by_keyboard(browser, report):
    visit(browser, report)
    unreachable = browser.execute_script(
        """return Array.from(document.querySelectorAll('*')).filter(e =>
            e.scrollWidth > e.clientWidth + 1 &&
            ['auto', 'scroll'].includes(getComputedStyle(e).overflowX) &&
            e.tabIndex < 0).length"""
    )
    assert unreachable == 0


def test_headings_descend_by_one(browser, report):
    visit(browser, report)
    levels = browser.execute_script(
        """return Array.from(document.querySelectorAll('h1, h2, h3, h4'))
            .map(h => Number(h.tagName[1]))"""
    )
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))


AXE = importlib.util.find_spec("axe_playwright_python")


@pytest.mark.skipif(AXE is None, reason="axe-core is not installed (axe-playwright-python)")
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1440])
@pytest.mark.parametrize("name", ["report", "hostile", "index"])
def test_no_accessibility_violation(browser, request, name, width, scheme):
    visit(browser, request.getfixturevalue(name), width, scheme)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    browser.execute_script((Path(AXE.origin).parent / "axe.min.js").read_text(encoding="utf-8"))
    found = browser.execute_async_script(
        """const done = arguments[arguments.length - 1];
        axe.run(document, {resultTypes: ['violations']}).then(
            result => done({
                passes: result.passes.length,
                violations: result.violations.map(v => [v.id, v.nodes.map(n => n.html)]),
            }),
            error => done({violations: [String(error)]}))"""
    )
    assert found["violations"] == []
    assert found["passes"] > 15


def copied(browser):
    """Text on the clipboard."""
    browser.execute_cdp_cmd(
        "Browser.grantPermissions",
        {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]},
    )
    return browser.execute_async_script(
        """const done = arguments[arguments.length - 1];
        (window.clipboard ?? navigator.clipboard).readText().then(done, e => done(String(e)))"""
    )


def press(browser, label):
    """Press the button of that name by keyboard and wait until it has said what it did."""
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    button = browser.find_element("css selector", f'button[aria-label="{label}"]')
    button.send_keys(Keys.ENTER)
    WebDriverWait(browser, 5).until(lambda _: button.text == "Copied")
    assert "copied" in browser.find_element("id", "status").get_attribute("textContent")


@pytest.mark.parametrize("clipboard", ["granted", "absent", "refused"])
def test_the_model_is_copied_in_every_notation(browser, report, identified, clipboard):
    visit(browser, report)
    if clipboard != "granted":
        value = {
            "absent": "undefined",
            "refused": "{writeText: () => Promise.reject(new Error('no'))}",
        }[clipboard]
        browser.execute_script(
            "window.clipboard = navigator.clipboard;"
            f"Object.defineProperty(navigator, 'clipboard', {{value: {value}}})"
        )
    model = json.loads(Path(identified.files.model).read_text())
    press(browser, "Copy JSON")
    taken = json.loads(copied(browser))
    assert model | taken == model
    assert set(taken) == {"orders", "a", "b", "c", "noise_variance", "sampling_rate"}
    assert {"orders", "a", "b", "c", "noise_variance", "sampling_rate"} == set(taken)
    press(browser, "Copy Plain text")
    assert copied(browser).startswith("A(q) y(t) = B(q) u(t) + C(q) e(t)\nA(q) = 1 ")
    press(browser, "Copy MATLAB")
    assert copied(browser).startswith("model = idpoly([1 ")
    press(browser, "Copy Python")
    assert "control.tf(" in copied(browser)


def test_a_table_is_copied_with_numbers_at_full_precision(browser, report, results):
    visit(browser, report)
    press(browser, "Copy table: Modes")
    header, *rows = [line.split("\t") for line in copied(browser).split("\n")]
    assert header[:5] == [
        "Mode",
        "fn (Hz)",
        "fn (Hz) standard error",
        "zeta (%)",
        "zeta (%) standard error",
    ]
    assert {len(row) for row in rows} == {len(header)}
    for row, mode in zip(rows, results.model.modes, strict=True):
        assert float(row[1]) == pytest.approx(mode.frequency_hz, rel=1e-11)
        assert float(row[4]) == pytest.approx(100 * mode.damping_se, rel=1e-11)
    press(browser, "Copy table: Time of each stage")
    assert "\u202f" not in copied(browser)


def column(browser, table, index):
    return browser.execute_script(
        """return Array.from(document.querySelector(`table[data-name="${arguments[0]}"]`)
            .tBodies[0].rows).map(row => row.cells[arguments[1]].dataset.value ??
                row.cells[arguments[1]].textContent)""",
        table,
        index,
    )


def test_tables_sort_by_keyboard(browser, report):
    from selenium.webdriver.common.keys import Keys

    visit(browser, report)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    heads = browser.find_elements("css selector", 'table[data-name="Candidates"] thead th')
    bic = next(i for i, head in enumerate(heads) if head.text.startswith("BIC"))
    button = heads[bic].find_element("tag name", "button")
    before = [float(value) for value in column(browser, "Candidates", bic)]
    button.send_keys(Keys.ENTER)
    assert [float(v) for v in column(browser, "Candidates", bic)] == sorted(before)
    assert heads[bic].get_attribute("aria-sort") == "ascending"
    button.send_keys(Keys.SPACE)
    assert [float(v) for v in column(browser, "Candidates", bic)] == sorted(before, reverse=True)
    assert heads[bic].get_attribute("aria-sort") == "descending"
    assert "descending" in browser.find_element("id", "status").get_attribute("textContent")
    heads[0].find_element("tag name", "button").send_keys(Keys.ENTER)
    assert heads[bic].get_attribute("aria-sort") is None
    words = column(browser, "Candidates", 0)
    assert words == sorted(words)


def test_what_has_no_number_stays_at_the_end(browser, report):
    visit(browser, report)
    button = browser.find_element(
        "xpath", '//table[@data-name="Time of each stage"]//button[text()="Evaluations"]'
    )
    for reverse in (False, True):
        button.click()
        values = column(browser, "Time of each stage", 2)
        numbers = [float(value) for value in values if value]
        assert numbers == sorted(numbers, reverse=reverse)
        assert values == [v for v in values if v] + [""] * (len(values) - len(numbers))


def test_a_thousand_data_sets_are_searched_and_sorted(browser, thousand):
    """The worst stand first; a search leaves the rows that hold all its words."""
    visit(browser, thousand)
    names = column(browser, "Data sets", 0)
    errors = [float(value) for value in column(browser, "Data sets", 3) if value]
    assert names[0] == "bench-999"
    assert errors == sorted(errors, reverse=True)
    assert len(errors) == 999

    def shown(words):
        return browser.execute_script(
            """const field = document.querySelector('input[type=search]');
            field.value = arguments[0];
            field.dispatchEvent(new Event('input'));
            const rows = [...document.querySelector('tbody').rows].filter(row => !row.hidden);
            return rows.map(row => row.cells[0].textContent);""",
            words,
        )

    assert set(shown("BENCH-99 passed")) == {
        "bench-99",
        *(f"bench-99{digit}" for digit in range(9)),
    }
    assert shown("not complete") == ["bench-999"]
    assert "1 of 1000 rows" in browser.find_element("id", "status").get_attribute("textContent")
    assert len(shown("")) == 1000

    browser.find_element("css selector", "thead th button").click()
    assert column(browser, "Data sets", 0) == [f"bench-{number}" for number in range(1000)]


def test_a_figures_numbers_are_saved_from_the_page(browser, report, tmp_path):
    import pandas as pd
    from selenium.webdriver.support.ui import WebDriverWait

    visit(browser, report)
    browser.execute_cdp_cmd(
        "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)}
    )
    link = browser.find_element("css selector", "#delay a[download]")
    browser.execute_script("arguments[0].click()", link)
    saved = tmp_path / "bench-delay.csv"
    WebDriverWait(browser, 10).until(lambda _: saved.is_file())
    assert list(pd.read_csv(saved))[:4] == ["na", "nb", "nc", "nk"]
    assert browser.current_url == report.as_uri()


def test_complete_without_javascript(browser, report):
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        visit(browser, report)
        assert len(browser.find_elements("css selector", "figure svg")) == len(FIGURES)
        assert [b for b in browser.find_elements("tag name", "button") if b.is_displayed()] == []
        assert "Copy the model" not in browser.find_element("tag name", "body").text
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


class Drawings(HTMLParser):
    """The words inside each figure of a page, by the section it stands in."""

    def __init__(self, html):
        super().__init__()
        self.words, self.section, self.inside = {}, None, False
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        if tag == "section":
            self.section = dict(attrs).get("id")
        self.inside = tag == "text" or (self.inside and tag == "tspan")

    def handle_endtag(self, tag):
        self.inside = self.inside and tag != "text"

    def handle_data(self, data):
        if self.inside and data.strip():
            self.words.setdefault(self.section, []).append("".join(normalize("NFKC", data).split()))


@pytest.mark.parametrize("paper", [(8.27, 11.69), (8.5, 11.0)], ids=["A4", "letter"])
def test_prints_without_blank_pages_and_cut_figures(browser, report, paper):
    pypdf = pytest.importorskip("pypdf")
    visit(browser, report, scheme="dark")
    width, height = paper
    printed = browser.execute_cdp_cmd(
        "Page.printToPDF",
        {"paperWidth": width, "paperHeight": height, "preferCSSPageSize": False},
    )
    pages = pypdf.PdfReader(io.BytesIO(base64.b64decode(printed["data"]))).pages
    texts = ["".join(normalize("NFKC", page.extract_text()).split()) for page in pages]  # ligatures
    assert 5 <= len(pages) <= 16
    assert min(len(text) for text in texts) > 40
    drawings = Drawings(report.read_text(encoding="utf-8")).words
    assert set(drawings) == set(FIGURES)
    for name, words in drawings.items():
        telling = {word for word in words if len(word) > 3}
        assert telling
        assert any(all(word in text for word in telling) for text in texts), name
