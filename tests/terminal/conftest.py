"""A recording on disk, and settings with which its identification takes a second."""

import numpy as np
import pytest
import yaml

from evopem.synthesis import armax

SMALL = {
    "recipe": "chapter",
    "split": {"discard": 20},
    "spectrum": {"nfft": 512},
    "transforms": {"box_cox": "none", "difference": 0},
    "delay": {"orders": [3, 3], "nk": [2, 3]},
    "orders": {"plant": [3, 4], "nc": [2, 3], "nb": [3, 3]},
    "search": {"mu": 3, "lambda": 6, "nu": 2, "evaluations": 50, "n_initial_discard": 20},
}


def write_recording(folder):
    """Write data.csv (time, u, y at 100 Hz) and small.yaml."""
    recording, _ = armax(seed=1, samples=600)
    time = np.arange(recording.samples) / 100.0
    table = np.column_stack([time, recording.input, recording.output])
    np.savetxt(folder / "data.csv", table, delimiter=",", header="time,u,y", comments="")
    (folder / "small.yaml").write_text(yaml.safe_dump({"defaults": SMALL}))
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a recording and settings."""
    monkeypatch.chdir(write_recording(tmp_path))
    return tmp_path
