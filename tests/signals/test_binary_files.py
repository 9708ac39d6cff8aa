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
    assert "different sampling rates" in refusal(path, "u", "y", sampling_rate=None)


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
        inputs=(ChannelInfo("u", "", 0.0),),
        outputs=(ChannelInfo("y", "m", 0.0),),
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
