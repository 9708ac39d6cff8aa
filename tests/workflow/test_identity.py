"""Identity by content: a replaced recording runs again, and no recording validates itself."""

import os
import shutil

import numpy as np
import pytest

ANALYSIS = {
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
    "delay": {"orders": [3, 3], "nk": [2, 3]},
    "orders": {"joint": [3, 4], "nc": [2, 3], "nb": [3, 3]},
}
RATE = {"sampling_rate": 100}
FIRST_STAGES = ("--cores", "1", "--until", "prepare_signals")


def samples(seed):
    rows = np.random.default_rng(seed).standard_normal((900, 2))
    return "\n".join(f"{u:.9g},{y:.9g}" for u, y in rows)


def configure(folder, **datasets):
    folder.configure({"defaults": ANALYSIS, "datasets": datasets})


@pytest.fixture
def prepared(folder):
    """Two data sets of which one has a recording of its own for validation."""
    for seed, name in enumerate(["x.csv", "v.csv", "other.csv"]):
        (folder.path / name).write_text(samples(seed))
    configure(
        folder,
        a={"file": "x.csv", "validation_file": "v.csv", **RATE},
        b={"file": "other.csv", **RATE},
    )
    folder.finish(*FIRST_STAGES)
    return folder


def older_file(folder, text):
    path = folder.path / "older"
    path.write_text(text)
    os.utime(path, (10**9, 10**9))
    return path


def test_nothing_runs_again_where_nothing_changed(prepared):
    assert prepared.planned(*FIRST_STAGES) == {}


@pytest.mark.parametrize(
    ("path", "rule"), [("x.csv", "read_recording"), ("v.csv", "read_validation_recording")]
)
def test_a_recording_replaced_by_an_older_file_runs_again_once(prepared, path, rule):
    shutil.move(older_file(prepared, samples(7)), prepared.path / path)
    plan = prepared.planned(*FIRST_STAGES)
    assert plan == {rule: 1, "prepare_signals": 1}
    assert prepared.planned(*FIRST_STAGES) == plan
    prepared.finish(*FIRST_STAGES)
    assert prepared.planned(*FIRST_STAGES) == {}


def test_a_copy_of_equal_content_runs_nothing(prepared):
    shutil.move(older_file(prepared, samples(0)), prepared.path / "x.csv")
    (prepared.path / "other.csv").touch()
    assert prepared.planned(*FIRST_STAGES) == {}


def test_another_file_that_is_missing_is_named_and_stops_no_other_data_set(prepared):
    """The results of the file before are not those of the one that is named now."""
    configure(
        prepared,
        a={"file": "x.csv", "validation_file": "typo.csv", **RATE},
        b={"file": "typing.csv", **RATE},
        c={"file": "x.csv", **RATE},
    )
    run = prepared.run(*FIRST_STAGES)
    assert run.returncode != 0
    for path in ("typo.csv", "typing.csv"):
        assert f"{path}: there is no such file; " in run.stdout
    assert "Traceback" not in run.stdout
    assert 'File "' not in run.stdout
    assert (prepared.results / "c" / "prepared.npz").exists()


@pytest.mark.parametrize("rows", [slice(None), slice(200, None)])
def test_a_copy_of_the_estimation_recording_or_of_a_part_of_it_does_not_validate(folder, rows):
    lines = samples(0).splitlines()
    (folder.path / "x.csv").write_text("\n".join(lines))
    (folder.path / "copy.csv").write_text("\n".join(lines[rows]))
    configure(folder, a={"file": "x.csv", "validation_file": "copy.csv", **RATE})
    run = folder.run(*FIRST_STAGES)
    assert run.returncode != 0
    assert "datasets.a.validation_file: " in run.stdout
    assert "estimation recording" in run.stdout
    assert 'File "' not in run.stdout
    assert not (folder.results / "a" / "prepared.npz").exists()
