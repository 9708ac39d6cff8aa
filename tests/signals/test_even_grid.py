"""Recordings with late and missing samples."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evopem.config.settings import ChannelSettings
from evopem.config.state_space_settings import ChannelLists
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.report.sentences.about_recording import uneven_stamps
from evopem.signals.even_grid import LONGEST_GAP, even_grid
from evopem.signals.multichannel_reading import read_multichannel
from evopem.signals.recording import load_recording
from evopem.signals.recording_info import RecordingInfo

RATE = 50.0
EVEN = np.arange(400) / RATE
LOST = [7, 8, 9, 100, 251]


def grid_of(stamps):
    return even_grid(np.asarray(stamps), "r.csv", "time")


@given(
    lost=st.sets(st.integers(1, 398), max_size=30),
    jitter=st.floats(0.0, 0.3),
    scale=st.floats(1e-6, 1e6),
    start=st.floats(-1e3, 1e3),
)
def test_a_signal_linear_in_time_is_that_of_even_times(lost, jitter, scale, start):
    shifts = np.random.default_rng(0).uniform(-0.5, 0.5, EVEN.size) * jitter / RATE
    shifts[[0, -1]] = 0.0
    kept = np.delete(EVEN + shifts, sorted(lost))
    grid = grid_of(start + scale * kept)
    assert grid.samples == EVEN.size
    assert grid.step * RATE == pytest.approx(scale, rel=1e-6)
    np.testing.assert_allclose(grid.interpolated(3.0 - kept), 3.0 - EVEN, atol=1e-4)
    assert grid.unevenness.largest_shift <= jitter / 2 + 1e-3


def test_how_uneven_stamps_are():
    late = EVEN.copy()
    late[30] += 0.2 / RATE
    found = grid_of(np.delete(late, LOST)).unevenness
    assert (found.in_gaps, found.longest_gap) == (5, pytest.approx(4.0))
    assert found.largest_shift == pytest.approx(0.2)
    (sentence,) = uneven_stamps([found])
    assert sentence.endswith("0.2 steps away. 5 samples are missing, in gaps of up to 4 steps.")


def test_dates():
    stamps = np.datetime64("2026-03-01", "ns") + (np.arange(90) * 20).astype("timedelta64[ms]")
    grid = grid_of(np.delete(stamps, 40))
    assert (grid.samples, grid.step) == (90, 20e6)


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        (
            np.insert(EVEN, 7, EVEN[7]),
            "sample 9: the time does not increase: it is that of sample 8; remove rows",
        ),
        (np.delete(EVEN, range(50, 49 + LONGEST_GAP + 1)), "sample 51: .* after 21 usual steps"),
        (np.delete(EVEN, range(5, 395, 8)), "49 samples of 400 are missing"),
        (EVEN[:1], "fewer than two"),
    ],
)
def test_what_is_too_uneven_is_refused(stamps, expected):
    with pytest.raises(InputError, match=expected):
        grid_of(stamps)


def written(folder: Path, stamps, name="time") -> Path:
    """A recording whose signals are linear between the samples that are lost."""
    u = np.interp(EVEN, EVEN[::20], np.random.default_rng(1).standard_normal(20))
    table = np.column_stack([stamps, u, 2.0 * u, -u])
    file = folder / "bench.csv"
    kept = np.delete(table, LOST, axis=0)
    np.savetxt(file, kept, delimiter=",", header=f"{name},u,y,w", comments="", fmt="%.9g")
    return file


def test_one_channel(tmp_path):
    file = written(tmp_path, EVEN)
    channels = ChannelSettings("u", "y", time="time")
    results = str(tmp_path / "recording.npz"), str(tmp_path / "recording.json")
    with pytest.raises(InputError, match=r"sample 8: the step .* uneven_time: interpolate"):
        read_recording([str(file)], channels, *results)
    channels = ChannelSettings("u", "y", time="time", uneven_time="interpolate")
    read_recording([str(file)], channels, *results)
    recording, info = load_recording(results[0]), load(RecordingInfo, results[1])
    assert (recording.sampling_rate, recording.input.size) == (RATE, EVEN.size)
    np.testing.assert_allclose(recording.output, 2.0 * recording.input, atol=1e-7)
    assert info.uneven_times[0].in_gaps == len(LOST)


def test_several_channels(tmp_path):
    file = written(tmp_path, np.arange(EVEN.size) * 20.0, "time_ms")
    lists = ChannelLists(("u",), ("y", "w"), time="time_ms", uneven_time="interpolate")
    recording, unevenness = read_multichannel(file, lists)
    assert unevenness.in_gaps == len(LOST)
    assert (recording.sampling_rate, recording.outputs.shape) == (RATE, (EVEN.size, 2))
    np.testing.assert_allclose(recording.outputs @ [1.0, 2.0], 0.0, atol=1e-7)


def test_times_that_were_told_from_the_file_are_described_too(tmp_path):
    """Stamps within the tolerance of even ones are moved as well, which has to be said."""
    shifts = np.random.default_rng(2).uniform(-0.02, 0.02, EVEN.size) / RATE
    table = np.column_stack([EVEN + shifts, np.sin(EVEN), np.cos(EVEN)])
    file = tmp_path / "bench.csv"
    np.savetxt(file, table, delimiter=",", header="time,u,y", comments="", fmt="%.9g")
    info = str(tmp_path / "recording.json")
    channels = ChannelSettings("u", "y", uneven_time="interpolate")
    read_recording([str(file)], channels, str(tmp_path / "recording.npz"), info)
    (found,) = load(RecordingInfo, info).uneven_times
    assert 0.0 < found.largest_shift < 0.05


def test_the_unit_of_whole_numbers_has_to_be_known_here_too(tmp_path):
    file = written(tmp_path, np.arange(EVEN.size) * 20.0)
    lists = ChannelLists(("u",), ("y", "w"), time="time", uneven_time="interpolate")
    with pytest.raises(InputError, match="set time_unit to one of"):
        read_multichannel(file, lists)


def test_times_are_needed(tmp_path):
    lists = ChannelLists(("u",), ("y",), sampling_rate=RATE, uneven_time="interpolate")
    with pytest.raises(InputError, match='state time, such as "time", or remove uneven_time'):
        read_multichannel(written(tmp_path, EVEN), lists)
