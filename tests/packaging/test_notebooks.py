"""The example notebooks run from top to bottom and show what they were stored with."""

import os
import re
import shutil
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient", reason="no kernel to run notebooks in")
pytest.importorskip("ipykernel", reason="no kernel to run notebooks in")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
PICTURES = {"motor_bench": 5, "structures": 2}
COMPILING = "evopem: compiling the numerical kernels"
# Reports without drawings, which are those of tests/notebook.
UNDRAWN = """
import evopem.figures
from evopem.results.layout import FIGURES
evopem.figures.svg_texts = lambda _: dict.fromkeys(FIGURES, "<svg/>")
"""


def texts(notebook):
    """First line of every cell's last textual output, numbers left out."""
    shown = []
    for cell in notebook.cells:
        outputs = [each.get("data", {}) for each in cell.get("outputs", [])]
        plain = [data["text/plain"] for data in outputs if data.get("text/plain")]
        shown.append(re.sub(r"[\d.,−±()]+", "#", plain[-1].splitlines()[0]) if plain else "")
    return shown


def counted(notebook):
    """Pictures, and messages in the red box of standard error, but of kernels compiled first."""
    outputs = [each for cell in notebook.cells for each in cell.get("outputs", [])]
    pictures = sum("image/png" in each.get("data", {}) for each in outputs)
    said = [each.text.splitlines() for each in outputs if each.get("name") == "stderr"]
    return pictures, sum(not line.startswith(COMPILING) for lines in said for line in lines)


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda each: each.stem)
def test_a_notebook_runs_and_shows_what_was_stored(file, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    scripts = str(ROOT / "workflow" / "scripts")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([scripts, os.environ.get("PYTHONPATH", "")]))
    stored = nbformat.read(file, as_version=4)
    fresh = nbformat.read(file, as_version=4)
    first = next(cell for cell in fresh.cells if cell.cell_type == "code")
    first.source = UNDRAWN + first.source
    folder = tmp_path / "examples" / "notebooks"
    client = nbclient.NotebookClient(
        fresh, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    assert texts(fresh) == texts(stored)
    assert counted(fresh) == counted(stored) == (PICTURES[file.stem], 0)


def test_the_notebooks_are_there():
    assert [each.stem for each in NOTEBOOKS] == ["motor_bench", "structures"]
