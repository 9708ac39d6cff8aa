"""A long recording makes a page that can still be sent and opened."""

import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest

from evopem.figures.style import thin_table
from evopem.report.figures import inline_svg, short_path
from evopem.results.layout import FIGURES
from evopem.signals.preparation import prepare
from evopem.synthesis import synthesize

SAMPLES = 250_000


class Links(HTMLParser):
    def __init__(self, html):
        super().__init__()
        self.saved = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        if tag == "a" and "download" in dict(attrs):
            self.saved.append(dict(attrs)["href"])


def repeated(table, rows):
    """The table again and again to so many rows, over its first numbers as they would go on."""
    longer = table.iloc[np.arange(rows) % len(table)].reset_index(drop=True)
    first = table.select_dtypes("number").columns[0]
    return longer.assign(**{first: np.linspace(0, table[first].iloc[-1], rows)})


@pytest.fixture(scope="module")
def long_results(results):
    """Results with the signals and tables of a long recording."""
    settings = results.settings
    source = replace(settings.source, samples=SAMPLES)
    split = replace(settings.preparation.split, estimation=0.8)
    preparation = replace(settings.preparation, split=split)
    recording, _ = synthesize(source, preparation.transforms)
    tables = results.validation_tables
    simulation = repeated(tables.simulation, SAMPLES // 5)
    simulation["time_s"] = np.arange(len(simulation)) / recording.sampling_rate
    simulation.loc[12_345, f"output_{results.model.output_names[0]}"] = 99.0
    return replace(
        results,
        recording=recording,
        prepared=prepare(recording, preparation),
        spectrum=repeated(results.spectrum, 2**16 + 1),
        frequency_response=repeated(results.frequency_response, 2**16 + 1),
        validation_tables=replace(tables, simulation=simulation),
    )


@pytest.fixture(scope="module")
def long_page(build, draw, long_results):
    return build(long_results, draw(long_results, "record", "spectrum", "simulation"))


def test_the_page_stays_below_5_mb(long_page):
    assert len(long_page.encode()) < 5_000_000


def test_thinned_numbers_say_so_and_keep_the_extremes(long_page, long_results):
    links = dict(zip(FIGURES, Links(long_page).saved, strict=True))
    tables = {
        name: pd.read_csv(io.StringIO(unquote(link.partition(",")[2])))
        for name, link in links.items()
    }
    assert max(map(len, tables.values())) <= 5000
    # Recording, spectrum, frequency response, and both simulations.
    assert long_page.count("all extremes kept") == 5
    assert f" of {SAMPLES // 5:,}, all extremes kept".replace(",", "\u202f", 1) in long_page
    whole = long_results.validation_tables.simulation
    for column in ("output", "simulated", "predicted"):
        thinned = tables["simulation"][f"{column}_{long_results.model.output_names[0]}"]
        of_page = whole[f"{column}_{long_results.model.output_names[0]}"]
        assert thinned.max() == pytest.approx(of_page.max(), rel=1e-5)
        assert thinned.min() == pytest.approx(of_page.min(), rel=1e-5)
    assert tables["simulation"][f"output_{long_results.model.output_names[0]}"].max() == 99.0


def test_short_tables_are_whole():
    table = pd.DataFrame({"x": range(30), "y": range(30)})
    assert thin_table(table, 30) is table


def test_long_tables_keep_their_order_and_lie_below_the_limit():
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"x": np.arange(1001.0), "y": rng.normal(size=1001), "word": "as it is"})
    thin = thin_table(table, 1000)
    assert 100 < len(thin) <= 1000
    assert thin["x"].is_monotonic_increasing
    assert thin["y"].max() == table["y"].max()
    assert thin["y"].min() == table["y"].min()


def points_of(path):
    """The points of a path of moves, and of lines that are relative to the point before."""
    points = []
    for command, numbers in re.findall(r"([Ml])([^Mlz]*)", path):
        pairs = np.array(re.findall(r"-?[\d.]+", numbers), dtype=float).reshape(-1, 2)
        for pair in pairs:
            points.append(pair if command == "M" else points[-1] + pair)
    return np.array(points)


def test_a_drawing_in_the_page_is_half_as_long_and_keeps_its_points(figures):
    paths = re.findall(r' d="([^"]*L[^"]*)"', figures["spectrum"])
    for path in paths:
        if not set(re.findall("[A-Za-z]", path)) - set("MLz"):
            whole = np.array(re.findall(r"-?[\d.]+", path), dtype=float).reshape(-1, 2)
            np.testing.assert_allclose(points_of(short_path(path)), whole, atol=0.0501)
    assert short_path("M1.26 2.5L3 -4L3.04 -4zM5 6L7 8z") == "M1.3 2.5l1.7-6.5 0 0zM5 6l2 2z"
    drawn = inline_svg(figures["spectrum"], "spectrum", "Spectrum")
    assert len(drawn) < 0.5 * len(figures["spectrum"])
    assert drawn.count("<path") == figures["spectrum"].count("<path")
