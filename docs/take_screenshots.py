"""Take the README's picture of a report: `python docs/take_screenshots.py`, after `make docs`.

Needs Chromium with its driver, and selenium and pillow from the development environment.
"""

import base64
import io
import re
import shutil
import time
from pathlib import Path

from PIL import Image, PngImagePlugin
from selenium import webdriver

DOCS = Path(__file__).resolve().parent
REPORT = DOCS / "gallery" / "motor_bench.html"
PICTURE = DOCS / "report.png"
WIDTH = 1280
SHARPNESS = 1.5  # pixels of the picture for one of the page
COLOURS = 128
LAST = ".first-figures"  # what the picture ends with


def main() -> None:
    """Write the picture, with the words that it shows."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("chromium-browser") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    with webdriver.Chrome(options=options, service=service) as browser:
        words = words_of(browser)
        picture = take(browser)
    # Few colours, not dithered: flat areas and text stay crisp and the file small.
    small = picture.convert("RGB").quantize(
        COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    text = PngImagePlugin.PngInfo()
    text.add_itxt("Description", words)
    small.save(PICTURE, optimize=True, pnginfo=text)


def words_of(browser: webdriver.Chrome) -> str:
    """The words of the report's beginning, by which a test finds the picture old."""
    browser.get(REPORT.as_uri())
    shown = browser.execute_script(
        """const names = "header.page, .verdict, .answer, .uses, .reservation, #summary table";
        return [...document.querySelectorAll(names)].map(each => each.textContent).join(" ")"""
    )
    # Numbers may differ in their last digit between processors.
    return " ".join(re.findall(r"[A-Za-z]{2,}", shown))


def take(browser: webdriver.Chrome) -> Image.Image:
    """Picture the report from its top."""
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": WIDTH, "height": 1000, "deviceScaleFactor": SHARPNESS, "mobile": False},
    )
    browser.get(REPORT.as_uri())
    time.sleep(1)  # figures are drawn when they come near the screen
    bottom = browser.execute_script(
        "return document.querySelector(arguments[0]).getBoundingClientRect().bottom", LAST
    )
    area = {"x": 0, "y": 0, "width": WIDTH, "height": bottom + 2, "scale": 1}
    shot = browser.execute_cdp_cmd(
        "Page.captureScreenshot", {"captureBeyondViewport": True, "clip": area}
    )
    return Image.open(io.BytesIO(base64.b64decode(shot["data"])))


if __name__ == "__main__":
    main()
