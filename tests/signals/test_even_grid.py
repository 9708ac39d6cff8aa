"""Recordings with late and missing samples."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals.reading import read_measured
from evopem.signals.recording import load_recording
from evopem.signals.recording_info import RecordingInfo
from evopem.signals.timestamps import LONGEST_GAP, timing

RATE = 50.0
EVEN = np.arange(400) / RATE
LOST = [7, 8, 9, 100, 251]


def grid_of(stamps):
    return timing(np.asarray(stamps), "r.csv", "time", time_unit="s", interpolate=True)


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
    assert grid.on_grid(kept).size == EVEN.size
    assert grid.rate * scale == pytest.approx(RATE, rel=1e-6)
    np.testing.assert_allclose(grid.on_grid(3.0 - kept), 3.0 - EVEN, atol=1e-4)
    assert grid.unevenness.largest_shift <= jitter / 2 + 1e-3


def test_how_uneven_stamps_are():
    late = EVEN.copy()
    late[30] += 0.2 / RATE
    found = grid_of(np.delete(late, LOST)).unevenness
    assert (found.in_gaps, found.longest_gap) == (5, pytest.approx(4.0))
    assert found.largest_shift == pytest.approx(0.2)


def test_dates():
    stamps = np.datetime64("2026-03-01", "ns") + (np.arange(90) * 20).astype("timedelta64[ms]")
    grid = grid_of(np.delete(stamps, 40))
    assert (grid.on_grid(np.ones(89)).size, grid.rate) == (90, pytest.approx(50.0, rel=1e-12))


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


@pytest.mark.parametrize("first", [290, 310])
def test_a_change_of_rate_is_no_jitter(first):
    """Samples 10 ms apart, then 20 ms: no rate is right for both."""
    stamps = np.concatenate([0.01 * np.arange(first), 0.01 * first + 0.02 * np.arange(300)])
    with pytest.raises(
        InputError, match=r"the rate changes: the mean step is 0\.01 s from .* 0\.02 s"
    ):
        grid_of(stamps)


def test_a_drifting_clock_is_no_jitter():
    steps = 0.01 * np.linspace(0.94, 1.06, 800)
    with pytest.raises(InputError, match="the rate changes"):
        grid_of(np.cumsum(steps))


@pytest.mark.parametrize("spread", [0.05, 0.3])
def test_jitter_is_no_change_of_rate(spread):
    for seed in range(100):
        steps = 0.01 * (1.0 + spread * np.random.default_rng(seed).uniform(-1, 1, 400))
        grid_of(np.cumsum(steps))


@pytest.mark.parametrize("spacing", ["20ms", "20001ms"])
def test_messages_about_dates_name_seconds(spacing):
    stamps = pd.date_range("2026-03-01", periods=60, freq=spacing).to_numpy().copy()
    stamps[30] = stamps[20]
    step = float(pd.Timedelta(spacing).total_seconds())
    with pytest.raises(InputError, match=f"it is {9 * step:g} s before that of sample 30"):
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
    channels = ChannelSettings(("u",), ("y",), time="time")
    made = DatasetFiles(str(tmp_path / "x"))
    with pytest.raises(InputError, match=r"sample 8: the step .* uneven_time: interpolate"):
        read_recording(made, (str(file),), channels)
    channels = ChannelSettings(("u",), ("y",), time="time", uneven_time="interpolate")
    read_recording(made, (str(file),), channels)
    recording, info = load_recording(made.recording), load(RecordingInfo, made.recording_info)
    assert (recording.sampling_rate, recording.input.size) == (RATE, EVEN.size)
    np.testing.assert_allclose(recording.output, 2.0 * recording.input, atol=1e-7)
    assert info.files[0].unevenness.in_gaps == len(LOST)


def test_several_channels(tmp_path):
    file = written(tmp_path, np.arange(EVEN.size) * 20.0, "time_ms")
    lists = ChannelSettings(("u",), ("y", "w"), time="time_ms", uneven_time="interpolate")
    recording, origin = read_measured(file, lists)
    assert origin.unevenness.in_gaps == len(LOST)
    assert (recording.sampling_rate, recording.outputs.shape) == (RATE, (EVEN.size, 2))
    np.testing.assert_allclose(recording.outputs @ [1.0, 2.0], 0.0, atol=1e-7)


def test_times_that_were_told_from_the_file_are_described_too(tmp_path):
    """Stamps within the tolerance of even ones are moved as well, which has to be said."""
    shifts = np.random.default_rng(2).uniform(-0.02, 0.02, EVEN.size) / RATE
    table = np.column_stack([EVEN + shifts, np.sin(EVEN), np.cos(EVEN)])
    file = tmp_path / "bench.csv"
    np.savetxt(file, table, delimiter=",", header="time,u,y", comments="", fmt="%.9g")
    made = DatasetFiles(str(tmp_path / "x"))
    channels = ChannelSettings(("u",), ("y",), uneven_time="interpolate")
    read_recording(made, (str(file),), channels)
    (found,) = load(RecordingInfo, made.recording_info).files
    assert 0.0 < found.unevenness.largest_shift < 0.05


def test_the_unit_of_whole_numbers_has_to_be_known_here_too(tmp_path):
    file = written(tmp_path, np.arange(EVEN.size) * 20.0)
    lists = ChannelSettings(("u",), ("y", "w"), time="time", uneven_time="interpolate")
    with pytest.raises(InputError, match="set time_unit to one of"):
        read_measured(file, lists)


def test_times_are_needed(tmp_path):
    lists = ChannelSettings(("u",), ("y",), sampling_rate=RATE, uneven_time="interpolate")
    with pytest.raises(InputError, match='state time, such as "time", or remove uneven_time'):
        read_measured(written(tmp_path, EVEN), lists)
