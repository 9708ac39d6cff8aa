"""The pages in a real browser: their layout, accessibility and printing."""

import base64
import io
import json
from html.parser import HTMLParser
from itertools import pairwise
from unicodedata import normalize

import pytest
from browsing import (
    HOSTILE,
    MOST_WORDS,
    needs_axe,
    needs_chromium,
    open_everything,
    violations,
    visit,
    words_at_first,
)

from evopem.results.layout import FIGURES

WIDTHS = (360, 500, 768, 1440, 2560)
FIRST_SCREEN = 900  # pixels, at a width of 1440

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


@pytest.mark.parametrize("name", ["report", "hostile", "index", "comparison"])
def test_no_error_and_no_request_beyond_the_file(browser, request, name):
    file = request.getfixturevalue(name)
    browser.get_log("browser")
    browser.get_log("performance")
    visit(browser, file)
    assert browser.get_log("browser") == []
    asked = [url for url in requests(browser) if not url.startswith("data:")]
    assert asked == [file.as_uri()]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["hostile", "index", "several", "comparison"])
def test_nothing_is_cut_without_a_cue(browser, request, name, width):
    """What is wider than its place scrolls there, and says so; the hostile page is a report."""
    visit(browser, request.getfixturevalue(name), width)
    open_everything(browser)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    cut = browser.execute_script(
        """const told = (e) => e.matches('.scroll') && e.previousElementSibling?.matches('.cue')
                && !e.previousElementSibling.hidden
            || e.matches('.contents ol') && getComputedStyle(e).maskImage !== 'none';
        const apart = (e) => e.closest('.off-page, .skip, svg, .u-wrap, textarea') ||
            getComputedStyle(e).display === 'inline';
        const scrolls = (e) => ['auto', 'scroll', 'hidden', 'clip']
            .includes(getComputedStyle(e).overflowX);
        const found = [];
        for (const e of document.body.querySelectorAll('*')) {
            if (apart(e) || e.clientWidth === 0) continue;
            if (e.scrollWidth > e.clientWidth + 1 && scrolls(e) && !told(e)) found.push(e);
            const box = e.getBoundingClientRect();
            let up = e.parentElement;
            while (up && !scrolls(up)) up = up.parentElement;
            if (!up && (box.right > innerWidth + 1 || box.left < -1)) found.push(e);
        }
        return found.map(e => e.outerHTML.slice(0, 120));"""
    )
    assert cut == []


@pytest.mark.parametrize("name", ["report", "several"])
@pytest.mark.parametrize("width", [360, 500])
def test_rows_of_tables_are_lists_on_a_phone_and_none_is_blank(browser, request, name, width):
    visit(browser, request.getfixturevalue(name), width)
    open_everything(browser)
    blank, unlabelled = browser.execute_script(
        """const height = (e) => e.getBoundingClientRect().height;
        const rows = [...document.querySelectorAll('tbody tr')];
        const blank = rows.map(row => height(row) -
            [...row.cells].map(height).reduce((sum, each) => sum + each, 0));
        const cells = [...document.querySelectorAll('tbody td')];
        return [blank, cells.filter(td => td.dataset.label === undefined).length];"""
    )
    assert max(blank) < 24
    assert unlabelled == 0


def test_the_first_screen_holds_the_answer(browser, report, results):
    """Verdict, frequency response, trusted modes and simulation, without scrolling and soon."""
    visit(browser, report)
    wait_for_figures(browser)
    bottoms = browser.execute_script(
        """const bottom = (e) => e.getBoundingClientRect().bottom;
        const rows = document.querySelectorAll('table[data-name="Modes"] tbody tr:not(.doubted)');
        const parts = document.querySelectorAll('#gain canvas');
        return {
            verdict: bottom(document.querySelector('.answer')),
            uses: bottom(document.querySelector('.uses')),
            simulation: bottom(document.querySelector('#measured_and_simulated canvas')),
            gain: bottom(parts[0]),
            phase: bottom(parts[1]),
            coherence: bottom(parts[2]),
            modes: bottom(rows[rows.length - 1]),
            count: rows.length,
        }"""
    )
    assert bottoms.pop("count") == len(results.validation.modes.trusted)
    assert {name: place for name, place in bottoms.items() if place > FIRST_SCREEN} == {}
    assert min(first_paint(browser, report) for _ in range(3)) < 1000


def test_the_first_plot_is_on_the_first_screen_of_a_phone(browser, report):
    visit(browser, report, width=360)
    wait_for_figures(browser)
    bottom = browser.execute_script(
        "return document.querySelector('#gain canvas').getBoundingClientRect().bottom"
    )
    assert bottom < 780


def test_a_reader_who_opens_nothing_reads_little(browser, report):
    """Words outside figures; about 1100 while captions stood open."""
    visit(browser, report)
    words = words_at_first(browser)
    assert {"Good", "for"} < {*words}
    assert 100 < len(words) <= MOST_WORDS


def first_paint(browser, page):
    """Milliseconds from the request of a page to its first words; other work can delay one load."""
    visit(browser, page)
    # The load can end before the first words are drawn, so the entry is awaited.
    return browser.execute_async_script(
        """const done = arguments[0];
        new PerformanceObserver((list) => {
            const [entry] = list.getEntriesByName('first-contentful-paint');
            if (entry) done(entry.startTime);
        }).observe({type: 'paint', buffered: true});"""
    )


def test_a_list_of_a_thousand_is_small_and_opens_soon(browser, thousand):
    assert thousand.stat().st_size < 5_000_000
    assert min(first_paint(browser, thousand) for _ in range(3)) < 1000


@pytest.mark.parametrize("width", [360, 1440])
def test_the_contents_follow_and_mark_the_part_that_is_read(browser, report, width):
    visit(browser, report, width)
    links = browser.execute_script(
        "return [...document.querySelectorAll('.contents a')].map(a => a.hash)"
    )
    assert links[0] == "#summary"
    for part in (links[3], links[-1]):
        top, bottom, marked = browser.execute_async_script(
            """const done = arguments[1];
            document.querySelector(arguments[0]).scrollIntoView();
            setTimeout(() => {
                const box = document.querySelector('.contents').getBoundingClientRect();
                const now = document.querySelector('.contents [aria-current]');
                done([box.top, box.bottom, now.hash]);
            }, 600);""",
            part,
        )
        assert top >= -1
        assert bottom <= FIRST_SCREEN
        assert marked == part


def wait_for_figures(browser):
    """Wait until the two figures of the first screen can be zoomed."""
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 10).until(
        lambda _: len(browser.find_elements("css selector", ".first-figures .is-live")) == 2
    )


@pytest.fixture
def without_script(browser):
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    yield browser
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def test_complete_without_javascript(without_script, report):
    visit(without_script, report)
    sizes, buttons, words = without_script.execute_script(
        """const sizes = Array.from(document.querySelectorAll('figure svg')).map(svg => {
            const shapes = Array.from(svg.querySelectorAll('path, use'));
            const seen = shapes.filter(s => s.getBoundingClientRect().width > 0);
            const box = svg.getBoundingClientRect();
            return [box.width, box.height, seen.length, svg.getAttribute('aria-label')];
        });
        const buttons = [...document.querySelectorAll('button')].filter(
            each => each.checkVisibility({visibilityProperty: true}));
        return [sizes, buttons.length, document.body.innerText];"""
    )
    assert len(sizes) == len(FIGURES)
    for width, height, shapes, label in sizes:
        assert width > 400
        assert height > 150
        assert shapes > 10
        assert label
    assert buttons == 0
    assert "Copy the model" not in words


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
            link: of('summary', 'color'),
            verdict: of('.checks .verdict', 'color'),
            good: of('.use.good h3', 'color'),
            contents: of('.contents a', 'color'),
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
    assert len(browser.find_elements("tag name", "script")) == 2
    names = browser.execute_script(
        "return Array.from(document.querySelectorAll('a[download]')).map(link => link.download)"
    )
    assert len(names) == len(FIGURES)
    assert not set("".join(names)) & set("<>\"'&/\\")


def test_the_curves_of_every_compared_model_are_drawn(browser, comparison):
    from selenium.webdriver.support.ui import WebDriverWait

    visit(browser, comparison)
    browser.execute_script("document.getElementById('responses').scrollIntoView()")
    legends = """return [...document.querySelectorAll('.live .legend')].map(legend =>
        [...legend.querySelectorAll('button')].map(button => button.textContent));"""
    drawn = WebDriverWait(browser, 20).until(
        lambda driver: len(found := driver.execute_script(legends)[:3]) == 3 and found
    )
    names = [HOSTILE, "bench, again"]
    assert drawn == [["measured", *names], names, names]


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


@needs_axe
# Every kind of page in both schemes and both widths: two are reports, two are lists.
@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        ("report", 360, "light"),
        ("hostile", 1440, "dark"),
        ("several", 360, "light"),
        ("index", 1440, "dark"),
        ("comparison", 360, "light"),
        ("comparison", 1440, "dark"),
        ("setups", 360, "dark"),
        ("setups", 1440, "light"),
    ],
)
def test_no_accessibility_violation(browser, request, name, width, scheme):
    visit(browser, request.getfixturevalue(name), width, scheme)
    open_everything(browser)
    violated, passed = violations(browser)
    assert violated == []
    assert passed > 15


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


def test_no_table_is_wider_than_the_printed_page(browser, report):
    visit(browser, report, width=673)  # A4 without its margins, at 96 pixels an inch
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        cut = browser.execute_script(
            """return [...document.querySelectorAll('table')]
                .filter(table => table.getBoundingClientRect().right > innerWidth + 1)
                .map(table => table.dataset.name)"""
        )
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert cut == []
