"""The archive of all results that `snakemake --report` packs."""

import re
import zipfile

import pytest

from evopem.results.layout import FIGURES

TABLES = {"candidates.csv", "modes.csv", "spectrum.csv"}
MODEL = {"model.json", "validation.json"}


@pytest.fixture(scope="module")
def archive(finished, tmp_path_factory):
    folder = finished.copied(tmp_path_factory.mktemp("archive") / "copy")
    folder.finish("--report", "archive.zip")
    with zipfile.ZipFile(folder.path / "archive.zip") as packed:
        yield packed


def test_every_figure_table_and_the_report_are_packed(archive):
    names = {name.rpartition("/")[2] for name in archive.namelist() if "/data/raw/" in name}
    assert names == {f"{figure}.svg" for figure in FIGURES} | TABLES | MODEL | {"report.html"}


def test_each_has_its_place_and_a_caption(archive):
    (page,) = [name for name in archive.namelist() if name.count("/") == 1]
    html = archive.read(page).decode()
    for category in ("Figures", "Tables", "Model", "Report"):
        assert f'"{category}"' in html
    for figure in FIGURES:
        assert figure.replace("_", " ") in html
    # Captions come as HTML, with the data set's name put in; what a figure shows is a label of it.
    assert html.count("truth: a figure of its report") == len(FIGURES)
    shown = re.findall(r'"shows": *"([^"]+)"', html)
    assert len(set(shown)) == len(FIGURES)
    assert "G in the complex plane, and the estimate from the data." in shown
    assert "{{" not in "".join(shown)
