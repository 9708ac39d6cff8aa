"""Text tables, written as instruments and spreadsheets write them."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recorded_files import read_recording, write_every_format

from evopem.errors import InputError

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"
N = 50
U = np.sin(0.7 * np.arange(N)) * 3.25
Y = np.cos(0.3 * np.arange(N)) - 0.125
T = np.arange(N) / 200.0


def write(tmp_path: Path, text: str | bytes, name: str = "record.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def table(separator: str, decimal: str = ".", header: str = "", end: str = "\n") -> str:
    rows = [
        separator.join(repr(float(v)).replace(".", decimal) for v in row)
        for row in zip(U, Y, strict=True)
    ]
    return header + end.join(rows) + end


@pytest.mark.parametrize("separator", [",", ";", "\t", "  ", ", ", " ; ", " \t "])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_separators_and_line_ends(tmp_path, separator, end):
    recording = read_recording(write(tmp_path, table(separator, end=end)), 2, 1, 10.0)
    np.testing.assert_array_equal(recording.input, Y)
    np.testing.assert_array_equal(recording.output, U)
    assert (recording.input_names[0], recording.sampling_rate) == ("input", 10.0)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_comma(tmp_path, separator):
    recording = read_recording(write(tmp_path, table(separator, decimal=",")), 1, 2, 1.0)
    np.testing.assert_array_equal(recording.input, U)


def test_decimal_comma_within_quotes(tmp_path):
    rows = "".join(f'"{u:.6f}","{y:.6f}"\n'.replace(".", ",") for u, y in zip(U, Y, strict=True))
    recording = read_recording(write(tmp_path, "u,y\n" + rows), "u", "y", 1.0)
    np.testing.assert_allclose(recording.output, Y, atol=5e-7)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_pandas_tables_with_a_header(tmp_path, separator, decimal):
    frame = pd.DataFrame({"time": T, "torque [N m]": U, "acceleration": Y, "note": "ok"})
    path = tmp_path / "record.csv"
    quoting = 1 if separator == decimal == "," else 0
    frame.to_csv(path, sep=separator, decimal=decimal, index=False, quoting=quoting)
    if quoting:
        # pandas does not write decimal commas into a comma-separated file unquoted.
        assert '"' in path.read_text()
    recording = read_recording(path, "torque [N m]", "acceleration", time="time")
    np.testing.assert_array_equal(recording.input, U)
    assert recording.sampling_rate == 200.0
    assert recording.output_names[0] == "acceleration"


def test_numpy_text_with_its_comment_header(tmp_path):
    path = tmp_path / "record.txt"
    np.savetxt(path, np.column_stack([U, Y]), header="made today\nspeed tip")
    recording = read_recording(path, "speed", "tip", 1.0)
    np.testing.assert_array_equal(recording.input, U)


def test_preamble_header_and_units(tmp_path):
    text = "Data logger 7\nSerial;12;x\n\ntime;force;speed\ns;N;m/s²\n" + "".join(
        f"{t:.3f};{u:.9f};{y:.9f}\n" for t, u, y in zip(T, U, Y, strict=True)
    )
    path = write(tmp_path, text.encode("latin-1"))
    recording = read_recording(path, "force", "speed", time="time")
    assert (recording.input_units[0], recording.output_units[0]) == ("N", "m/s²")
    assert recording.sampling_rate == 200.0
    np.testing.assert_allclose(recording.output, Y, atol=1e-9)
    assert read_recording(path, 2, 3, 1.0, output_unit="km/h").output_units == ("km/h",)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks(tmp_path, encoding):
    path = write(tmp_path, table(",", header="μ,y\n").encode(encoding))
    assert read_recording(path, "μ", "y", 1.0).input_names[0] == "μ"


def test_comments_blank_lines_and_a_closing_separator(tmp_path):
    text = "% one\n\n" + table("\t").replace("\n", "\t\n") + "\n# end\n"
    recording = read_recording(write(tmp_path, text, "r.dat"), 1, 2, 1.0)
    np.testing.assert_array_equal(recording.output, Y)


def test_fortran_exponents(tmp_path):
    text = "".join(f"{u:.12E} {y:.12E}\n".replace("E", "D") for u, y in zip(U, Y, strict=True))
    recording = read_recording(write(tmp_path, text, "r.dat"), 1, 2, 1.0)
    np.testing.assert_allclose(recording.input, U, rtol=1e-12)


@pytest.mark.parametrize("blank", ["T", " "])
@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_as_time(tmp_path, blank, zone):
    stamps = pd.date_range("2024-03-30 23:59:59.900", periods=N, freq="5ms")
    text = "when,u,y\n" + "".join(
        f"{s.strftime('%Y-%m-%d')}{blank}{s.strftime('%H:%M:%S.%f')}{zone},{u!r},{y!r}\n"
        for s, u, y in zip(stamps, U.tolist(), Y.tolist(), strict=True)
    )
    recording = read_recording(write(tmp_path, text), "u", "y", time="when")
    assert recording.sampling_rate == pytest.approx(200.0, rel=1e-9)


@pytest.mark.parametrize(
    ("form", "separator"),
    [("%H:%M:%S.%f", ","), ("%d.%m.%Y %H:%M:%S,%f", ";"), ("%Y/%m/%d %H:%M:%S.%f", ",")],
)
def test_times_of_day_and_dates_with_points(tmp_path, form, separator):
    stamps = pd.date_range("2024-03-12 09:59:59.900", periods=N, freq="5ms")
    text = separator.join(("when", "u", "y\n")) + "".join(
        f"{stamp.strftime(form)}{separator}{u!r}{separator}{y!r}\n"
        for stamp, u, y in zip(stamps, U.tolist(), Y.tolist(), strict=True)
    )
    if form[0:2] == "%H":
        text = text.replace("\n09:", "\n9:")
    recording = read_recording(write(tmp_path, text), "u", "y", time="when")
    assert recording.sampling_rate == pytest.approx(200.0, rel=1e-9)


def test_dates_of_which_day_and_month_are_not_certain_are_refused(tmp_path):
    rows = "".join(f"05/06/2024 12:00:{second:02d},{second},1\n" for second in range(60))
    with pytest.raises(InputError, match=r"line 2, column 1: .* is no date of a known form; write"):
        read_recording(write(tmp_path, f"when,u,y\n{rows}"), "u", "y", time="when")


def refusal(path: Path, *channels, **settings) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(path, *(channels or (1, 2)), **({"sampling_rate": 1.0} | settings))
    message = str(caught.value)
    assert message.startswith(str(path))
    assert message.endswith(".")
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "empty"),
        ("\n\n  \n", "no rows of numbers"),
        ("# only\n# comments\n", "no rows of numbers"),
        ("some words\nand more words\n", "no row of numbers"),
        (b"\x00\x01\x02\xff" * 50, "not a text file"),
        (b"1,2\n3,\x004\n", "line 2"),
        ("3,2\n3,4\n5\n" + "6,7\n" * 9, "line 3: the row has 1 fields where the others have 2"),
        ("3,2\n3,4\n5,6,7\n" + "6,7\n" * 9, "line 3"),
        ("1.5,2\n" * 9 + "1.5", "line 10"),
        ("1.5,2\n" * 9 + "1.5,\n", 'output "output", sample 10: the value is missing'),
        ("u,y\n" + "1.5,2\n" * 5 + "1.5,bad\n" + "1,2\n" * 9, 'line 7, column 2: "bad"'),
        ("1.5,2\n" * 5 + "1_5,2\n" + "1,2\n" * 9, 'line 6, column 1: "1_5"'),
        ("1.5,2\n" * 5 + "NaN,2\n" + "1,2\n" * 9, 'input "input", sample 6: the value is missing'),
        ("1.5;2\n" * 5 + "1;-inf\n" + "1;2\n" * 9, 'output "output", sample 6: the value is -inf'),
        ("1,234;2,345\n" * 9, "decimal comma or a thousands separator"),
        ("1,234 2,345\n" * 9, "decimal comma or a thousands separator"),
        ("1.234,5;2\n" * 9, 'column 1: "1.234,5"'),
        ("u,y\n" + "1,5,2,7\n" * 9, "both the separator and the decimal mark"),
        ("0,5,2,05\n" * 9, "both the separator and the decimal mark"),
        ("-0,5,2,7\n" * 9, "both the separator and the decimal mark"),
    ],
)
def test_what_is_no_table_is_refused_in_one_sentence(tmp_path, text, expected):
    assert expected in refusal(write(tmp_path, text))


def test_unknown_columns_list_what_is_there(tmp_path):
    path = write(tmp_path, table(",", header="speed,tip\n"))
    assert "1 'speed', 2 'tip'" in refusal(path, "sped", "tip")
    assert "no column 3 among its 2" in refusal(path, 1, 3)
    assert "no column 0" in refusal(path, 0, 1)
    assert "input and as the output" in refusal(path, 1, 1)
    bare = write(tmp_path, table(","), "bare.csv")
    assert "no header" in refusal(bare, "speed", "tip")
    twice = write(tmp_path, table(",", header="u,u\n"), "twice.csv")
    assert "stands at 2 columns" in refusal(twice, "u", 2)
    assert "may be a heading or a sample" in refusal(twice, 1, 2)


def test_missing_file_folder_and_extension(tmp_path):
    assert "no such file" in refusal(tmp_path / "absent.csv")
    assert "no such file" in refusal(tmp_path / f"{'long' * 80}.csv")
    (tmp_path / "folder.csv").mkdir()
    assert "is not a file" in refusal(tmp_path / "folder.csv")
    assert ".parquet" in refusal(write(tmp_path, "1,2", "record.xlsx"))


def test_another_format_behind_a_text_extension_is_named(tmp_path):
    path = tmp_path / "record.csv"
    pd.DataFrame({"u": U, "y": Y}).to_parquet(path)
    assert "Parquet" in refusal(path)


def test_sampling_rate_must_be_known_and_not_contradicted(tmp_path):
    path = tmp_path / "record.csv"
    frame = pd.DataFrame({"t": T, "u": U, "y": Y})
    frame.assign(t=np.arange(N)).to_csv(path, index=False)
    message = refusal(path, "u", "y", sampling_rate=None)
    assert "sampling rate is not known" in message
    assert 'the name of a time channel, such as "t"' in message
    frame.to_csv(path, index=False)
    message = refusal(path, "u", "y", time="t", sampling_rate=100.0)
    assert "200 Hz" in message
    assert "100 Hz" in message
    assert read_recording(path, "u", "y", 200.0, time="t").sampling_rate == 200.0
    assert "-1.0 Hz" in refusal(path, "u", "y", sampling_rate=-1.0)


def test_a_constant_channel_and_a_short_record(tmp_path):
    text = "".join(f"{u!r},7\n" for u in U.tolist())
    assert 'output "output": every sample is 7' in refusal(write(tmp_path, text))
    assert "only 3 samples" in refusal(write(tmp_path, "1,3\n3,4\n5,7\n"))


@pytest.mark.parametrize("count", [*range(8, 30), 199, 200, 201, 399, 400, 401, 599, 600, 601])
@pytest.mark.parametrize(
    "header", ['"force","tip"', '"force, N","tip"', '"force","tip",', "force,tip", '"force",tip,']
)
def test_headings_are_found_whatever_the_number_of_rows(tmp_path, header, count):
    rows = "".join(f"{3 * index % 7}.5,{7 * index % 11}.25\n" for index in range(count))
    path = write(tmp_path, f"{header}\n{rows}")
    name = "force, N" if ", N" in header else "force"
    recording = read_recording(path, name, "tip", 1.0)
    assert recording.samples == count


def test_a_trailing_separator_in_headings_and_rows(tmp_path):
    rows = "".join(f"{u!r},{y!r},\n" for u, y in zip(U.tolist(), Y.tolist(), strict=True))
    for header in ('"V1","V2",\n', "V1,V2\n"):
        recording = read_recording(write(tmp_path, header + rows), "V1", "V2", 1.0)
        np.testing.assert_array_equal(recording.output, Y)
    with_note = write(tmp_path, "V1,V2,note\n" + rows)
    assert read_recording(with_note, "V1", "V2", 1.0).samples == N
    assert 'output "note", sample 1: the value is missing' in refusal(with_note, "V1", "note")


def test_units_in_headings_are_no_part_of_names(tmp_path):
    """But where two names would be the same, and where the brackets hold no unit."""
    headings = "t [ms],Acc tip Z [m/s²],force (N),Motor (A),Motor (B)"
    rows = zip(np.arange(N) * 20, Y, U, -U, -Y, strict=True)
    path = write(
        tmp_path,
        headings + "\n" + "".join(",".join(map(repr, map(float, row))) + "\n" for row in rows),
    )
    for names in (("force (N)", "Acc tip Z [m/s²]"), ("force", "Acc tip Z")):
        recording = read_recording(path, *names, None, time="t [ms]")
        assert recording.sampling_rate == 50.0
        assert (recording.input_names, recording.output_names) == (("force",), ("Acc tip Z",))
        assert (recording.input_units, recording.output_units) == (("N",), ("m/s²",))
    others = read_recording(path, "Motor (A)", "Motor (B)", 50.0)
    assert (others.input_names, others.input_units) == (("Motor (A)",), ("",))
    assert read_recording(path, "force", 2, 50.0, input_unit="kN").input_units == ("kN",)


def test_long_fields_are_refused_at_once(tmp_path):
    rows = table(",").splitlines()
    for field in ("1" * 30_000 + "x", '"' + "1" * 200_000 + '"', "1." * 50_000, "," * 30_000):
        path = write(tmp_path, "\n".join([*rows[:20], f"{field},1.5", *rows[20:]]))
        start = time.perf_counter()
        assert "line 21" in refusal(path)
        assert time.perf_counter() - start < 2.0


def test_a_wide_table_is_read_at_once(tmp_path):
    columns = 100_000
    row = ",".join(["0.5"] * (columns - 2))
    text = "".join(
        f"{row},{u!r},{y!r}\n" for u, y in zip(U[:8].tolist(), Y[:8].tolist(), strict=True)
    )
    names = ",".join(f"c{index}" for index in range(columns))
    path = write(tmp_path, f"{names}\n{text}")
    start = time.perf_counter()
    recording = read_recording(path, f"c{columns - 2}", columns, 1.0)
    assert time.perf_counter() - start < 20.0
    np.testing.assert_array_equal(recording.output, Y[:8])


def test_names_beyond_ascii_in_the_c_locale(tmp_path):
    files = write_every_format(tmp_path)
    files["csv"] = write(tmp_path, table(","))
    assert len(files) > 8
    named = [
        str(file.rename(tmp_path / f"Größe {form.replace(' ', '')}{file.suffix}"))
        for form, file in files.items()
    ]
    program = (
        "from pathlib import Path\n"
        "from evopem.files.checksums import sha256_of_file\n"
        "from evopem.signals.measured_files import local_path\n"
        "from evopem.config.settings import ChannelSettings\n"
        "from evopem.signals.reading import read_measured\n"
        "def read(path, output):\n"
        "    channels = ChannelSettings((1,), (output,), sampling_rate=1.0)\n"
        "    return read_measured(path, channels)[0]\n"
        f"for path in {named!r}:\n"
        "    assert read(path, 2).samples > 8, ascii(path)\n"
        "    assert len(sha256_of_file(local_path(Path(path)))) == 64\n"
        "    try:\n        read(path, 9)\n        raise AssertionError(ascii(path))\n"
        "    except ValueError as error:\n"
        "        assert error.source == path, ascii(error.source)\n"
    )
    environment = dict(os.environ, LC_ALL="C", PYTHONUTF8="0", PYTHONPATH=str(SCRIPTS))
    script = tmp_path / "program.py"
    script.write_text(program, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"header_lines": 500}, "no row below the 500 header lines"),
        ({"time_unit": "ms"}, "time_unit is stated without a time channel"),
    ],
)
def test_options_that_do_not_fit_are_refused(tmp_path, options, expected):
    assert expected in refusal(write(tmp_path, table(",")), **options)


def test_header_lines_are_for_text_tables(tmp_path):
    path = tmp_path / "record.npy"
    np.save(path, np.column_stack([U, Y]))
    assert "header_lines is stated for a file that is no text table" in refusal(
        path, header_lines=1
    )


@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(text=st.text(alphabet="0123456789.,;:\t -+eEdDT\"'\n\r#%_naif", max_size=200))
def test_no_text_ends_in_a_traceback(tmp_path, text):
    path = write(tmp_path, text)
    for references in ((1, 2), ("a", 1)):
        with contextlib.suppress(InputError):
            read_recording(path, *references, time=3)


def test_a_long_table_keeps_every_digit(tmp_path):
    generator = np.random.default_rng(1)
    path = tmp_path / "long.csv"
    values = generator.standard_normal((200_000, 2))
    pd.DataFrame(values, columns=["u", "y"]).to_csv(path, index=False)
    np.testing.assert_array_equal(read_recording(path, "u", "y", 1.0).output, values[:, 1])
