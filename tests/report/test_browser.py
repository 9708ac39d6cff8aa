"""The pages in a real browser."""

import base64
import json
import shutil
from itertools import pairwise
from pathlib import Path

import pytest
from result_files import write_results

from evopem.figures import FIGURE_NAMES, draw_all, result_paths
from evopem.report import build_index, build_report

TEMPLATES = Path(__file__).parents[2] / "workflow" / "templates"
HOSTILE = """<script>document.title="harmed"</script>"'&"""
WIDTHS = (360, 768, 1440)

selenium = pytest.importorskip("selenium", reason="selenium is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER),
        reason="no Chromium here (Debian packages chromium and chromium-driver)",
    ),
    pytest.mark.xdist_group("report"),
]


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
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def report(results, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "report.html"
    file.write_text(build_report(result_paths(results), TEMPLATES), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    directory = write_results(
        tmp_path_factory.mktemp("pages") / "hostile", 1500, output_name=HOSTILE, dataset=HOSTILE
    )
    draw_all(result_paths(directory), directory / "figures")
    file = directory / "report.html"
    file.write_text(build_report(result_paths(directory), TEMPLATES), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def index(results, tmp_path_factory):
    file = tmp_path_factory.mktemp("pages") / "index.html"
    datasets = {"arm": result_paths(results), HOSTILE: result_paths(results)}
    file.write_text(build_index(datasets, TEMPLATES), encoding="utf-8")
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
    assert len(sizes) == len(FIGURE_NAMES)
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
    assert browser.find_elements("tag name", "script") == []


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


def test_prints_to_pages(browser, report):
    visit(browser, report)
    pdf = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {})["data"])
    assert pdf.startswith(b"%PDF")
    assert 5 <= pdf.count(b"/Type /Page\n") <= 14
