"""The report of the identified data set, and how to build it from changed results."""

from pathlib import Path

import pytest
from browsing import (
    browser,
    comparison,
    hostile,
    index,
    report,
    setups,
    several,
    summary,
    thousand,
)

from evopem.figures import CHARTS, svg_texts
from evopem.figures.draw import draw as drawn_chart
from evopem.figures.style import svg_text
from evopem.report.page import build_report

__all__ = [
    "browser",
    "comparison",
    "hostile",
    "index",
    "report",
    "setups",
    "several",
    "summary",
    "thousand",
]


@pytest.fixture(scope="session")
def results(identified):
    return identified.results


@pytest.fixture(scope="session")
def figures(results):
    return svg_texts(results)


@pytest.fixture(scope="session")
def draw(figures):
    """Function that draws some of the figures anew from other results: SVG texts of all by name."""

    def drawn(results, *names):
        anew = {name: svg_text(drawn_chart(CHARTS[name](results))) for name in names}
        return figures | anew

    return drawn


@pytest.fixture(scope="session")
def config_text(identified):
    return Path(identified.files.config).read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def build(figures, config_text):
    """Function that builds the report of results, with the figures of the fixture by default."""

    def built(results, figures=figures, wall_clock=None, **options):
        return build_report(results, figures, wall_clock or {}, config_text, **options)

    return built


@pytest.fixture(scope="session")
def html(build, results):
    return build(results)
