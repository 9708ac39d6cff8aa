"""The pages in a real browser: their layout, accessibility and printing."""

import base64
import importlib.util
import io
import json
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from unicodedata import normalize

import pytest
from browsing import HOSTILE, needs_chromium, visit

from evopem.results.layout import FIGURES

WIDTHS = (360, 768, 1440)

pytest.importorskip("selenium", reason="selenium is not installed")
pytestmark = needs_chromium


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
    assert 5 <= len(pages) <= 18  # eleven figures, and sections between them
    assert min(len(text) for text in texts) > 40
    drawings = Drawings(report.read_text(encoding="utf-8")).words
    assert set(drawings) == set(FIGURES)
    for name, words in drawings.items():
        telling = {word for word in words if len(word) > 3}
        assert telling
        assert any(all(word in text for word in telling) for text in texts), name
