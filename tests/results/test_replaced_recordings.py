"""A recorded file that was replaced by an older one is noticed, and a touched one is not."""

import json
import os
import time
from pathlib import Path

import pytest

from evopem.config.defaults import complete
from evopem.files.checksums import sha256_of_file
from evopem.results.identity import mark_replaced_recordings, was_read_from
from evopem.results.layout import DatasetFiles

BOTH = {"file": "x.csv", "validation_file": "v.csv"}


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def settings(datasets):
    return complete({"datasets": datasets}).datasets


def write_results(path, recording, info):
    Path(recording).parent.mkdir(parents=True, exist_ok=True)
    origin = {"path": path, "sha256": sha256_of_file(path), "bytes": Path(path).stat().st_size}
    Path(recording).write_bytes(b"samples")
    Path(info).write_text(json.dumps({"files": [origin]}))


@pytest.fixture
def read():
    """Both files of a data set, read."""
    Path("x.csv").write_text("1,2\n")
    Path("v.csv").write_text("3,4\n")
    files = DatasetFiles.of_dataset("a")
    write_results("x.csv", files.recording, files.recording_info)
    write_results("v.csv", files.validation_recording, files.validation_recording_info)
    time.sleep(0.02)
    return files


def replace_by_older(path, text):
    """As `mv`, `cp -p`, `unzip` and `rsync -t` do."""
    Path("older").write_text(text)
    os.utime("older", (10**9, 10**9))
    Path("older").replace(path)


def times(files):
    return [Path(file).stat().st_mtime for file in (files.recording, files.recording_info)]


def test_an_unchanged_file_leaves_everything(read):
    before = times(read)
    assert mark_replaced_recordings(settings({"a": BOTH})) == []
    assert times(read) == before


@pytest.mark.parametrize("text", ["9,9\n", "longer\n"])
@pytest.mark.parametrize("path", ["x.csv", "v.csv"])
def test_an_older_file_in_its_place_is_noticed(read, path, text):
    replace_by_older(path, text)
    assert mark_replaced_recordings(settings({"a": BOTH})) == [path]
    outputs = {
        "x.csv": (read.recording, read.recording_info),
        "v.csv": (read.validation_recording, read.validation_recording_info),
    }
    for other, files in outputs.items():
        for file in files:
            older = Path(file).stat().st_mtime < Path(other).stat().st_mtime
            assert older == (other == path)


def test_a_file_from_the_beginning_of_time_is_noticed(read):
    replace_by_older("x.csv", "9,9\n")
    os.utime("x.csv", (0, 0))
    assert mark_replaced_recordings(settings({"a": BOTH})) == ["x.csv"]
    assert max(times(read)) < 0


def test_a_link_that_leads_to_another_old_file_is_noticed(read):
    Path("old.csv").write_text("9,9\n")
    os.utime("old.csv", (10**9, 10**9))
    Path("x.csv").unlink()
    Path("x.csv").symlink_to("old.csv")
    assert mark_replaced_recordings(settings({"a": BOTH})) == ["x.csv"]


def test_a_folder_that_was_exchanged_is_noticed_by_the_size_of_its_file():
    """The status of the files below it does not change."""
    Path("other").mkdir()
    Path("other/x.csv").write_text("9,9,9,9\n")
    Path("data").mkdir()
    Path("data/x.csv").write_text("1,2\n")
    time.sleep(0.02)
    files = DatasetFiles.of_dataset("a")
    write_results("data/x.csv", files.recording, files.recording_info)
    Path("data").rename("before")
    Path("other").rename("data")
    assert mark_replaced_recordings(settings({"a": {"file": "data/x.csv"}})) == ["data/x.csv"]


def test_a_touched_copied_or_missing_file_leaves_everything(read):
    before = times(read)
    Path("x.csv").touch()
    replace_by_older("v.csv", "3,4\n")
    assert mark_replaced_recordings(settings({"a": BOTH})) == []
    Path("x.csv").unlink()
    assert mark_replaced_recordings(settings({"a": BOTH})) == []
    assert times(read) == before


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"file": 3}', '{"file": null}', "\0"])
def test_a_damaged_description_is_left_to_its_readers(read, content):
    Path(read.recording_info).write_text(content)
    assert mark_replaced_recordings(settings({"a": BOTH})) == []


def test_a_recording_is_known_by_its_path(read):
    assert was_read_from("x.csv", read.recording_info)
    assert was_read_from("./x.csv", read.recording_info)
    assert not was_read_from("y.csv", read.recording_info)
    assert not was_read_from("x.csv", "results/none/recording.json")


def test_two_thousand_data_sets_take_a_second():
    Path("data").mkdir()
    names = [f"r{number}" for number in range(2_000)]
    for name in names:
        Path(f"data/{name}.csv").write_text("1,2\n")
    for name in names:
        files = DatasetFiles.of_dataset(name)
        write_results(f"data/{name}.csv", files.recording, files.recording_info)
    datasets = settings({name: {"file": f"data/{name}.csv"} for name in names})
    before = time.process_time()
    assert mark_replaced_recordings(datasets) == []
    assert time.process_time() - before < 1


@pytest.mark.parametrize("seconds", [0, 1, 2, 10**9])
def test_outputs_become_older_than_the_file_and_have_a_time_that_snakemake_takes(read, seconds):
    """A time of 0 is none to Snakemake: it would rerun nothing."""
    Path("older").write_text("9,9\n")
    os.utime("older", (seconds, seconds))
    Path("older").replace("x.csv")
    assert mark_replaced_recordings(settings({"a": BOTH})) == ["x.csv"]
    assert all(0 != time < seconds for time in times(read))
