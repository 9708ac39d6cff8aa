"""`evopem init`: what it writes for recordings of every kind, in a folder with other files."""

import contextlib
import os
from pathlib import Path

import hypothesis
import numpy as np
import pytest
import scipy.io
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from evopem.config.defaults import complete
from evopem.config.source_checks import is_valid
from evopem.config.strict_yaml import check_yaml_files
from evopem.errors import InputError
from evopem.signals.reading import read_measured
from evopem.terminal.new_configuration import (
    configuration_text,
    dataset_name,
    write_configuration,
)

RNG = np.random.default_rng(1)
SAMPLES = 300
U, Y = RNG.standard_normal((2, SAMPLES))


def settings_of(text):
    return complete(yaml.safe_load(text)).datasets


def test_what_was_found_is_what_the_readers_read(tmp_path):
    scipy.io.savemat(tmp_path / "bench.mat", {"torque": U, "speed": Y, "fs": 250.0})
    np.savez(tmp_path / "arm.npz", y=Y, u=U, sampling_rate=50.0)
    (tmp_path / "deeper").mkdir()
    stamps = np.arange(SAMPLES) * 0.004
    table = np.column_stack([stamps, U, Y])
    np.savetxt(tmp_path / "deeper" / "log 1.csv", table, delimiter=";", header="t [s];force;x")
    datasets = settings_of(configuration_text(tmp_path))
    assert set(datasets) == {"bench", "arm", "log_1"}
    rates = {}
    for name, settings in datasets.items():
        file = tmp_path / settings.source.files[0]
        recording = read_measured(file, settings.channels)[0]
        np.testing.assert_allclose(recording.input, U)
        np.testing.assert_allclose(recording.output, Y)
        rates[name] = recording.sampling_rate
    assert rates == {"bench": 250.0, "arm": 50.0, "log_1": 250.0}


def test_what_is_not_certain_is_left_to_the_user(tmp_path):
    np.savetxt(tmp_path / "plain.txt", np.column_stack([U, Y]))
    counted = np.column_stack([np.arange(SAMPLES), U, Y])
    np.savetxt(tmp_path / "counted.csv", counted, delimiter=",", header="tick,a,b", comments="")
    text = configuration_text(tmp_path)
    assert "input: 1  # a guess by the order of the channels" in text
    assert "# sampling_rate: 100  # Hz; to be set: the file states none" in text
    assert "# time_unit: ms  # to be set: the time stamps are whole numbers" in text
    assert settings_of(text)["counted"].source.channels.time == "tick"
    text = (tmp_path / "counted.csv").read_text().replace("tick,", "time_ms [s],")
    (tmp_path / "both.csv").write_text(text)  # which of both units holds is to be chosen
    assert "# time_unit: ms  # to be set: the file states" in configuration_text(tmp_path)


def test_a_named_time_that_is_not_even_is_no_signal(tmp_path):
    time = np.arange(SAMPLES) / 250.0
    time[200] = time[199]
    table = np.column_stack([time, U, Y])
    np.savetxt(tmp_path / "again.csv", table, delimiter=",", header="t,a,b", comments="")
    coarse = np.column_stack([np.floor(np.arange(SAMPLES) * 3 / 4) / 250, U, Y])
    np.savetxt(tmp_path / "coarse.csv", coarse, delimiter=",", header="time,a,b", comments="")
    text = configuration_text(tmp_path)
    assert "time: time  # 333.333 Hz" in text
    assert "# the time does not increase: it is that of sample 200; remove rows" in text
    settings = settings_of(text)
    for name, channel in (("again", "t"), ("coarse", "time")):
        own = settings[name].channels
        assert (own.time, own.inputs, own.outputs) == (channel, ("a",), ("b",))


def test_other_files_are_left_out_and_named(tmp_path):
    (tmp_path / "cut.csv").write_text("t,a,b\n0,1,2\n1,2,3\n2,1\n")
    np.savetxt(tmp_path / "data.csv", np.column_stack([U, Y]), delimiter=",")
    (tmp_path / "README.txt").write_text("measured on a Monday\n")
    np.savetxt(tmp_path / "single.csv", U)
    constant = np.column_stack([U, np.full(SAMPLES, 2.5)])
    np.savetxt(tmp_path / "dead.csv", constant, delimiter=",")
    (tmp_path / "results" / "data").mkdir(parents=True)
    np.savetxt(tmp_path / "results" / "data" / "modes.csv", np.column_stack([U, Y]))
    text = configuration_text(tmp_path)
    assert set(settings_of(text)) == {"data"}
    left_out = text.partition("# Left out:\n")[2].splitlines()
    assert [line.split(":")[0] for line in left_out] == [
        "# README.txt, line 1",
        "# cut.csv, line 4",
        "# dead.csv",
        "# single.csv",
    ]
    assert "cut.csv, line 4: the row has 2 fields where the others have 3" in left_out[1]
    assert "only one of its channels holds numbers that change; two are needed." in left_out[3]


@pytest.mark.parametrize("name", ["y", "no", "12", "a: b", "#1", "Größe [N]", "'quoted'"])
def test_a_channel_of_any_name_is_quoted_where_yaml_needs_it(tmp_path, name):
    np.savez(tmp_path / "data.npz", **{"u": U, name: Y})
    channels = settings_of(configuration_text(tmp_path))["data"].channels
    assert {*channels.inputs, *channels.outputs} == {"u", name}


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(InputError, match="there is no recording of two signals"):
        write_configuration(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        write_configuration(tmp_path / "missing")
    assert list(tmp_path.iterdir()) == []


def test_names_of_several_channels_make_lists(tmp_path):
    table = np.random.default_rng(1).standard_normal((50, 4))
    header = "force_1,force_2,acc_1,acc_2"
    np.savetxt(tmp_path / "beam.csv", table, delimiter=",", header=header, comments="")
    written = configuration_text(tmp_path)
    assert "input: [force_1, force_2]\n" in written
    assert "output: [acc_1, acc_2]\n" in written


def test_a_file_whose_name_is_no_text_is_left_out_and_named(tmp_path):
    """Written whole or not at all: half a file would stop the next attempt."""
    for name in ("good.csv", os.fsdecode(b"r\xfcck.csv")):
        (tmp_path / name).write_text("u,y\n" + "1,2\n3,5\n" * 20)
    written = write_configuration(tmp_path).read_text(encoding="utf-8")
    assert "good:" in written
    assert "# r\\udcfcck.csv: its name is no UTF-8 text, or" in written


ON_DISK = st.text(
    st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), min_size=1, max_size=40
).filter(lambda name: name not in (".", "..") and len(name.encode()) < 200)
COLUMNS = st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1, max_size=12)


@hypothesis.settings(max_examples=25, deadline=None)
@given(names=st.lists(ON_DISK, min_size=1, max_size=4, unique=True), column=COLUMNS)
@example(names=["1", "2024", "no", "CON", "1e5", "null", "0x1f", "~"], column="u*")
@example(names=["run*", "a\nb", "a..b", "-rf", "{x}", "results", "logs", "a" * 80], column="none")
@example(names=["x" * 60, "ab" * 30, "index.html", "é", "a: b", "# c", "'", '"'], column="yes")
def test_what_it_writes_is_a_configuration_for_every_name(tmp_path_factory, names, column):
    folder = tmp_path_factory.mktemp("named")
    for name in names:
        np.savez(folder / f"{name}.npz", **{"y": Y, "rate": 10.0, column.strip(":") or "u": U})
    np.savez(folder / "good.npz", u=U, y=Y)
    written = write_configuration(folder)
    check_yaml_files([str(written)])
    with contextlib.chdir(folder):
        datasets = settings_of(written.read_text(encoding="utf-8"))
    files = [file for each in datasets.values() for file in each.source.files]
    assert len(files) == len(datasets)
    assert set(files) <= {f"{name}.npz" for name in (*names, "good")}
    assert "good.npz" in files


@pytest.mark.parametrize("stem", ["x" * 240, "ab" * 100, "recording" * 20])
def test_a_long_name_of_equal_parts_becomes_a_name(stem):
    assert is_valid(dataset_name(Path(f"{stem}.csv")))


def test_many_recordings_get_a_job_each(tmp_path):
    for number in range(10):
        np.savez(tmp_path / f"r{number}.npz", u=U, y=Y)
    written = yaml.safe_load(configuration_text(tmp_path))
    assert written["one_job_per"] == "recording"
    (tmp_path / "r0.npz").unlink()
    assert "one_job_per" not in yaml.safe_load(configuration_text(tmp_path))
