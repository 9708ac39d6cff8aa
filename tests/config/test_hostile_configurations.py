"""Configurations that would stop a run, delete a file or mislead: one sentence each, quickly."""

import datetime
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def refusal(config):
    before = time.process_time()
    with pytest.raises(InputError) as caught:
        complete(config)
    assert time.process_time() - before < 5
    sentence = str(caught.value)
    assert re.fullmatch(r"config\.yaml.*: .+; .+\.", sentence)
    assert len(sentence) < 2000
    return sentence


def with_file(file, **more):
    return {"datasets": {"a": {"file": file, **more}}}


SYNTHETIC = {"synthesis": "armax"}


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("x" * 260, "has 260 characters"),
        ("x-" * 120, "has 240 characters"),
        ("run_" + "0" * 20, "ends in 20 equal parts"),
        ("ab" * 20, "ends in 20 equal parts"),
        ("fleet.csv", "is the name of something else"),
        ("Fleet.Parquet", "is the name of something else"),
        ("index.html", "is the name of something else"),
        ("checksums", "is the name of something else"),
        ("con", "cannot be the name of a folder everywhere"),
        ("LPT1.txt", "cannot be the name of a folder everywhere"),
        ("..", "cannot be the name of a folder everywhere"),
        (".hidden", "cannot be the name of a folder everywhere"),
        ("a/b", "cannot be the name of a folder everywhere"),
        ("Größe", "cannot be the name of a folder everywhere"),
        ("a\n", "cannot be the name of a folder everywhere"),
        ("", "cannot be the name of a folder everywhere"),
        ("a\0", "U+0000 is no text"),
        ("\ud800", "U+D800 is no text"),
    ],
)
def test_a_name_that_no_folder_or_wildcard_can_have(name, said):
    assert said in refusal({"datasets": {name: SYNTHETIC}})


@pytest.mark.parametrize("name", ["xy-2" * 18, "run_" + "0" * 19, "a.csv", "2024-01-31", "console"])
def test_a_name_at_the_limit_is_accepted(name):
    assert list(complete({"datasets": {name: SYNTHETIC}}).datasets) == [name]


@pytest.mark.parametrize(
    "path",
    [
        "results/a/simulation.csv",
        "./results/a/simulation.csv",
        "data/../results/a/simulation.csv",
        "results//a/simulation.csv",
        "results/A/simulation.csv",
        "results/a/deep/below.csv",
        "results/b/simulation.csv",
        "results/fleet.csv",
        "results/logs/fleet.log",
        "results",
        "ABSOLUTE",
        "link/a/simulation.csv",
        "linked.csv",
    ],
)
@pytest.mark.parametrize("key", ["file", "validation_file"])
def test_a_result_is_no_recording(tmp_path, path, key):
    """Snakemake deletes the outputs of a job before it runs."""
    Path("results").mkdir()
    Path("link").symlink_to("results")
    Path("linked.csv").symlink_to("results/a/simulation.csv")
    path = str(tmp_path / "results" / "a" / "x.csv") if path == "ABSOLUTE" else path
    entry = {"file": "x.csv", key: path}
    sentence = refusal({"datasets": {"a": entry, "b": SYNTHETIC}})
    assert f"datasets.a.{key}: {path} is a result of this workflow" in sentence


@pytest.mark.parametrize("path", ["results/other/x.csv", "results.csv", "old/results/a/x.csv"])
def test_other_folders_hold_recordings(path):
    assert complete(with_file(path)).datasets["a"].source.files == (path,)


@pytest.mark.parametrize("other", ["x.csv", "./x.csv", "d/../x.csv", "ABSOLUTE", "soft", "hard"])
def test_a_recording_does_not_validate_itself(tmp_path, other):
    Path("x.csv").write_text("1,2\n")
    Path("d").mkdir()
    Path("soft").symlink_to("x.csv")
    os.link("x.csv", "hard")
    other = str(tmp_path / "x.csv") if other == "ABSOLUTE" else other
    sentence = refusal(with_file("x.csv", validation_file=other))
    assert f"datasets.a.validation_file: {other} is also the estimation file" in sentence


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("x\0.csv", "U+0000 is no text"),
        ("\ud800.csv", "U+D800 is no text"),
        ("x\n.csv", "there is a line break"),
        ("{dataset}.csv", "the braces in"),
        ("", "there is nothing in it"),
        (3, "3 cannot be used"),
        ([["x.csv"]], "cannot be used"),
        (datetime.date(2024, 1, 31), "2024-01-31' cannot be used"),
    ],
)
def test_a_path_that_cannot_be_one(file, said):
    assert said in refusal(with_file(file))


def test_a_path_that_the_file_system_refuses_is_for_its_job_to_refuse():
    """The other data sets are not stopped."""
    long = "x" * 300 + ".csv"
    assert complete(with_file(long, validation_file="y.csv")).datasets["a"].source.files


def itself():
    entry = {"file": "x.csv"}
    entry["split"] = entry
    return entry


def nested(depth):
    value = 1
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (itself(), "nested more than 20 levels"),
        ({"file": "x.csv", "delay": {"nk": nested(900)}}, "nested more than 20 levels"),
        ({"file": "x.csv", "sampling_rate": 10**400}, "the number is beyond 2e+19"),
        ({"file": "x.csv", "sampling_rate": -(10**400)}, "the number is beyond 2e+19"),
        ({"file": "x.csv", "sampling_rate": int("7" * 4000)}, "the number is beyond"),
        ({"file": "x.csv", "sampling_rate": 1e308}, "the number is beyond"),
        ({"file": "x.csv", "sampling_rate": 1e13}, "is above"),
        ({"file": "x.csv", "sampling_rate": 1.0e-320}, "is below"),
        ({"file": "x.csv", "resample": 1.0e-320}, "is below"),
        ({"file": "x.csv", "sampling_rate": float("inf")}, "not a finite number"),
        ({"file": "x.csv", "sampling_rate": True}, "true cannot be used"),
        ({"file": "x.csv", "sampling_rate": "0100"}, "cannot be used"),
        ({"file": "x.csv", "sampling_rate": b"1"}, "cannot be used"),
        ({"file": "x.csv", "input": 2.5}, "2.5 cannot be used"),
        ({"file": "x.csv", "input": datetime.datetime(2024, 1, 31)}, "cannot be used"),
        ({"file": "x.csv", "input_unit": "\ud800"}, "U+D800 is no text"),
        ({"file": "x.csv", "input_unit": {1, 2}}, "cannot be used"),
        ({"file": "x.csv", "orders": {"plant": "auto\n"}}, "is not known"),
        ({"file": "x.csv", 7: 1}, "the key 7 is not text"),
        ({"file": "x.csv", "k" * 100_000: 1}, "has 100000 characters"),
        ({"file": "x.csv", "spectrum": {"nfft": 2**40}}, "is above"),
        ({"file": "x.csv", "spectrum": {"time_halfbandwidth": 1e9}}, "is above"),
        ({"file": "x.csv", "search": {"lambda": 10**9}}, "is above"),
        ({"file": "x.csv", "search": {"evaluations": 2**64}}, "is above"),
        ({"file": "x.csv", "transforms": {"box_cox": 1e9}}, "is above"),
        ({"file": "x.csv", "input": "none", "output": ["none"]}, "there is no output"),
        (None, "there is no value"),
        ([], "cannot be used"),
        ("x.csv", "cannot be used"),
    ],
)
def test_a_value_that_no_key_can_mean(entry, said):
    sentence = refusal({"datasets": {"a": entry}})
    assert said in sentence
    assert "datasets.a" in sentence


@pytest.mark.parametrize(
    "config",
    [
        {"datasets": {}},
        {"datasets": []},
        {"datasets": 3},
        {"datasets": {"a": SYNTHETIC}, "shard": "1/2\n"},
        {"datasets": {"a": SYNTHETIC}, "shard": "3/2"},
        {"datasets": {"a": SYNTHETIC}, "candidates_per_job": "auto\n"},
        {"datasets": {"a": SYNTHETIC}, "report": None},
        {"datasets": {None: SYNTHETIC}},
        {"datasets": {True: SYNTHETIC}},
        {"datasets": {1: SYNTHETIC}, "defaults": {"delay": []}},
        {"datasets": {"*": {"file": "\0*"}}},
        {"datasets": {"*": {"file": "\ud800*"}}},
        {"datasets": {"*": {"file": "x" * 300 + "*"}}},
    ],
)
def test_a_configuration_of_another_form(config):
    refusal(config)


@pytest.mark.parametrize("path", ["", "  "])
def test_an_empty_path_of_a_table_is_named_by_its_key(path):
    assert refusal({"datasets": path}).startswith(f"config.yaml, datasets: {path!r}: ")


def test_three_thousand_files_are_checked_in_seconds():
    files = {
        f"r{n}": {"file": f"data/{n}.csv", "validation_file": f"v/{n}.csv"} for n in range(3_000)
    }
    before = time.process_time()
    complete({"datasets": files})
    assert time.process_time() - before < 3


@pytest.mark.parametrize("place", ["file", "datasets"])
def test_a_locale_without_the_letters_of_a_path_is_named(place):
    """Python cannot open such a path there; Snakemake would say that it is missing."""
    config = {"datasets": "Größe.csv"} if place == "datasets" else with_file("Größe.csv")
    code = (
        "from evopem.config.defaults import complete\n"
        f"try: complete({config!a})\n"
        "except ValueError as error: print(ascii(str(error)))\n"
    )
    environment = os.environ | {
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "PYTHONPATH": str(ROOT / "workflow" / "scripts"),
    }
    run = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "LC_ALL=C.UTF-8" in run.stdout
