"""Files that are truncated, damaged or of another format, and libraries that are missing."""

from __future__ import annotations

import contextlib
import sys

import numpy as np
import pytest
from recorded_files import RATE, N, read_recording, refusal, write_every_format

from evopem.errors import InputError

FORMATS = ("mat", "7.3 mat", "npz", "npy", "parquet", "h5", "tdms", "uff", "wav")


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9, 0.99])
def test_truncated_files_are_refused(tmp_path, form, share):
    path = write_every_format(tmp_path)[form]
    whole = path.read_bytes()
    assert read_recording(path, 1, 2, RATE).samples == N
    path.write_bytes(whole[: int(share * len(whole))])
    refusal(path)


@pytest.mark.parametrize("form", FORMATS)
def test_empty_and_random_files_are_refused(tmp_path, form):
    path = write_every_format(tmp_path)[form]
    path.write_bytes(b"")
    assert "empty" in refusal(path)
    path.write_bytes(np.random.default_rng(5).bytes(5000))
    refusal(path)
    path.write_text("time,u,y\n0,1,2\n" * 500)
    refusal(path)


def test_damaged_bytes_of_matlab_7_3_never_end_in_a_traceback(tmp_path):
    """Those of all other formats: tests/fuzz/test_corpus.py."""
    path = write_every_format(tmp_path)["7.3 mat"]
    whole = path.read_bytes()
    generator = np.random.default_rng(7)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in generator.integers(0, min(len(whole), 1500), 4):
            damaged[place] = int(generator.integers(0, 256))
        path.write_bytes(bytes(damaged))
        with contextlib.suppress(InputError):
            read_recording(path, 1, 2, RATE)


@pytest.mark.parametrize(
    ("form", "module"),
    [
        ("7.3 mat", "h5py"),
        ("h5", "h5py"),
        ("parquet", "pyarrow"),
        ("tdms", "nptdms"),
        ("uff", "pyuff"),
    ],
)
def test_a_missing_library_names_the_extra(tmp_path, monkeypatch, form, module):
    path = write_every_format(tmp_path)[form]
    monkeypatch.setitem(sys.modules, module, None)
    message = refusal(path)
    assert f"the package {module}" in message
    assert 'pip install "evopem[formats]"' in message


def test_dates_in_a_text_name_the_extra_that_reads_them(tmp_path, monkeypatch):
    path = tmp_path / "dated.csv"
    rows = [f"2024-05-31T12:00:{second:02},{second % 7},{second % 5}" for second in range(40)]
    path.write_text("\n".join(["time,u,y", *rows]))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"the package pandas, .*evopem\[formats\]"):
        read_recording(path, "u", "y", time="time")
