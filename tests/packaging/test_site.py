"""The built documentation opens from disk: its search, too, asks no server."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / "report"), str(ROOT / "docs")]
from browsing import (  # noqa: E402
    MOST_WORDS,
    browser,  # noqa: F401
    needs_axe,
    needs_chromium,
    open_everything,
    violations,
    visit,
    words_at_first,
)

INDEX = ROOT / "site" / "index.html"
GALLERY = ROOT / "docs" / "gallery"
REPORTS = ("motor_bench", "clipped", "beam", "beam_outputs")
in_the_gallery = pytest.mark.skipif(
    not (GALLERY / "index.txt").exists(), reason="docs/gallery is missing: make docs makes it"
)

SEARCH = """
const field = document.querySelector("input.md-search__input");
field.focus();
field.value = "certificate";
field.dispatchEvent(new Event("input", {bubbles: true}));
field.dispatchEvent(new KeyboardEvent("keyup", {bubbles: true}));
"""


@needs_chromium
@pytest.mark.skipif(not INDEX.exists(), reason="site/ is missing: make docs builds it")
def test_a_page_that_is_opened_from_disk_is_searched(browser):  # noqa: F811
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    visit(browser, INDEX)
    browser.execute_script(SEARCH)
    items = (By.CSS_SELECTOR, ".md-search-result__item")
    WebDriverWait(browser, 60).until(lambda driver: driver.find_elements(*items))
    assert "https://" not in "".join(
        script.get_attribute("src") or "" for script in browser.find_elements(By.TAG_NAME, "script")
    )


@needs_chromium
@needs_axe
@in_the_gallery
@pytest.mark.parametrize(("width", "scheme"), [(360, "dark"), (2560, "light")])
@pytest.mark.parametrize("name", [*REPORTS, "fleet/index", "compared"])
def test_pages_of_every_kind_fit_and_are_accessible(browser, name, width, scheme):  # noqa: F811
    visit(browser, GALLERY / f"{name}.html", width, scheme)
    open_everything(browser)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    assert violations(browser)[0] == []


@needs_chromium
@in_the_gallery
@pytest.mark.parametrize("name", REPORTS)
def test_reports_are_short_and_small_and_their_figures_alive(browser, name):  # noqa: F811
    file = GALLERY / f"{name}.html"
    assert file.stat().st_size < 3_000_000
    visit(browser, file)
    still = browser.execute_async_script(
        """document.querySelectorAll("details").forEach(d => d.open = true);
        const figures = [...document.querySelectorAll("figure[data-name]")];
        const next = () => {
            if (!figures.length) return arguments[0]([...document.querySelectorAll(
                "figure[data-name]:not(.is-live)")].map(figure => figure.dataset.name));
            figures.shift().scrollIntoView();
            setTimeout(next, 100);
        };
        next();"""
    )
    assert still == []
    visit(browser, file)
    assert 100 < len(words_at_first(browser)) <= MOST_WORDS


@needs_chromium
@in_the_gallery
def test_the_picture_of_the_readme_shows_the_words_of_today_s_report(browser):  # noqa: F811
    from PIL import Image
    from take_screenshots import PICTURE, words_of

    with Image.open(PICTURE) as picture:
        assert picture.text["Description"] == words_of(browser), "run make screenshots"
