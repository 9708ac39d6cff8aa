"""Sampling rates, units of time and starts that binary files state, and where they hold."""

from __future__ import annotations

import datetime

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from recorded_files import RATE, T, U, Y, assert_read, read_recording, refusal, uff_text
from scipy.io import savemat

UNKNOWN = {"sampling_rate": None}


def hdf5(tmp_path, build):
    path = tmp_path / "record.h5"
    with h5py.File(path, "w") as file:
        for group in ("", "run1/", "run2/"):
            file[f"{group}u"], file[f"{group}y"] = U, Y
        build(file)
    return path


def stating(name, value):
    return lambda file: file.create_dataset(name, data=value)


def test_the_rate_of_the_own_group_holds(tmp_path):
    def build(file):
        file["run1/fs"], file["run2/fs"], file["fs"] = 1000.0, 100.0, RATE
        file["calibration/sample_rate"] = 8000.0

    path = hdf5(tmp_path, build)
    assert_read(read_recording(path, "run1/u", "run1/y"), 1000.0)
    assert_read(read_recording(path, "run2/u", "run2/y"), 100.0)
    assert_read(read_recording(path, "u", "y"))
    assert "different sampling rates" in refusal(path, "run1/u", "run2/y", **UNKNOWN)


def test_a_rate_of_a_group_around_holds(tmp_path):
    path = hdf5(tmp_path, stating("fs", RATE))
    assert_read(read_recording(path, "run1/u", "run1/y"))


def test_a_rate_of_an_attribute_holds_for_its_dataset_or_group(tmp_path):
    def build(file):
        file["run1"].attrs["FS"] = 1000
        file.attrs["sampling_rate"] = np.array([RATE])
        for name in ("run2/u", "run2/y"):
            file[name].attrs["Sample_Rate"] = 50.0

    path = hdf5(tmp_path, build)
    assert_read(read_recording(path, "run1/u", "run1/y"), 1000.0)
    assert_read(read_recording(path, "run2/u", "run2/y"), 50.0)
    assert_read(read_recording(path, "u", "y"))


@pytest.mark.parametrize(
    ("build", "expected"),
    [
        (stating("run1/fs", 1000.0), '"run1/fs" states 1000 Hz for another group'),
        (stating("meta/fs", 1000.0), '"meta/fs" states 1000 Hz for another group'),
        (stating("run2/fs", -5.0), 'its "run2/fs" is -5 Hz'),
        (stating("run2/fs", np.nan), 'its "run2/fs" is nan Hz'),
        (stating("run2/fs", 0), 'its "run2/fs" is 0 Hz'),
        (lambda file: file["run2"].attrs.update(fs=1.0, sample_rate=2.0), '"run2/sample_rate" 2'),
        (stating("rate", 9.0), "since the file states none"),
    ],
)
def test_a_rate_that_is_not_certain_is_asked_for(tmp_path, build, expected):
    path = hdf5(tmp_path, build)
    assert expected in refusal(path, "run2/u", "run2/y", **UNKNOWN)
    assert_read(read_recording(path, "run2/u", "run2/y", RATE))


@pytest.mark.parametrize(("unit", "rate"), [("kHz", 250.0), ("Hz", 0.25), ("samples/s", 0.25)])
def test_the_unit_of_a_rate(tmp_path, unit, rate):
    def build(file):
        file["fs"] = 0.25
        file["fs"].attrs["unit"] = unit

    assert_read(read_recording(hdf5(tmp_path, build), "u", "y"), rate)


def test_a_rate_in_an_unknown_unit_is_asked_for(tmp_path):
    def build(file):
        file["fs"] = 0.25
        file["fs"].attrs["unit"] = "per minute"

    assert 'the unit "per minute"' in refusal(hdf5(tmp_path, build), "u", "y", **UNKNOWN)


def test_rates_of_matlab_structures(tmp_path):
    path = tmp_path / "record.mat"
    run = {"u": U, "y": Y}
    savemat(path, {"r1": run | {"fs": 1000.0}, "r2": run | {"fs": 100.0}, "r3": run})
    assert_read(read_recording(path, "r1.u", "r1.y"), 1000.0)
    assert_read(read_recording(path, "r2.u", "r2.y"), 100.0)
    assert '"r1.fs" states 1000 Hz for another group' in refusal(path, "r3.u", "r3.y", **UNKNOWN)
    savemat(path, {"u": U, "y": Y, "meta": {"fs": 8000.0}, "Fs": RATE})
    assert_read(read_recording(path, "u", "y"))


def test_rates_of_numpy_archives(tmp_path):
    path = tmp_path / "record.npz"
    np.savez(path, **{"a/u": U, "a/y": Y, "a/fs": RATE, "b/u": U, "b/y": Y})
    assert_read(read_recording(path, "a/u", "a/y"))
    assert '"a/fs" states 250 Hz for another group' in refusal(path, "b/u", "b/y", **UNKNOWN)
    np.savez(path, u=U, y=Y, fs=RATE, sample_rate=500.0)
    assert '"fs" 250 Hz and "sample_rate" 500 Hz' in refusal(path, "u", "y", **UNKNOWN)


@pytest.mark.parametrize(
    ("value", "rate"),
    [
        ("ms", 250.0),
        ("msec", 250.0),
        (np.array([b"ms"]), 250.0),
        (np.array(["Milliseconds"], dtype=h5py.string_dtype()), 250.0),
        ("seconds since 2024-01-01 00:00:00", 0.25),
        ("min", 1 / 240),
    ],
)
@pytest.mark.parametrize("attribute", ["unit", "Units", "UNIT"])
def test_the_unit_of_time_in_an_attribute(tmp_path, value, rate, attribute):
    def build(file):
        file["clock"] = 0.25 + 1e3 * T
        file["clock"].attrs[attribute] = value

    path = hdf5(tmp_path, build)
    recording = read_recording(path, "u", "y", time="clock")
    assert recording.sampling_rate == pytest.approx(rate, rel=1e-6)


def test_an_unknown_unit_of_time_in_an_attribute(tmp_path):
    def build(file):
        file["clock"] = 0.25 + 1e3 * T
        file["clock"].attrs["unit"] = "ticks"

    path = hdf5(tmp_path, build)
    message = refusal(path, "u", "y", time="clock", **UNKNOWN)
    assert '"ticks" is no known unit of time; set time_unit to one of s, ms' in message
    assert_read(read_recording(path, "u", "y", time="clock", time_unit="ms"))


# TDMS


def tdms(tmp_path, first, second=None):
    path = tmp_path / "record.tdms"
    with TdmsWriter(path) as writer:
        for name, values, properties in (("u", U, first), ("y", Y, second or first)):
            writer.write_segment([ChannelObject("run", name, values, properties)])
    return path


@pytest.mark.parametrize(
    ("properties", "expected"),
    [
        ({"wf_increment": "fast"}, "wf_increment is fast, not a number"),
        ({"wf_increment": datetime.datetime(2024, 1, 1)}, "wf_increment is 2024-01-01"),
        ({"wf_increment": True}, "wf_increment"),
        ({"wf_increment": -0.01}, "wf_increment is -0.01 s"),
        ({"wf_increment": float("nan")}, "wf_increment is nan s"),
        ({"wf_increment": float("inf")}, "wf_increment is inf s"),
        ({"wf_increment": 5e-324}, "wf_increment is 4.94066e-324 s"),
        ({"wf_increment": 0.01, "wf_xunit_string": "Hz"}, 'in the unit "Hz"'),
        ({"wf_increment": 0.0}, "since the file states none"),
    ],
)
def test_an_increment_that_is_none_is_asked_for(tmp_path, properties, expected):
    path = tdms(tmp_path, properties)
    assert expected in refusal(path, "u", "y", **UNKNOWN)
    assert_read(read_recording(path, "u", "y", RATE))


@pytest.mark.parametrize(("unit", "increment"), [("s", 0.004), ("ms", 4.0), ("", 0.004)])
def test_the_unit_of_an_increment(tmp_path, unit, increment):
    properties = {"wf_increment": increment, "wf_xunit_string": unit}
    assert_read(read_recording(tdms(tmp_path, properties), "u", "y"))


def test_channels_that_begin_at_different_times(tmp_path):
    begin = np.datetime64("2024-05-31T12:00:00.000000")
    first = {"wf_increment": 0.004, "wf_start_time": begin}
    for late in ({"wf_start_time": begin + np.timedelta64(40, "ms")}, {"wf_start_offset": 0.04}):
        message = refusal(tdms(tmp_path, first, first | late), "u", "y", **UNKNOWN)
        assert "the output begins 0.04 s after the input" in message
    message = refusal(tdms(tmp_path, first | {"wf_start_offset": 0.04}, first), "u", "y", **UNKNOWN)
    assert "the output begins 0.04 s before the input" in message
    near = first | {"wf_start_time": begin + np.timedelta64(1, "ms")}
    assert_read(read_recording(tdms(tmp_path, first, near), "u", "y"))


def test_universal_records_that_begin_at_different_times(tmp_path):
    path = tmp_path / "record.unv"
    late = uff_text(Y, "tip").replace(f"{0.0:13.5e}{1.0 / RATE:13.5e}", f"{0.5:13.5e}{0.004:13.5e}")
    path.write_text(uff_text(U, "torque") + late)
    assert "begins 0.5 s after the input" in refusal(path, "torque", "tip", sampling_rate=RATE)


def test_a_universal_record_without_an_increment(tmp_path):
    path = tmp_path / "record.unv"
    path.write_text((uff_text(U, "u") + uff_text(Y, "y")).replace("4.00000e-03", "0.00000e+00"))
    assert "increment of its abscissa is 0 s" in refusal(path, "u", "y", **UNKNOWN)
