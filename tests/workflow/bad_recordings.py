"""Recordings that cannot be used, made by code: each with the sentence that it must get.

A maker writes its file into a folder and returns the keys of its data set.
"""

import io
import pickle
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

GENERATOR = np.random.default_rng(0)
GOOD = GENERATOR.standard_normal((900, 2))
TIMES = np.arange(900) / 100.0


@dataclass(frozen=True)
class Bad:
    """A bad recording: what is in the file, the keys of its data set, and what must be said."""

    says: str
    content: Any = None
    name: str = ""
    keys: dict[str, Any] = field(default_factory=dict)


def text(rows, separator=","):
    return "\n".join(separator.join(f"{value:.9g}" for value in row) for row in rows)


def with_line(number, line):
    lines = text(GOOD).splitlines()
    lines[number - 1] = line
    return "\n".join(lines)


def scaled(input_scale, output_scale):
    return text(GOOD * [input_scale, output_scale])


def timed(stamps):
    return text(np.column_stack([stamps, GOOD]))


def moved(index, value):
    stamps = TIMES.copy()
    stamps[index] = value
    return timed(stamps)


def mat(**variables):
    stream = io.BytesIO()
    scipy.io.savemat(stream, variables)
    return stream.getvalue()


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def hdf5(build):
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        build(file)
    return stream.getvalue()


def hdf5_of_two(file):
    file["bench/input"] = GOOD[:, 0]
    file["bench/output"] = GOOD[:, 1]


def parquet(output):
    import pyarrow as pa
    import pyarrow.parquet as pq

    stream = io.BytesIO()
    pq.write_table(pa.table({"input": GOOD[:, 0], "output": output}), stream)
    return stream.getvalue()


def tdms():
    import nptdms

    stream = io.BytesIO()
    with nptdms.TdmsWriter(stream) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("bench", name, GOOD[:, i]) for i, name in enumerate("uy")]
        )
    return stream.getvalue()


def archive(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        for name, content in members.items():
            packed.writestr(name.replace("__", "/"), content)
    return stream.getvalue()


def encrypted_archive():
    """An archive whose members are marked as encrypted, as `zip --encrypt` leaves it."""
    content = bytearray(npz(input=GOOD[:, 0], output=GOOD[:, 1]))
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = content.find(signature)
        while place >= 0:
            content[place + offset] |= 1
            place = content.find(signature, place + 4)
    return bytes(content)


PAYLOAD_RAN = "the-payload-ran"


class Payload:
    """An object that runs code of its own when it is unpickled."""

    def __reduce__(self):
        return (Path(PAYLOAD_RAN).touch, ())


def with_payload(member=""):
    """numpy's own format around a pickle that leaves a file behind when it is loaded."""
    stream = io.BytesIO()
    array = np.array([Payload()], dtype=object)
    if member:
        np.savez(stream, allow_pickle=True, **{member: array, "output": GOOD[:, 1]})
    else:
        np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


RATE = {"sampling_rate": 100}
NAMED = {"input": "input", "output": "output"}
CLOCK = {"time": 1, "input": 2, "output": 3}
RAMP = np.column_stack([GOOD[:, 0], np.arange(900.0)])
SATURATED = np.column_stack([GOOD[:, 0], np.clip(GOOD[:, 1], -0.05, 0.05)])
HELD = np.column_stack([GOOD[:, 0], np.where(np.arange(900) < 80, GOOD[:, 1], 0.25)])
GAP = np.concatenate([TIMES[:500], TIMES[500:] + 3.0])
UNEVEN = TIMES + 0.004 * GENERATOR.random(900)

BAD = {
    # Files that are not there, not files, or not what they seem.
    "missing": Bad("missing.csv: there is no such file; check the path"),
    "empty": Bad("empty.csv: the file is empty", b""),
    "blank": Bad("blank.csv: holds no rows of numbers", " \n\n\t\n"),
    "header_only": Bad("header_only.csv, line 1: holds no row of numbers", "input,output\n"),
    "prose": Bad("prose.csv, line 1: holds no row of numbers", "Dear all,\nplease find it here\n"),
    "binary": Bad("binary.csv, line 1: is not a text file", bytes(range(256)) * 9),
    "nul_byte": Bad("nul_byte.csv, line 5: is not a text file", with_line(5, "0.5\x00,1")),
    "folder": Bad("folder.csv: is not a file", {}),
    "program": Bad('program.exe: the extension ".exe" is none', b"MZ\x90", "program.exe"),
    "no_extension": Bad('bench: the extension "" is none', text(GOOD), "bench"),
    "workbook": Bad(
        'workbook.xlsm: the extension ".xlsm" is none',
        archive(xl__workbook_xml="<x/>", xl__vbaProject_bin="macro"),
        "workbook.xlsm",
    ),
    "disguised_workbook": Bad(
        "disguised_workbook.csv: its content is zip",
        archive(xl__workbook_xml="<x/>", xl__vbaProject_bin="macro"),
    ),
    "pickle": Bad("pickle.dat, line 1: is not a text file", pickle.dumps(Payload()), "pickle.dat"),
    "formula": Bad(
        "formula.csv, line 12, column 2: \"=cmd|'/C calc'!A0\" is not",
        with_line(12, "0.5,=cmd|'/C calc'!A0"),
    ),
    # Tables that are broken.
    "words": Bad('words.csv, line 40, column 2: "high" is not', with_line(40, "0.5,high")),
    "short_row": Bad("short_row.csv, line 70: the row has 1 field", with_line(70, "0.5")),
    "long_row": Bad("long_row.csv, line 70: the row has 3 fields", with_line(70, "1,2,3")),
    "truncated": Bad("truncated.csv, line 900: the row has 1 field", with_line(900, "0.12")),
    "second_header": Bad(
        'second_header.csv, line 300, column 1: "input" is not', with_line(300, "input,output")
    ),
    "nan": Bad(
        'output "output", sample 1: the value is missing',
        text(np.where(np.arange(900)[:, None] % 5 == 0, [1.0, np.nan], GOOD)),
    ),
    "overflow": Bad('overflow.csv, line 9, column 1: "1e999" is not', with_line(9, "1e999,1")),
    "complex_text": Bad(
        'complex_text.csv, line 3, column 1: "1+2j" is not', with_line(3, "1+2j,1")
    ),
    "two_commas": Bad(
        "two_commas.csv, line 2: the comma seems to be both",
        "input,output\n" + text(GOOD.round(3)).replace(".", ","),
    ),
    "thousands": Bad(
        "may mean a decimal comma or a thousands separator",
        "\n".join(f"{1000 + i:,};{2000 + 7 * i % 900:,}" for i in range(900)),
    ),
    "one_column": Bad("one_column.csv: there is no column 2 among its 1", text(GOOD[:, :1])),
    "no_such_column": Bad(
        "there is no column 7 among its 2; choose 1 to 2", text(GOOD), keys={"output": 7}
    ),
    "misspelt_column": Bad(
        "there is no column \"torqe\"; choose one of 1 'torque', 2 'acceleration'",
        "torque,acceleration\n" + text(GOOD),
        keys={"input": "torqe"},
    ),
    "no_header": Bad('there is no column "torque", because', text(GOOD), keys={"input": "torque"}),
    "twins": Bad('the name "x" stands at 2 columns', "x,x\n" + text(GOOD), keys={"input": "x"}),
    # Clocks.
    "no_rate": Bad("the sampling rate is not known", text(GOOD), keys={"sampling_rate": None}),
    "repeated_time": Bad("time, sample 301: the time does not", moved(300, TIMES[299]), keys=CLOCK),
    "backward_time": Bad("time, sample 301: the time does not", moved(300, TIMES[200]), keys=CLOCK),
    "time_gap": Bad("time, sample 501: the step to this sample is 3.01", timed(GAP), keys=CLOCK),
    "uneven_time": Bad("where the usual one is", timed(UNEVEN), keys=CLOCK),
    "nan_time": Bad(
        "nan_time.csv, time, sample 300: the time stamp is nan", moved(299, np.nan), keys=CLOCK
    ),
    "unknown_unit": Bad(
        "the time stamps are whole numbers 10 apart",
        timed(np.arange(900) * 10),
        keys=CLOCK,
    ),
    # Signals that nothing can be identified from.
    "constant": Bad("every sample is 3, so there is nothing", text(GOOD * [1, 0] + [0, 3])),
    "zeros": Bad("every sample is 0, so there is nothing", text(GOOD * [0, 1])),
    "saturated": Bad("of its samples lie at its smallest or largest value", text(SATURATED)),
    "held": Bad("of its samples are the same value", text(HELD)),
    "huge": Bad("leave the range of numbers", scaled(1, 1e300)),
    "tiny": Bad("leave the range of numbers", scaled(1e-300, 1)),
    "huge_over_tiny": Bad("leave the range of numbers", scaled(1e-90, 1e90)),
    "one_sample": Bad("there are only 1 samples", text(GOOD[:1])),
    "five_samples": Bad("there are only 5 samples", text(GOOD[:5])),
    # Records too short for what is asked of them, or transforms that leave nothing.
    "too_short": Bad("orders: the largest model has 12 parameters and 32", text(GOOD[:40])),
    "all_discarded": Bad(
        "split.discard: 900 samples are to be discarded and there are only 900",
        text(GOOD),
        keys={"split": {"discard": 900}},
    ),
    "split_beyond_the_end": Bad(
        "split.estimation: 901 samples are asked for and 900 remain",
        text(GOOD),
        keys={"split": {"estimation": 901}},
    ),
    "nothing_to_validate": Bad(
        "so none remain to validate on", text(GOOD), keys={"split": {"estimation": 900}}
    ),
    "hardly_validated": Bad(
        "split: 10 validation samples are left and more than 18 are needed",
        text(GOOD),
        keys={"split": {"estimation": 890}},
    ),
    "differenced_away": Bad(
        "so there is nothing to identify", text(RAMP), keys={"transforms": {"difference": 2}}
    ),
    "box_cox_flat": Bad(
        "transforms.box_cox: the parameter -80 flattens",
        text(GOOD + 40),
        keys={"transforms": {"box_cox": -80}},
    ),
    "box_cox_auto": Bad(
        "transforms.box_cox: no parameter between -5 and 5",
        text(np.column_stack([GOOD[:, 0], np.abs(GOOD[:, 1]) ** 0.05])),
        keys={"transforms": {"box_cox": "auto"}},
    ),
    "upsampled": Bad("resample: 250 Hz is above", text(GOOD), keys={"resample": 250}),
    "odd_ratio": Bad(
        "not in the ratio of whole numbers", text(GOOD), keys={"resample": 31.41592653}
    ),
    # MATLAB.
    "mat_damaged": Bad(
        "mat_damaged.mat: is not a readable MATLAB file",
        b"MATLAB 5.0 MAT-file" + bytes(300),
        "mat_damaged.mat",
    ),
    "mat_truncated": Bad(
        "mat_truncated.mat: is not a readable MATLAB file",
        mat(input=GOOD[:, 0], output=GOOD[:, 1])[:-4000],
        "mat_truncated.mat",
        NAMED,
    ),
    "mat_cells": Bad(
        'variable "input": it is no signal but',
        mat(input=np.array([GOOD[:, 0], "x"], dtype=object), output=GOOD[:, 1]),
        "mat_cells.mat",
        NAMED,
    ),
    "mat_text": Bad(
        'variable "input": it is no signal but',
        mat(input="words", output=GOOD[:, 1]),
        "t.mat",
        NAMED,
    ),
    "mat_complex": Bad(
        'output "output": the channel holds complex numbers',
        mat(input=GOOD[:, 0], output=GOOD[:, 1] + 1j),
        "mat_complex.mat",
        NAMED,
    ),
    "mat_lengths": Bad(
        "mat_lengths.mat: the input has 900 samples and the output 700",
        mat(input=GOOD[:, 0], output=GOOD[:700, 1]),
        "mat_lengths.mat",
        NAMED,
    ),
    "mat_no_variable": Bad(
        'mat_no_variable.mat: there is no variable "output"',
        mat(input=GOOD[:, 0]),
        "mat_no_variable.mat",
        NAMED,
    ),
    "mat_matrix": Bad(
        'variable "both": it is a matrix, 900 x 2',
        mat(both=GOOD),
        "mat_matrix.mat",
        {"input": "both", "output": "both:2"},
    ),
    # numpy, HDF5, Parquet, TDMS, universal files.
    "npz_pickle": Bad(
        'array "input": it is no signal but', with_payload("input"), "npz_pickle.npz", NAMED
    ),
    "npy_pickle": Bad("npy_pickle.npy: is not a readable numpy", with_payload(), "npy_pickle.npy"),
    "npz_truncated": Bad(
        "npz_truncated.npz: is not a readable numpy",
        npz(input=GOOD[:, 0], output=GOOD[:, 1])[:5000],
        "npz_truncated.npz",
        NAMED,
    ),
    "npz_encrypted": Bad(
        "npz_encrypted.npz: is not a readable numpy",
        encrypted_archive(),
        "npz_encrypted.npz",
        NAMED,
    ),
    "hdf5_no_path": Bad(
        'hdf5_no_path.h5: there is no dataset "bench/outputs"',
        hdf5(hdf5_of_two),
        "hdf5_no_path.h5",
        {"input": "bench/input", "output": "bench/outputs"},
    ),
    "hdf5_group": Bad(
        'hdf5_group.h5: there is no dataset "bench"',
        hdf5(hdf5_of_two),
        "hdf5_group.h5",
        {"input": "bench", "output": "bench/output"},
    ),
    "hdf5_truncated": Bad(
        "hdf5_truncated.h5: is not a readable HDF5", hdf5(hdf5_of_two)[:3000], "hdf5_truncated.h5"
    ),
    "parquet_null": Bad(
        'output "output", sample 1: the value is missing; without the 180 such samples',
        parquet([None if k % 5 == 0 else value for k, value in enumerate(GOOD[:, 1])]),
        "parquet_null.parquet",
        NAMED,
    ),
    "parquet_truncated": Bad(
        "parquet_truncated.parquet: is not a readable Parquet",
        parquet(GOOD[:, 1])[:2000],
        "parquet_truncated.parquet",
        NAMED,
    ),
    "parquet_encrypted": Bad(
        "parquet_encrypted.parquet: is not a readable Parquet",
        b"PARE" + parquet(GOOD[:, 1])[4:-4] + b"PARE",
        "parquet_encrypted.parquet",
        NAMED,
    ),
    "tdms_truncated": Bad("tdms_truncated.tdms: ", tdms()[:-900], "tdms_truncated.tdms"),
    "uff_truncated": Bad(
        "uff_truncated.uff: does not end with the line -1",
        "    -1\n    58\n" + "x\n" * 30,
        "uff_truncated.uff",
    ),
    # Validation files.
    "validation_missing": Bad(
        "elsewhere.csv: there is no such file",
        text(GOOD),
        keys={"validation_file": "elsewhere.csv"},
    ),
    "validation_short": Bad(
        "split: 12 validation samples are left and more than 18 are needed",
        text(GOOD),
        keys={"validation_file": "brief.csv"},
    ),
    "validation_flat": Bad(
        "so there is nothing to identify", text(GOOD), keys={"validation_file": "flat.csv"}
    ),
}

OTHER = GENERATOR.standard_normal((900, 2))
VALIDATION_FILES = {"brief.csv": text(OTHER[:12]), "flat.csv": text(OTHER * [1, 0])}


def write(folder, name, bad):
    """Write a bad recording into a folder, and give the keys of its data set."""
    file = folder / (bad.name or f"{name}.csv")
    if isinstance(bad.content, bytes):
        file.write_bytes(bad.content)
    elif isinstance(bad.content, str):
        file.write_text(bad.content, encoding="utf-8")
    elif isinstance(bad.content, dict):
        file.mkdir()
    rate = {} if "time" in bad.keys else RATE
    keys = {key: value for key, value in (rate | bad.keys).items() if value is not None}
    return {"file": file.name, **keys}
