"""Small recordings in every binary format, written for the tests."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat, wavfile

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.signals.reading import read_measured

N = 240
RATE = 250.0
T = np.arange(N) / RATE
U = np.random.default_rng(3).standard_normal(N)
Y = np.convolve(U, [0.0, 0.5, 0.25])[:N]


def read_recording(
    path,
    input,  # noqa: A002
    output,
    sampling_rate=None,
    input_unit="",
    output_unit="",
    **settings,
):
    """The recording of input and output, each a channel, a sequence of them or None."""
    listed = [
        () if each is None else (each,) if isinstance(each, int | str) else tuple(each)
        for each in (input, output)
    ]
    units = {"input_unit": input_unit, "output_unit": output_unit}
    channels = ChannelSettings(*listed, sampling_rate=sampling_rate, **units, **settings)
    return read_measured(path, channels)[0]


def assert_read(recording, rate=RATE):
    np.testing.assert_array_equal(recording.input, U)
    np.testing.assert_array_equal(recording.output, Y)
    assert recording.sampling_rate == pytest.approx(rate, rel=1e-9)


def refusal(path: Path, *channels, **settings) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(path, *(channels or (1, 2)), **({"sampling_rate": 1.0} | settings))
    message = str(caught.value)
    assert message.startswith(str(path))
    assert message.endswith(".")
    assert "\n" not in message
    return message


def write_matlab_73(path: Path, variables: dict[str, np.ndarray]) -> None:
    """As MATLAB does: HDF5 behind a block of 512 bytes, columns as rows, classes as attributes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            dataset = file.create_dataset(name, data=np.atleast_2d(values))
            dataset.attrs["MATLAB_class"] = np.bytes_("double")
        text = file.create_dataset("note", data=np.array([[72], [105]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_group("#refs#").create_dataset("a", data=np.arange(9.0))
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack(
        "<HH", 0x0200, 0x4D49
    )
    with path.open("r+b") as file:
        file.write(header)


def write_tdms(path: Path, **properties) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("run", "torque", U, {"unit_string": "N m"} | properties),
                ChannelObject("run", "speed", Y, properties),
                ChannelObject("spare", "speed", Y[::-1], properties),
            ]
        )


def uff_text(values: np.ndarray, name: str, rate: float = RATE, function: int = 1) -> str:
    """A dataset 58 written out by the published layout: double precision, even abscissa."""
    lines = [
        "    -1",
        "    58",
        *(text.ljust(80) for text in (name, "NONE", "21-NOV-24 10:00:00", "NONE", "NONE")),
        f"{function:5d}{1:10d}{0:5d}{0:10d} {'NONE':>10}{12:10d}{3:4d} {'NONE':>10}{0:10d}{0:4d}",
        f"{4:10d}{values.size:10d}{1:10d}{0.0:13.5e}{1.0 / rate:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':<20} {'m/s^2':<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
    ]
    rows = [
        "".join(f"{value:20.11e}" for value in values[start : start + 4])
        for start in range(0, values.size, 4)
    ]
    return "\n".join([*lines, *rows, "    -1", ""])


def write_every_format(folder: Path) -> dict[str, Path]:
    import h5py

    paths = {
        name: folder / f"record.{name}"
        for name in ("mat", "npz", "npy", "parquet", "h5", "tdms", "uff", "wav")
    }
    savemat(paths["mat"], {"u": U, "y": Y})
    write_matlab_73(folder / "new.mat", {"u": U, "y": Y})
    np.savez(paths["npz"], u=U, y=Y)
    np.save(paths["npy"], np.column_stack([U, Y]))
    pd.DataFrame({"u": U, "y": Y}).to_parquet(paths["parquet"])
    with h5py.File(paths["h5"], "w") as file:
        file["u"], file["y"] = U, Y
    write_tdms(paths["tdms"])
    paths["uff"].write_text(uff_text(U, "u") + uff_text(Y, "y"))
    wavfile.write(paths["wav"], round(RATE), np.column_stack([U, Y]))
    return paths | {"7.3 mat": folder / "new.mat"}
