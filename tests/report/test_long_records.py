"""A record of a million samples makes a page that can still be sent and opened."""

import io
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from result_files import RATE, record

from evopem.figures import FIGURE_NAMES, draw_all, result_paths
from evopem.figures.figure_data import thin_table
from evopem.report import build_report
from evopem.signals.preparation import prepare, save_prepared
from evopem.signals.recording import save_recording

TEMPLATES = Path(__file__).parents[2] / "workflow" / "templates"
SAMPLES = 1_000_000


class Links(HTMLParser):
    def __init__(self, html):
        super().__init__()
        self.saved = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        if tag == "a" and "download" in dict(attrs):
            self.saved.append(dict(attrs)["href"])


def repeated(table, rows):
    """The table again and again to so many rows, over its first column as it would go on."""
    longer = table.iloc[np.arange(rows) % len(table)].reset_index(drop=True)
    first = table.columns[0]
    return longer.assign(**{first: np.linspace(0, table[first].iloc[-1], rows)})


@pytest.fixture(scope="module")
def long_record(results, tmp_path_factory):
    directory = shutil.copytree(results, tmp_path_factory.mktemp("long") / "arm")
    recording = record(SAMPLES)
    prepared = prepare(
        recording,
        {"box_cox": "none", "difference": 0, "difference_input": 0},
        {"discard": 500, "estimation": 0.8},
    )
    save_recording(recording, directory / "recording.npz")
    save_prepared(prepared, directory / "prepared.npz", directory / "transforms.json")
    simulation = repeated(pd.read_csv(directory / "simulation.csv"), SAMPLES // 5)
    simulation["time_s"] = np.arange(len(simulation)) / RATE
    simulation.loc[123_457, "output"] = 99.0
    simulation.to_csv(directory / "simulation.csv", index=False)
    for name in ("spectrum.csv", "frequency_response.csv"):
        repeated(pd.read_csv(directory / name), 2**16 + 1).to_csv(directory / name, index=False)
    draw_all(result_paths(directory), directory / "figures")
    return build_report(result_paths(directory), TEMPLATES), directory


def test_the_page_stays_below_5_mb(long_record):
    html, _ = long_record
    assert len(html.encode()) < 5_000_000


def test_thinned_numbers_say_so_and_keep_the_extremes(long_record):
    html, directory = long_record
    links = dict(zip(FIGURE_NAMES, Links(html).saved, strict=True))
    tables = {
        name: pd.read_csv(io.StringIO(unquote(link.partition(",")[2])))
        for name, link in links.items()
    }
    assert max(map(len, tables.values())) <= 5000
    assert html.count("thinned from") == 4  # record, spectrum, frequency response, simulation
    assert f"thinned from {SAMPLES // 5:,}".replace(",", "\u202f") in html
    whole = pd.read_csv(directory / "simulation.csv")
    for column in ("output", "simulated", "prediction_error"):
        assert tables["simulation"][column].max() == pytest.approx(whole[column].max(), rel=1e-5)
        assert tables["simulation"][column].min() == pytest.approx(whole[column].min(), rel=1e-5)
    assert tables["simulation"]["output"].max() == 99.0


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
