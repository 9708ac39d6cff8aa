"""Binary files of pandas, MATLAB, Octave, netCDF and LabVIEW whose values need care."""

from __future__ import annotations

import shutil
import struct
import subprocess

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recorded_files import RATE, N, T, U, Y, assert_read, read_recording, refusal, write_matlab_73
from scipy import sparse
from scipy.io import savemat

from evopem.errors import InputError

# HDF5: values that are not all in the file


def hdf5(path, build):
    with h5py.File(path, "w") as file:
        file["y"] = Y
        build(file)
    return path


def virtual(source, name="u", stored=True):
    def build(file):
        layout = h5py.VirtualLayout(shape=(N,), dtype="f8")
        if stored:
            with h5py.File(source, "w") as other:
                other["u"] = U
        layout[:] = h5py.VirtualSource(source, name, shape=(N,))
        file.create_virtual_dataset("u", layout)

    return build


@pytest.mark.parametrize("stored", [True, False])
def test_a_virtual_dataset_of_another_file(tmp_path, stored):
    build = virtual(str(tmp_path / "other.h5"), stored=stored)
    message = refusal(hdf5(tmp_path / "r.h5", build), "u", "y")
    assert 'dataset "u": its values are stored in another file' in message


def test_a_virtual_dataset_of_the_same_file(tmp_path):
    def build(file):
        file["stored"] = U
        layout = h5py.VirtualLayout(shape=(N,), dtype="f8")
        layout[:] = h5py.VirtualSource(file["stored"])
        file.create_virtual_dataset("u", layout)
        layout = h5py.VirtualLayout(shape=(N,), dtype="f8")
        layout[:] = h5py.VirtualSource(".", "absent", shape=(N,))
        file.create_virtual_dataset("empty", layout)

    path = hdf5(tmp_path / "r.h5", build)
    assert_read(read_recording(path, "u", "y", RATE))
    assert 'its source "absent" is missing' in refusal(path, "empty", "y")


def test_raw_storage_in_another_file(tmp_path):
    raw = tmp_path / "raw.bin"
    raw.write_bytes(U.tobytes())

    def build(file):
        external = [(str(raw), 0, U.nbytes)]
        file.create_dataset("u", (N,), "f8", external=external)

    assert "stored in another file" in refusal(hdf5(tmp_path / "r.h5", build), "u", "y")


def test_links_to_other_files_are_no_datasets(tmp_path):
    def build(file):
        with h5py.File(tmp_path / "other.h5", "w") as other:
            other["u"] = U
        file["u"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "u")
        file["soft"] = h5py.SoftLink("/y")

    path = hdf5(tmp_path / "r.h5", build)
    assert "there is no dataset" in refusal(path, "u", "y")
    assert "there is no dataset" in refusal(path, "soft", "y")


def test_values_that_were_never_written(tmp_path):
    def build(file):
        file.create_dataset("u", (N,), "f8")
        file.create_dataset("half", (N,), "f8", chunks=(N // 4,))[: N // 2] = U[: N // 2]
        file.create_dataset("late", (N,), "f8", chunks=(N // 4,), compression="gzip")[:] = U

    path = hdf5(tmp_path / "r.h5", build)
    assert "its values were never written" in refusal(path, "u", "y")
    assert "only 2 of its 4 chunks were written" in refusal(path, "half", "y")
    assert_read(read_recording(path, "late", "y", RATE))


def test_packed_and_missing_values_of_netcdf(tmp_path):
    def build(file):
        counts = np.round(1000 * U).astype("i2")
        for name in ("packed", "plain", "filled"):
            file[name] = counts
        file["packed"].attrs.update(scale_factor=1e-3, add_offset=0.0)
        file["plain"].attrs.update(scale_factor=1.0, add_offset=0.0, _FillValue=np.int16(-32767))
        file["filled"][7] = -32767
        file["filled"].attrs["_FillValue"] = np.array([-32767], "i2")
        file["marked"] = np.where(np.arange(N) == 9, -999.0, U)
        file["marked"].attrs["missing_value"] = -999.0
        file["default"] = np.where(np.arange(N) == 9, np.float32(9.96921e36), U)

    path = hdf5(tmp_path / "r.h5", build)
    assert "packed: the attribute scale_factor is 0.001" in refusal(path, "packed", "y")
    assert read_recording(path, "filled", "y", RATE).samples == N - 8
    assert read_recording(path, "marked", "y", RATE).samples == N - 10
    assert read_recording(path, "default", "y", RATE).samples == N - 10
    assert read_recording(path, "plain", "y", RATE).samples == N


def test_records_and_complex_numbers(tmp_path):
    def build(file):
        file["run/table"] = np.rec.fromarrays([T, U, Y], names="t,u,y")
        file["z"] = U + 1j * Y
        file["flags"] = U > 0

    path = hdf5(tmp_path / "r.h5", build)
    assert_read(read_recording(path, "run/table.u", "run/table.y", time="run/table.t"))
    assert "complex numbers" in refusal(path, "z", "y")
    assert set(read_recording(path, "flags", "y", RATE).input) == {0.0, 1.0}


# pandas


@pytest.mark.parametrize("data_columns", [True, False])
def test_hdf5_tables_of_pandas(tmp_path, data_columns):
    pytest.importorskip("tables", reason="PyTables writes the file")
    path = tmp_path / "record.h5"
    frame = pd.DataFrame({"u": U, "y": Y})
    frame.to_hdf(path, key="run", format="table", data_columns=data_columns or None)
    names = ("run/table.u", "run/table.y")
    if not data_columns:
        names = ("run/table.values_block_0:1", "run/table.values_block_0:2")
    assert_read(read_recording(path, *names, RATE))


def test_indices_of_pandas(tmp_path):
    path = tmp_path / "record.parquet"
    frame = pd.DataFrame({"u": U, "y": Y})
    # The hour of this date is on the clock twice in Berlin.
    dates = pd.date_range("2024-10-27 00:59:59.9", periods=N, freq="4ms", tz="UTC")
    frame.index = dates.tz_convert("Europe/Berlin")
    frame.to_parquet(path)
    assert_read(read_recording(path, "u", "y", time="__index_level_0__"))
    frame.set_index(pd.to_timedelta(T, unit="s").rename("t")).to_parquet(path)
    assert_read(read_recording(path, "u", "y", time="t"))
    assert "text or objects, not real numbers" in refusal(path, "t", "y")


def test_kinds_of_parquet_columns(tmp_path):
    path = tmp_path / "record.parquet"
    nested = pa.array([{"u": u} for u in U.tolist()])
    table = {
        "u": pa.array(U).dictionary_encode(), "y": Y, "nested": nested, "nested.u": Y[::-1],
        "nan": np.where(np.arange(N) == 4, np.nan, U), "list": pa.array([[u] for u in U.tolist()]),
    }  # fmt: skip
    pq.write_table(pa.table(table), path)
    assert_read(read_recording(path, "u", "y", RATE))
    for name in ("nested", "list"):
        assert "text or objects" in refusal(path, name, "y")
    assert read_recording(path, "nan", "y", RATE).samples == N - 5


# numpy


def test_times_of_numpy(tmp_path):
    path = tmp_path / "record.npz"
    dates = np.datetime64("2024-01-01", "us") + (1e6 * T).astype("m8[us]")
    np.savez(path, u=U, y=Y, dates=dates, durations=(1e9 * T).astype("m8[ns]"))
    assert_read(read_recording(path, "u", "y", time="dates"))
    assert_read(read_recording(path, "u", "y", time="durations"))
    assert "dates, not real numbers" in refusal(path, "dates", "y")


# MATLAB and Octave


def test_simulink_structure_with_time(tmp_path):
    path = tmp_path / "record.mat"
    signals = {"values": np.column_stack([U, Y]), "label": "bench", "dimensions": 2.0}
    savemat(path, {"simout": {"time": T[:, None], "signals": signals, "blockName": "m/Out"}})
    names = ("simout.signals.values:1", "simout.signals.values:2")
    assert_read(read_recording(path, *names, time="simout.time"))


def test_simulink_to_file_matrix(tmp_path):
    path = tmp_path / "record.mat"
    savemat(path, {"ans": np.vstack([T, U, Y])})
    assert_read(read_recording(path, "ans:2", "ans:3", time="ans:1"))


def test_matlab_structure_arrays_sparse_matrices_and_cells(tmp_path):
    path = tmp_path / "record.mat"
    runs = np.array([(U, Y), (U, Y)], dtype=[("u", object), ("y", object)])
    savemat(path, {"runs": runs, "s": sparse.csc_matrix(U[:, None]), "y": Y, "c": [U, "text"]})
    for name in ("runs.u", "s", "c"):
        assert name in refusal(path, name, "y")


def test_matlab_73_empty_sparse_and_complex_variables(tmp_path):
    path = tmp_path / "record.mat"
    write_matlab_73(path, {"u": U, "y": Y})
    with h5py.File(path, "r+") as file:
        empty = file.create_dataset("empty", data=np.array([0, 0], np.uint64))
        empty.attrs["MATLAB_empty"] = np.uint8(1)
        group = file.create_group("s")
        group.attrs["MATLAB_sparse"] = np.uint64(N)
        group["data"], group["ir"], group["jc"] = U, np.arange(N), np.array([0, N])
        pairs = np.zeros((1, N), dtype=[("real", "f8"), ("imag", "f8")])
        pairs["real"], pairs["imag"] = U, Y
        file["z"] = pairs
    assert path.read_bytes()[:19] == b"MATLAB 7.3 MAT-file"
    assert_read(read_recording(path, "u", "y", RATE))
    message = refusal(path, "empty", "y")
    assert "choose one of 1 'u', 2 'y', 3 'z'" in message
    assert "complex numbers" in refusal(path, "z", "y")


OCTAVE = shutil.which("octave-cli") or shutil.which("octave")


@pytest.mark.skipif(OCTAVE is None, reason="needs octave")
def test_files_that_octave_wrote(tmp_path):
    (tmp_path / "u.bin").write_bytes(struct.pack(f"<{2 * N}d", *U, *Y))
    script = (
        f"f = fopen('u.bin'); d = fread(f, [{N}, 2], 'double'); u = d(:, 1); y = d(:, 2);"
        f"fs = {RATE}; t = (0:{N - 1})' / fs; r.u = u; r.y = y; r.fs = 100; s.u = u; s.y = y;"
        "save -v4 v4.mat u y t fs\n save -v6 v6.mat u y t fs r s\n save -v7 v7.mat u y t fs r s\n"
        "save -hdf5 h.h5 u y t\n save -text two.txt u y\n save -text one.txt d\n"
        "dlmwrite('d.csv', d, 'precision', 17)\n"
    )
    command = [OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", script]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    for name in ("v4.mat", "v6.mat", "v7.mat"):
        assert_read(read_recording(tmp_path / name, "u", "y"))
        assert_read(read_recording(tmp_path / name, "u", "y", time="t"))
    assert_read(read_recording(tmp_path / "v7.mat", "r.u", "r.y"), 100.0)
    assert_read(read_recording(tmp_path / "v7.mat", "s.u", "s.y"))
    assert_read(read_recording(tmp_path / "h.h5", "u/value", "y/value", time="t/value"))
    assert_read(read_recording(tmp_path / "one.txt", 1, 2, RATE))
    assert_read(read_recording(tmp_path / "d.csv", 1, 2, RATE))
    with pytest.raises(InputError, match="begin another table"):
        read_recording(tmp_path / "two.txt", 1, 2, RATE)


# Input, output and time


def test_two_channels_with_the_same_values(tmp_path):
    table = tmp_path / "record.csv"
    pd.DataFrame({"u": U, "y": Y, "v": U, "t": T, "w": T}).to_csv(table, index=False)
    assert "the input (1) and the output ('u') hold the same" in refusal(table, 1, "u")
    assert "the input ('t') and the time (4) hold the same" in refusal(table, "t", "y", time=4)
    assert "the output ('w') and the time" in refusal(table, "u", "w", time="t")
    assert "the input ('u') and the output ('v')" in refusal(table, "u", "v")
    archive = tmp_path / "record.npz"
    np.savez(archive, u=U, y=Y, v=U.astype(np.float64))
    assert "hold the same values" in refusal(archive, "u", "v")
    assert "hold the same values" in refusal(archive, 1, "u")
    assert_read(read_recording(archive, "u", 2, RATE))


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e6, 1e9])
def test_a_time_that_is_chosen_as_a_signal(tmp_path, scale):
    path = tmp_path / "record.npz"
    np.savez(path, t=3.5 + scale * T.round(4), u=U, y=Y, ramp=0.7 * T)
    message = refusal(path, "t", "y", sampling_rate=RATE)
    assert 'input "t": the channel increases by the sampling period' in message
    assert 'output "t"' in refusal(path, "u", "t", sampling_rate=RATE)
    assert read_recording(path, "ramp", "y", RATE).samples == N
