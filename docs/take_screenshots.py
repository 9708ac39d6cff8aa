"""Take the README's screenshots of a report: `python docs/take_screenshots.py REPORT`.

With a name after it, the beginning of the report alone, as that picture: REPORT clipped.png.

Needs Chromium with its driver, and selenium and pillow from the development environment.
"""

import base64
import io
import shutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from PIL import Image
from selenium import webdriver

# File, colour scheme, and the elements that the picture spans.
PICTURES = (
    ("report.png", "light", "header.page", '[aria-label="Modes"]'),
    ("report-dark.png", "dark", "#poles_zeros", "#stabilization"),
)
WIDTH = 1280
SHARPNESS = 1.5  # pixels of the picture for one of the page
COLOURS = 128


def main(report: Path, folder: Path, pictures: Iterable[tuple[str, str, str, str]]) -> None:
    """Write pictures of a report into a folder."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("chromium-browser") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    with webdriver.Chrome(options=options, service=service) as browser:
        for name, scheme, first, last in pictures:
            picture = take(browser, report, scheme, first, last)
            # Few colours, not dithered: flat areas and text stay crisp and the file small.
            small = picture.convert("RGB").quantize(
                COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
            )
            small.save(folder / name, optimize=True)
            print(folder / name, f"{(folder / name).stat().st_size // 1000} kB")


def take(
    browser: webdriver.Chrome, report: Path, scheme: str, first: str, last: str
) -> Image.Image:
    """Picture what lies between two elements, both included."""
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": scheme}]},
    )
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": WIDTH, "height": 1000, "deviceScaleFactor": SHARPNESS, "mobile": False},
    )
    browser.get(report.resolve().as_uri())
    # Figures are drawn when they come near the screen.
    browser.execute_script("document.querySelector(arguments[0]).scrollIntoView()", first)
    time.sleep(1)
    top, bottom = browser.execute_script(
        """const edges = arguments[0].map(s => document.querySelector(s).getBoundingClientRect());
        return [edges[0].top + scrollY, edges[1].bottom + scrollY]""",
        [first, last],
    )
    area = {"x": 0, "y": max(top - 16, 0), "width": WIDTH, "height": bottom - top + 28, "scale": 1}
    shot = browser.execute_cdp_cmd(
        "Page.captureScreenshot", {"captureBeyondViewport": True, "clip": area}
    )
    return Image.open(io.BytesIO(base64.b64decode(shot["data"])))


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    beginning = [(name, *PICTURES[0][1:]) for name in sys.argv[2:]]
    main(Path(sys.argv[1]), Path(__file__).parent, beginning or PICTURES)
