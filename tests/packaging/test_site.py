"""The built documentation opens from disk: its search, too, asks no server."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "report"))
from browsing import browser, needs_chromium, visit  # noqa: E402, F401

INDEX = ROOT / "site" / "index.html"

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
