"""Time stamps of even samples from a clock with coarse ticks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals.recording import load_recording
from evopem.signals.recording_info import RecordingInfo
from evopem.signals.timestamps import coarse_clock, timing

SAMPLES = 2000


def stamped(step: float, tick: float, phase: float, samples: int = SAMPLES):
    """Even times, each cut to the last tick of a clock before it."""
    return tick * np.floor((np.arange(samples) * step) / tick + phase)


@settings(deadline=None)  # other processes may hold this one up
@given(
    step=st.floats(0.1, 1.4),
    phase=st.floats(0.0, 1.0, exclude_max=True),
    scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e3]),
)
def test_the_rate_is_known_to_a_tick_over_the_record(step, phase, scale):
    """Ticks of 0.7 to 10 steps: most samples share a tick, or every other one skips one."""
    stamps = scale * stamped(step, 1.0, phase)
    clock = coarse_clock(stamps - stamps[0])
    if clock is None:  # steps of one length, or a rare one: it may be a lost or a repeated sample
        assert abs(step - 1.0) < 0.12
        return
    assert clock.tick == pytest.approx(scale)
    assert abs(clock.step / (scale * step) - 1.0) <= clock.relative_error < 0.01
    assert timing(stamps, "log.csv", "time", time_unit="s").rate == pytest.approx(
        1.0 / clock.step, rel=1e-8
    )


@pytest.mark.parametrize(("step", "tick"), [(3.3, 1.0), (8.5, 1.0), (12.4, 5.0)])
def test_ticks_shorter_than_a_step(step, tick):
    stamps = stamped(step, tick, 0.3)
    rate = timing(stamps, "log.csv", "time_ms").rate
    assert rate == pytest.approx(1e3 / step, rel=tick / stamps[-1])


def test_a_clock_of_15_6_ms_printed_in_milliseconds():
    stamps = np.floor(stamped(10.0, 15.625, 0.2))
    assert set(np.diff(stamps)) == {0.0, 15.0, 16.0}
    assert timing(stamps, "log.csv", "time_ms").rate == pytest.approx(100.0, rel=1e-3)


def test_dates_in_whole_seconds():
    tenths = np.arange(3000) * np.timedelta64(100, "ms")
    stamps = (np.datetime64("2026-03-01T10:00:00.35", "ms") + tenths).astype("datetime64[s]")
    assert timing(stamps, "log.csv", "date").rate == pytest.approx(10.0, rel=1e-4)


def test_a_stated_rate_is_kept_where_the_stamps_allow_it():
    stamps = stamped(3.0, 10.0, 0.0)
    assert timing(stamps, "log.csv", "t_ms", stated_rate=333.0).rate == 333.0
    with pytest.raises(InputError, match="the time stamps give 333"):
        timing(stamps, "log.csv", "t_ms", stated_rate=300.0)


EVEN = np.arange(SAMPLES) * 20.0


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        (np.insert(EVEN, 900, EVEN[900]), "sample 902: .* that of sample 901; remove rows"),
        (
            np.sort(np.concatenate([EVEN, EVEN[[7, 300, 1200]]])),
            "sample 9: .* that of sample 8, and there are 2 more such samples",
        ),
        (
            np.concatenate([EVEN[:50], EVEN[30:]]),
            "sample 51: .* it is 380 ms before that of sample 50",
        ),
        (np.delete(EVEN, 900), "sample 901: the step"),
        (np.delete(EVEN, slice(5, None, 20)), "sample 6: the step"),
        (stamped(3.0, 10.0, 0.0, 200), "state sampling_rate"),  # known to 1.7 % only
        (np.delete(stamped(3.0, 10.0, 0.0), range(500, 520)), "does not increase"),
    ],
)
def test_lost_and_repeated_samples_are_no_coarse_clock(stamps, expected):
    with pytest.raises(InputError, match=expected):
        timing(stamps, "log.csv", "time_ms")


def test_irregular_sampling_is_no_coarse_clock():
    times = np.cumsum(np.random.default_rng(4).uniform(1.5, 4.5, SAMPLES))
    assert coarse_clock(10.0 * np.floor(times / 10.0)) is None


@pytest.mark.parametrize("stated", [{}, {"time": "time"}, {"uneven_time": "interpolate"}])
def test_the_samples_are_used_as_they_are_and_the_report_says_so(tmp_path, stated):
    u, y = np.random.default_rng(5).standard_normal((2, SAMPLES))
    file = tmp_path / "log.csv"
    stamps = 1e-3 * stamped(3.0, 10.0, 0.0)
    np.savetxt(file, np.column_stack([stamps, u, y]), "%.17g", ",", header="time,u,y", comments="")
    made = DatasetFiles(str(tmp_path / "x"))
    channels = ChannelSettings(("u",), ("y",), **stated)
    read_recording(made, (str(file),), channels)
    recording, info = load_recording(made.recording), load(RecordingInfo, made.recording_info)
    np.testing.assert_array_equal(recording.output, y)
    assert recording.sampling_rate == pytest.approx(1000.0 / 3.0, rel=1e-6)
    assert info.files[0].time_from_file == (None if "time" in stated else "time")
    assert [each.unevenness.tick for each in info.files] == [pytest.approx(10.0 / 3.0)]


def test_uneven_stamps_are_interpolated_and_not_taken_for_those_of_a_coarse_clock():
    """Every twelfth sample is lost: a clock of 20 ms would give the same stamps at 45.8 Hz."""
    stamps = np.delete(EVEN, slice(5, None, 12))
    grid = timing(stamps, "log.csv", "time_ms", interpolate=True)
    assert (grid.rate, grid.unevenness.tick) == (50.0, 0.0)
