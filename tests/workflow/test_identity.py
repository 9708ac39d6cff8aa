"""Identity by content: a replaced recording runs again, and no recording validates itself."""

import os
import shutil

import numpy as np
import pytest

from .conftest import Folder, jobs_of_each_rule

ANALYSIS = {
    "recipe": "chapter",
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
    "delay": {"orders": [3, 3], "nk": [2, 3]},
    "orders": {"plant": [3, 4], "nc": [2, 3], "nb": [3, 3]},
}
RATE = {"sampling_rate": 100}
FIRST_STAGES = ("--cores", "1", "--until", "prepare")


def samples(seed):
    rows = np.random.default_rng(seed).standard_normal((900, 2))
    return "\n".join(f"{u:.9g},{y:.9g}" for u, y in rows)


def configure(folder, **datasets):
    folder.configure({"defaults": ANALYSIS, "datasets": datasets})


@pytest.fixture(scope="module")
def once_prepared(tmp_path_factory):
    """Two data sets of which one has a recording of its own for validation; nobody changes them."""
    folder = Folder(tmp_path_factory.mktemp("prepared"))
    for seed, name in enumerate(["x.csv", "v.csv", "other.csv"]):
        (folder.path / name).write_text(samples(seed))
    configure(
        folder,
        a={"file": "x.csv", "validation_file": "v.csv", **RATE},
        b={"file": "other.csv", **RATE},
    )
    folder.finish(*FIRST_STAGES)
    return folder


@pytest.fixture
def prepared(once_prepared, tmp_path):
    return once_prepared.copied(tmp_path / "copy")


def older_file(folder, text):
    path = folder.path / "older"
    path.write_text(text)
    os.utime(path, (10**9, 10**9))
    return path


def test_a_recording_replaced_by_an_older_file_runs_again_once(prepared):
    shutil.move(older_file(prepared, samples(7)), prepared.path / "x.csv")
    plan = prepared.planned(*FIRST_STAGES)
    assert plan == {"read_recording": 1, "prepare": 1}
    shutil.move(older_file(prepared, samples(8)), prepared.path / "v.csv")
    printed = prepared.finish(*FIRST_STAGES)
    assert jobs_of_each_rule(printed) == plan
    assert prepared.planned(*FIRST_STAGES) == {}


def test_equal_content_runs_nothing(prepared):
    """Neither of a copy that is older nor of a file that was touched."""
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


def test_a_copy_of_the_estimation_recording_or_of_a_part_of_it_does_not_validate(folder):
    lines = samples(0).splitlines()
    for name, rows in (("x", lines), ("whole", lines), ("part", lines[200:])):
        (folder.path / f"{name}.csv").write_text("\n".join(rows))
    names = ("whole", "part")
    datasets = {n: {"file": "x.csv", "validation_file": f"{n}.csv", **RATE} for n in names}
    configure(folder, **datasets)
    run = folder.run(*FIRST_STAGES)
    assert run.returncode != 0
    assert 'File "' not in run.stdout
    for name in names:
        (said,) = {
            line for line in run.stdout.splitlines() if line.startswith(f"datasets.{name}.valid")
        }
        assert "estimation recording" in said
        assert not (folder.results / name / "prepared.npz").exists()
