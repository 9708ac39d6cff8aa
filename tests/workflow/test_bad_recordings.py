"""Recordings that cannot be used: one sentence each, and nothing left behind."""

import numpy as np
import pytest

from .conftest import TINY

pytestmark = pytest.mark.xdist_group("workflow")

RNG = np.random.default_rng(0)
GOOD = RNG.standard_normal((900, 2))

SOURCE = {
    "sampling_rate": 100,
    "stationarity": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}


def text(rows, separator=","):
    return "\n".join(separator.join(f"{value:.9g}" for value in row) for row in rows)


def with_line(number, line):
    lines = text(GOOD).splitlines()
    lines[number - 1] = line
    return "\n".join(lines)


BAD = {
    "missing.csv": (None, "missing.csv: there is no such file"),
    "empty.csv": ("", "empty.csv: the file is empty"),
    "words.csv": (with_line(40, "0.5,high"), 'words.csv, line 40, column 2: "high" is not'),
    "ragged.csv": (with_line(70, "0.5"), "ragged.csv, line 70: the row has 1 fields"),
    "gaps.csv": (with_line(80, "0.5,nan"), 'gaps.csv, line 80, column 2: "nan" is not'),
    "binary.csv": (bytes(range(256)) * 9, "binary.csv, line 1: is not a text file"),
    "flat.csv": (text(GOOD * [1, 0] + [0, 3]), "flat.csv"),
    "huge.csv": (text(GOOD * 1e300), "leaves the range of numbers"),
    "short.csv": (text(GOOD[:38]), "ARMAX("),
    "damaged.mat": (b"MATLAB 5.0 MAT-file" + bytes(300), "damaged.mat: is not a readable MATLAB"),
    "program.exe": (b"MZ", "program.exe"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_recording_gets_one_sentence(folder, name):
    content, sentence = BAD[name]
    if content is not None:
        mode = "wb" if isinstance(content, bytes) else "w"
        with (folder.path / name).open(mode) as file:
            file.write(content)
    folder.configure({**TINY, "datasets": {"bad": {"file": name, **SOURCE}}})
    run = folder.run("--cores", "1")
    assert run.returncode != 0
    assert sentence in run.stdout
    assert "Traceback" not in run.stdout
    assert not (folder.results / "bad" / "model.json").exists()
    assert not (folder.results / "bad" / "report.html").exists()


def test_the_other_data_sets_go_on(folder):
    (folder.path / "good.csv").write_text(text(GOOD))
    datasets = {
        "bad": {"file": "absent.csv", **SOURCE},
        "good": {"file": "good.csv", **SOURCE},
    }
    folder.configure({**TINY, "datasets": datasets})
    run = folder.run("--cores", "1")
    assert run.returncode != 0
    assert "absent.csv: there is no such file" in run.stdout
    assert (folder.results / "good" / "report.html").exists()


def test_a_recording_that_was_read_before_and_is_gone_costs_nothing(folder):
    (folder.path / "good.csv").write_text(text(GOOD))
    folder.configure({**TINY, "datasets": {"one": {"file": "good.csv", **SOURCE}}})
    folder.finish("--cores", "1")
    before = (folder.results / "one" / "model.json").read_bytes()
    (folder.path / "good.csv").unlink()
    folder.run("--cores", "1")
    assert (folder.results / "one" / "model.json").read_bytes() == before
