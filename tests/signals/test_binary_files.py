"""Binary formats, each written by a library other than the one that reads it where one exists."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recorded_files import (
    RATE,
    N,
    T,
    U,
    Y,
    assert_read,
    read_recording,
    refusal,
    uff_text,
    write_every_format,
    write_matlab_73,
    write_tdms,
)
from scipy.io import savemat

from evopem.config.channels import ChannelSettings
from evopem.signals.reading import read_measured
from evopem.signals.recording_info import (
    ChannelInfo,
    FileOrigin,
    RecordingInfo,
    describe_recording,
)

MOTOR_BENCH = Path(__file__).parents[2].parent / "shared" / "data" / "motor_bench"


# MATLAB up to version 7


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("form", ["row", "column"])
def test_matlab_level_5(tmp_path, compressed, form):
    path = tmp_path / "record.mat"
    savemat(
        path,
        {"t": T, "u": U, "y": Y, "fs": RATE, "note": "made here"},
        oned_as=form,
        do_compression=compressed,
    )
    assert_read(read_recording(path, "u", "y", time="t"))
    assert_read(read_recording(path, 2, 3))  # its fs is the rate
    assert_read(read_recording(path, "u", "y", 10.0), 10.0)


def test_matlab_level_4_and_matrices(tmp_path):
    path = tmp_path / "record.mat"
    savemat(path, {"data": np.column_stack([T, U, Y])}, format="4")
    assert_read(read_recording(path, "data:2", "data:3", time="data:1"))
    assert_read(read_recording(path, 2, 3, RATE))
    assert 'variable "data": it is a matrix, 240 x 3' in refusal(path, "data", 2)
    savemat(path, {"data": np.vstack([U, Y])})
    assert_read(read_recording(path, 1, 2, RATE))


def test_matlab_structures_and_whole_numbers(tmp_path):
    path = tmp_path / "record.mat"
    counts = (1000 * U).round()
    savemat(path, {"run": {"motor": {"speed": counts}, "tip": Y, "us": np.arange(N) * 4000}})
    recording = read_recording(path, "run.motor.speed", "run.tip", time="run.us")
    np.testing.assert_array_equal(recording.input, counts)
    assert recording.sampling_rate == RATE


def test_matlab_unknown_variable_text_and_complex(tmp_path):
    path = tmp_path / "record.mat"
    savemat(path, {"u": U, "y": Y, "note": "text", "z": U + 1j * Y, "cube": np.ones((2, 3, 4))})
    assert "1 'u', 2 'y', 3 'z'" in refusal(path, "u", "yy")
    assert "no variable 4" in refusal(path, "u", 4)
    assert "complex numbers" in refusal(path, "u", "z")
    assert 'variable "note"' in refusal(path, "u", "note")
    assert "2 x 3 x 4" in refusal(path, "u", "cube")


def test_matlab_lengths_and_missing_values(tmp_path):
    path = tmp_path / "record.mat"
    broken = U.copy()
    broken[17::12] = np.nan  # too many to be filled
    savemat(path, {"u": U, "short": Y[:-1], "broken": broken, "t": T[:-2]})
    assert "240 samples and the output 239" in refusal(path, "u", "short")
    assert 'output "broken", sample 18: the value is missing' in refusal(path, "u", "broken")
    assert "238 time stamps and 240" in refusal(path, "u", "broken", time="t")


@pytest.mark.skipif(not MOTOR_BENCH.is_dir(), reason=f"needs the recordings in {MOTOR_BENCH}")
@pytest.mark.parametrize("name", ["MultisineTypeA.mat", "MultisineTypeB.mat"])
def test_a_recording_that_matlab_wrote(name):
    """Holds objects of MATLAB classes, and its time counts microseconds."""
    path = MOTOR_BENCH / name
    for settings in ({}, {"time": "time"}, {"sampling_rate": 2500.0, "time": "time"}):
        recording = read_recording(path, "iq_adx", "omega_max", **settings)
        assert recording.sampling_rate == 2500.0
        assert recording.samples == 50_000


# MATLAB 7.3


def test_matlab_73(tmp_path):
    path = tmp_path / "record.mat"
    write_matlab_73(path, {"data": np.vstack([U, Y]), "t": T, "fs": np.array([RATE])})
    assert_read(read_recording(path, "data:1", "data:2"))
    assert_read(read_recording(path, 1, 2, time="t"))
    message = refusal(path, "u", 1)
    assert "'data:1', 2 'data:2', 3 't'" in message
    assert "refs" not in message
    assert 'variable "note"' in refusal(path, "note", 1)


def test_matlab_73_by_an_independent_writer(tmp_path):
    hdf5storage = pytest.importorskip("hdf5storage", reason="hdf5storage writes the file")
    path = tmp_path / "record.mat"
    hdf5storage.savemat(
        str(path), {"t": T, "run": {"u": U, "y": Y}}, format="7.3", store_python_metadata=False
    )
    assert path.read_bytes().startswith(b"MATLAB 7.3")
    assert_read(read_recording(path, "run.u", "run.y", time="t"))


# numpy


def test_npz_and_npy(tmp_path):
    np.savez_compressed(tmp_path / "r.npz", u=U, y=Y.astype(np.float32), t=T)
    recording = read_recording(tmp_path / "r.npz", "u", 2, time="t")
    np.testing.assert_array_equal(recording.output, Y.astype(np.float32))
    np.save(tmp_path / "r.npy", np.column_stack([T, U, Y]))
    assert_read(read_recording(tmp_path / "r.npy", 2, 3, time=1))
    records = np.rec.fromarrays([U, Y], names="u,y")
    np.save(tmp_path / "named.npy", records)
    assert_read(read_recording(tmp_path / "named.npy", "u", "y", RATE))


class Trap:
    def __reduce__(self):
        return (sys.exit, ("unpickled",))


def test_no_pickle_is_loaded(tmp_path):
    trapped = np.array([Trap()], dtype=object)
    np.savez(tmp_path / "r.npz", allow_pickle=True, u=U, y=Y, trap=trapped)
    assert_read(read_recording(tmp_path / "r.npz", "u", "y", RATE))
    assert "text or objects" in refusal(tmp_path / "r.npz", "u", "trap")
    np.save(tmp_path / "r.npy", trapped, allow_pickle=True)
    assert "without Python objects" in refusal(tmp_path / "r.npy")
    (tmp_path / "bare.npy").write_bytes(b"\x80\x04K\x01.")
    assert "without Python objects" in refusal(tmp_path / "bare.npy")


# Parquet


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_parquet(tmp_path, unit):
    path = tmp_path / "record.parquet"
    stamps = pd.date_range("2024-01-01", periods=N, freq="4ms", unit=unit)
    frame = pd.DataFrame({"t": stamps, "u": U, "y": Y, "i": np.arange(N), "label": "ok"})
    frame.to_parquet(path, index=False)
    assert_read(read_recording(path, "u", "y", time="t"))
    assert_read(read_recording(path, 2, 3, RATE))
    assert "text or objects" in refusal(path, "u", "label")
    assert "dates" in refusal(path, "u", "t")
    assert "1 't', 2 'u'" in refusal(path, "u", "v")
    frame.loc[4, "y"] = None
    frame.to_parquet(path, index=False)
    assert read_recording(path, "u", "y", RATE).samples == N - 5


def test_parquet_columns_of_one_name(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "record.parquet"
    pq.write_table(pa.table([pa.array(U), pa.array(Y)], names=["x", "x"]), path)
    assert_read(read_recording(path, 1, 2, RATE))
    assert "stands at 2 columns" in refusal(path, "x", 1)


# HDF5


def test_hdf5(tmp_path):
    import h5py

    path = tmp_path / "record.h5"
    with h5py.File(path, "w") as file:
        file["run/data"] = np.column_stack([U, Y])
        file["run/time"] = T
        file["u"], file["y"] = U, Y
        file["u"].attrs["unit"] = "N m"
        file["label"] = "text"
    assert_read(read_recording(path, "run/data:1", "/run/data:2", time="run/time"))
    recording = read_recording(path, "u", "/y", RATE)
    assert recording.input_units[0] == "N m"
    assert "'run/data:1', 2 'run/data:2', 3 'run/time', 4 'u', 5 'y'" in refusal(path, "w", "y")
    assert 'dataset "run/data": it is a matrix' in refusal(path, "/run/data", "y")
    assert 'dataset "label"' in refusal(path, "label", "y")
    with h5py.File(path, "a") as file:
        file.attrs["fs"] = RATE
    assert_read(read_recording(path, "u", "y"))


def test_hdf5_that_pandas_wrote(tmp_path):
    pytest.importorskip("tables", reason="PyTables writes the file")
    path = tmp_path / "record.hdf5"
    pd.DataFrame({"u": U, "y": Y}).to_hdf(path, key="run")
    assert_read(read_recording(path, "run/block0_values:1", "run/block0_values:2", RATE))


# TDMS


def test_tdms(tmp_path):
    path = tmp_path / "record.tdms"
    write_tdms(path, wf_increment=1.0 / RATE)
    recording = read_recording(path, "torque", "run/speed")
    assert_read(recording)
    assert (recording.input_units[0], recording.input_names[0]) == ("N m", "torque")
    assert_read(read_recording(path, 1, 2, RATE))
    assert "stands at 2 channels" in refusal(path, "torque", "speed")
    assert "2 'run/speed', 3 'spare/speed'" in refusal(path, "torque", "sped")
    write_tdms(path)
    assert "sampling rate is not known" in refusal(path, 1, 2, sampling_rate=None)


def test_tdms_channels_of_different_rates(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "record.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("run", "u", U, {"wf_increment": 0.01}),
                ChannelObject("run", "y", Y, {"wf_increment": 0.02}),
            ]
        )
    message = refusal(path, "u", "y", sampling_rate=None)
    assert "different sampling rates for input and output (100 Hz and 50 Hz)" in message
    assert "uneven_time: interpolate" in message


def tone(rate, samples):
    return np.sin(2.0 * np.pi * 3.0 * np.arange(samples) / rate)


def test_tdms_groups_of_different_rates_are_brought_to_the_lowest(tmp_path):
    """The faster channel loses what the slower rate cannot hold, and keeps its time."""
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "record.tdms"
    slow = np.random.default_rng(4).standard_normal(1000)
    fast = tone(400.0, 4100) + np.sin(2.0 * np.pi * 90.0 * np.arange(4100) / 400.0)
    with TdmsWriter(path) as writer:
        for group, values, rate in (("slow", slow, 100.0), ("fast", fast, 400.0)):
            channel = ChannelObject(group, "x", values, {"wf_increment": 1.0 / rate})
            writer.write_segment([channel])
    recording = read_recording(path, "slow/x", "fast/x", uneven_time="interpolate")
    assert (recording.samples, recording.sampling_rate) == (1000, 100.0)
    np.testing.assert_array_equal(recording.input, slow)
    inner = slice(80, -80)
    assert np.abs(recording.output - tone(100.0, 1000))[inner].max() < 1e-3


@pytest.mark.parametrize("late", [0.0091, -0.0137, 0.25, -0.25])
def test_groups_of_different_rates_that_begin_apart_have_their_common_time(tmp_path, late):
    """As the rasters of a control unit: the slower one begins a part of its sample later."""
    from nptdms import ChannelObject, TdmsWriter

    path, begin = tmp_path / "record.tdms", np.datetime64("2024-05-31T12:00:00.000000")
    ends = {"slow": (100.0, 1000, max(late, 0.0)), "fast": (1000.0, 10_000, max(-late, 0.0))}
    with TdmsWriter(path) as writer:
        for group, (rate, samples, offset) in ends.items():
            values = np.sin(2.0 * np.pi * 3.0 * (offset + np.arange(samples) / rate))
            start = begin + np.timedelta64(round(1e6 * offset), "us")
            about = {"wf_increment": 1.0 / rate, "wf_start_time": start}
            values = 2.0 * values if group == "slow" else values
            writer.write_segment([ChannelObject(group, "x", values, about)])
    recording = read_recording(path, "slow/x", "fast/x", uneven_time="interpolate")
    assert 974 <= recording.samples <= 1000
    slope = 2.0 * np.pi * 3.0 * 0.0005  # to half a sample of the faster one
    assert np.abs(recording.output - 0.5 * recording.input)[80:-80].max() < 1.1 * slope


def test_groups_without_common_time_are_refused(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    path, begin = tmp_path / "record.tdms", np.datetime64("2024-05-31T12:00:00.000000")
    with TdmsWriter(path) as writer:
        for group, rate, day in (("u", 100.0, 0), ("y", 400.0, 1)):
            about = {"wf_increment": 1 / rate, "wf_start_time": begin + np.timedelta64(day, "D")}
            writer.write_segment([ChannelObject(group, "x", tone(rate, 900), about)])
    message = refusal(path, "u/x", "y/x", sampling_rate=None, uneven_time="interpolate")
    assert "the channels have no time in common; choose channels that were sampled" in message


# MDF and sound


def write_mdf(path, *groups, version="4.10"):
    """Groups of channels, each a name of its acquisition, times, and values by name."""
    asammdf = pytest.importorskip("asammdf", reason="asammdf is not installed")
    with asammdf.MDF(version=version) as file:
        for name, times, channels in groups:
            signals = [
                asammdf.Signal(
                    np.asarray(values), times, unit="m", name=key,
                    invalidation_bits=np.isnan(values) if np.isnan(values).any() else None,
                )
                for key, values in channels.items()
            ]  # fmt: skip
            file.append(signals, acq_name=name)
        file.save(path, overwrite=True)


@pytest.mark.parametrize(
    ("version", "extension"), [("4.10", "mf4"), ("4.20", "mf4"), ("3.30", "mdf")]
)
def test_mdf_by_asammdf(tmp_path, version, extension):
    path = tmp_path / f"record.{extension}"
    write_mdf(path, (None, T, {"torque": U, "speed": Y}), version=version)
    recording = read_recording(path, "torque", "1/speed")
    assert_read(recording)
    assert recording.output_units == ("m",)
    assert "2 '1/torque', 3 '1/speed'" in refusal(path, "torque", "sped")
    renamed = path.with_suffix(".dat")
    renamed.write_bytes(path.read_bytes())
    assert "its content is MDF" in refusal(renamed)
    for share in (0.05, 0.6):
        path.write_bytes(renamed.read_bytes()[: int(share * renamed.stat().st_size)])
        refusal(path, "torque", "speed")


def test_mdf_groups_of_different_rates(tmp_path):
    path = tmp_path / "record.mf4"
    times = np.arange(4000) / 400.0 + 1e-6 * np.random.default_rng(1).standard_normal(4000)
    late, uneven = T + 0.5, T + 0.001 * np.sin(np.arange(N))
    missing = np.where(np.arange(N) == 130, np.nan, Y)
    slow = np.arange(1000) / 100.0
    write_mdf(
        path,
        ("slow", slow, {"x": np.sin(slow**2)}),
        ("fast", times, {"x": tone(400.0, 4000)}),
        ("late", late, {"y": Y}),
        ("rough", uneven, {"u": U, "v": Y}),
        ("bus", T, {"u": U, "y": missing}),
    )
    unknown = {"sampling_rate": None}
    assert "(100 Hz and 400 Hz)" in refusal(path, "slow/x", "fast/x", **unknown)
    recording = read_recording(path, "slow/x", "fast/x", uneven_time="interpolate")
    assert np.abs(recording.output - tone(100.0, 1000))[80:-80].max() < 1e-3
    assert "begins 0.5 s after" in refusal(path, "bus/u", "late/y", **unknown)
    assert "among its times; give sampling_rate" in refusal(path, "rough/u", "v", **unknown)
    even = read_recording(path, "rough/u", "v", time="rough/time", uneven_time="interpolate")
    assert even.sampling_rate == pytest.approx(RATE, rel=1e-2)
    assert [part.samples for part in read_recording(path, "bus/u", "bus/y").segments] == [130, 109]


def test_a_missing_asammdf_names_its_extra(tmp_path, monkeypatch):
    path = tmp_path / "record.mf4"
    path.write_bytes(b"MDF     4.10    ".ljust(500, b"\0"))
    monkeypatch.setitem(sys.modules, "asammdf", None)
    assert 'pip install "evopem[mdf]"' in refusal(path)


@pytest.mark.parametrize("kind", ["int16", "int32", "uint8", "float32", "float64"])
def test_sound_files(tmp_path, kind):
    from scipy.io import wavfile

    path = tmp_path / "record.wav"
    scale = 20.0 if kind == "uint8" else 1000.0
    stored = (128.0 * (kind == "uint8") + scale * np.column_stack([U, Y])).astype(kind)
    wavfile.write(path, 250, stored)
    recording = read_recording(path, 1, 2)
    np.testing.assert_array_equal(recording.inputs, stored[:, :1].astype(float))
    assert recording.sampling_rate == RATE
    assert "no channel 3" in refusal(path, 1, 3)
    assert "no header with a name" in refusal(path, "left", 2)


def test_a_sound_file_of_24_bits_with_a_chunk_of_another_program(tmp_path):
    import wave

    path = tmp_path / "record.wav"
    counts = (1e5 * np.column_stack([U, Y])).astype("<i4")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(3)
        file.setframerate(250)
        file.writeframes(b"".join(int(x).to_bytes(3, "little", signed=True) for x in counts.flat))
    whole = path.read_bytes()
    chunk = b"bext" + (8).to_bytes(4, "little") + bytes(8)
    size = (len(whole) + len(chunk) - 8).to_bytes(4, "little")
    path.write_bytes(whole[:4] + size + whole[8:12] + chunk + whole[12:])
    np.testing.assert_array_equal(read_recording(path, 1, 2).outputs[:, 0], 256 * counts[:, 1])


# Universal files


def test_universal_file_by_the_published_layout(tmp_path):
    path = tmp_path / "record.unv"
    units = (
        "    -1\n   164\n         1SI: Meter (newton)        2\n"
        "  1.0000000000000000D+00  1.0000000000000000D+00  1.0000000000000000D+00\n"
        "  2.7314999999999998D+02\n    -1\n"
    )
    path.write_text(units + uff_text(U, "torque") + uff_text(Y, "tip"))
    recording = read_recording(path, "torque", "tip")
    np.testing.assert_allclose(recording.output, Y, atol=1e-11)
    assert recording.sampling_rate == pytest.approx(RATE, rel=1e-12)
    assert recording.output_units[0] == "m/s^2"
    assert read_recording(path, 1, 2, 10.0).sampling_rate == 10.0
    assert "1 'torque', 2 'tip'" in refusal(path, "torque", "base")
    assert "stands at 2 datasets" in refusal(path, "12:Z+", "tip")
    assert "no dataset 3" in refusal(path, 1, 3)


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("even", [0, 1])
def test_universal_file_by_pyuff(tmp_path, binary, even):
    import pyuff

    path = tmp_path / "record.uff"
    file = pyuff.UFF(str(path))
    for name, values in (("torque", U), ("tip", Y)):
        dataset = pyuff.prepare_58(
            func_type=1, rsp_node=1, rsp_dir=1, ref_node=1, ref_dir=1, binary=binary, id1=name,
            data=values, x=T, abscissa_spacing=even, abscissa_spec_data_type=17,
            ordinate_spec_data_type=12, orddenom_spec_data_type=0,
        )  # fmt: skip
        file.write_sets(dataset, mode="add")
    recording = read_recording(path, "torque", "tip")
    np.testing.assert_allclose(recording.input, U, rtol=1e-11, atol=0)
    assert recording.sampling_rate == pytest.approx(RATE, rel=1e-5)


def test_universal_file_that_is_no_time_record(tmp_path):
    path = tmp_path / "record.uff"
    path.write_text(uff_text(U, "torque") + uff_text(Y, "response", function=4))
    assert "no real time record" in refusal(path, 1, 2)
    path.write_text("    -1\n   151\nmodel\n    -1\n")
    assert "no dataset of type 58" in refusal(path, 1, 2)
    short = uff_text(U, "torque").replace(f"{N:10d}", f"{N + 4:10d}")
    path.write_text(short + uff_text(Y, "tip"))
    assert "announces 244 values and 240" in refusal(path, 1, 2)


# Provenance


def test_description_of_the_source(tmp_path):
    import hashlib

    path = write_every_format(tmp_path)["npz"]
    channels = ChannelSettings(("u",), (2,), RATE, output_unit="m")
    recording, origin = read_measured(path, channels)
    assert describe_recording(recording, (origin,)) == RecordingInfo(
        samples=N,
        sampling_rate=RATE,
        inputs=(ChannelInfo("u", "", 0.0, np.mean(recording.input), np.std(recording.input)),),
        outputs=(ChannelInfo("y", "m", 0.0, np.mean(recording.output), np.std(recording.output)),),
        files=(
            FileOrigin(
                path=str(path),
                sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
                bytes=path.stat().st_size,
                format="numpy_files",
                inputs=("u",),
                outputs=(2,),
                samples=N,
            ),
        ),
    )
