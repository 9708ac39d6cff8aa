"""Several recordings under one name: lists, patterns, and what they cannot have."""

import os
from pathlib import Path

import pytest
import yaml

from evopem.config.defaults import complete, yaml_text
from evopem.errors import InputError

RUNS = ("run_a.csv", "run_b.csv", "run_c.csv")


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in (*RUNS, "other.csv"):
        Path(name).write_text("u,y\n")
    os.link("run_a.csv", "hard.csv")


def dataset(name="pump", **keys):
    keys = {"sampling_rate": 10, **keys}
    return complete({"datasets": {name: keys}}).datasets


def refusal(**keys):
    with pytest.raises(InputError) as caught:
        dataset(**keys)
    return str(caught.value)


@pytest.mark.parametrize("written", [list(RUNS), "run_*.csv"])
@pytest.mark.parametrize("recipe", ["auto", "chapter"])
def test_a_list_or_a_pattern_is_one_data_set(written, recipe):
    own = dataset(file=written, recipe=recipe)["pump"]
    assert own.source.files == RUNS
    again = complete(yaml.safe_load(yaml_text(own))).datasets["pump"]
    assert again == own


def test_a_pattern_under_a_name_with_a_star_is_many_data_sets():
    own = dataset("pump-*", file="run_*.csv")
    assert {name: each.source.files for name, each in own.items()} == {
        "pump-a": RUNS[:1],
        "pump-b": RUNS[1:2],
        "pump-c": RUNS[2:],
    }


@pytest.mark.parametrize("written", [list(RUNS), "run_*.csv"])
def test_recordings_of_several_channels_are_one_data_set_as_well(written):
    own = dataset(file=written, input=["u1", "u2"], output=["y_*"], validation_file="other.csv")
    assert own["pump"].source.files == RUNS
    assert own["pump"].source.validation_files == ("other.csv",)
    again = complete(yaml.safe_load(yaml_text(own["pump"]))).datasets
    assert again == own
    cut = dataset(file=written, output=["y_*"], split={"by": "samples", "estimation": 90})
    assert (cut["pump"].preparation.split.by, cut["pump"].preparation.split.estimation) == (
        "samples",
        90,
    )
    assert "by: samples" in yaml_text(cut["pump"])


def test_several_recordings_may_validate():
    own = dataset(file="run_a.csv", validation_file=["run_b.csv", "other.csv"])["pump"]
    assert own.source.validation_files == ("run_b.csv", "other.csv")
    assert own.preparation.split.estimation == 1.0


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"file": "no_*.csv"}, "file: no file matches no_*.csv; correct the pattern."),
        ({"file": ["run_a.csv"] * 2}, "file: run_a.csv stands there twice; give every"),
        (
            {"file": ["run_a.csv", "./run_a.csv"]},
            "file: ./run_a.csv stands there twice (run_a.csv)",
        ),
        ({"file": ["run_a.csv", "hard.csv"]}, "file: hard.csv stands there twice (run_a.csv)"),
        (
            {"file": "run_*.csv", "validation_file": "run_b.csv"},
            "validation_file: run_b.csv is also the estimation file; give an independent",
        ),
        ({"file": []}, "file: [] holds 0 values; give the path of a recording"),
        ({"file": ["run_a.csv", 3]}, "file[1]: 3 cannot be used; give the path of a recording."),
        (
            {"file": "run_*.csv", "split": {"estimation": 800}},
            "split.estimation: 800 is a number of samples, and whole recordings are held out;",
        ),
    ],
)
def test_what_several_recordings_cannot_be_is_refused(keys, sentence):
    assert f"datasets.pump.{sentence}" in refusal(**keys)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"file": "no_*.csv"}, "file: no file matches no_*.csv; correct the pattern."),
        ({"file": ["run_a.csv"] * 2}, "file: run_a.csv stands there twice; give every"),
        (
            {"file": "run_*.csv", "split": {"estimation": 800}},
            "split.estimation: 800 is a number of samples, and whole recordings are held out;",
        ),
    ],
)
def test_the_same_is_refused_for_several_channels(keys, sentence):
    assert f"datasets.pump.{sentence}" in refusal(output=["y_*"], **keys)


def test_each_recording_may_be_cut_at_a_number_of_samples():
    own = dataset(file="run_*.csv", split={"estimation": 800, "by": "samples"})["pump"]
    assert own.preparation.split.estimation == 800
