"""Text tables of real programs: read exactly, or refused with the place of the doubt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from program_tables import READ, REFUSED, N, U, Y
from recorded_files import read_recording

from evopem.errors import InputError


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / f"{name}.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", READ)
def test_a_table_of_a_program_is_read(tmp_path, name):
    content, settings = READ[name]
    recording = read_recording(write(tmp_path, name, content), **settings)
    assert recording.sampling_rate == pytest.approx(200.0, rel=1e-6)
    assert recording.samples == N
    if name != "decimal_mark_stated":
        np.testing.assert_allclose(recording.input, U, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(recording.output, Y, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", REFUSED)
def test_a_doubtful_table_is_refused_with_its_place(tmp_path, name):
    content, settings, expected = REFUSED[name]
    path = write(tmp_path, name, content)
    with pytest.raises(InputError) as caught:
        read_recording(path, **settings)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert expected in message


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("diadem_names_and_units", ("Nm", "m/s²")),
        ("motec", ("N", "mm")),
        ("picoscope_milliseconds", ("V", "mV")),
        ("keysight", ("Volt", "Volt")),
        ("numpy_savetxt_names_and_units", ("N", "mm")),
        ("diadem_texts_with_header_lines", ("N", "mm")),
    ],
)
def test_units_above_the_numbers(tmp_path, name, units):
    content, settings = READ[name]
    recording = read_recording(write(tmp_path, name, content), **settings)
    assert (recording.input_units[0], recording.output_units[0]) == units
