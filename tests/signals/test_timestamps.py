from __future__ import annotations

import re

import numpy as np
import pytest

from evopem.errors import InputError
from evopem.signals.timestamps import timing


def rate(stamps, name="time", **settings) -> float:
    return timing(np.asarray(stamps), "r.csv", name, **settings).rate


@pytest.mark.parametrize("frequency", [0.1, 1.25, 100.0, 125.0, 2500.0, 44100.0])
def test_seconds(frequency):
    stamps = 3.3 + np.arange(5000) / frequency
    assert rate(stamps, name="t [s]") == pytest.approx(frequency, rel=1e-9)


def test_stamps_rounded_to_milliseconds():
    stamps = np.round(np.arange(6000) / 60.0, 3)
    assert rate(stamps) == pytest.approx(60.0, rel=1e-5)
    assert rate(stamps, stated_rate=60.0) == 60.0


@pytest.mark.parametrize(
    ("name", "unit", "step"),
    [
        ("time_ms", "", 8),
        ("t [µs]", "", 8000),
        ("t (us)", "", 8000),
        ("t", "ms", 8),
        ("ns", "", 8_000_000),
    ],
)
def test_whole_numbers_of_a_named_unit(name, unit, step):
    assert rate(np.arange(100) * step, name=name, unit=unit) == 125.0


@pytest.mark.parametrize("dtype", [np.int32, np.uint32, np.int64, np.float64])
def test_whole_numbers_of_no_unit(dtype):
    stamps = (np.arange(100) * 400).astype(dtype)
    assert rate(stamps, stated_rate=2500.0) == 2500.0
    with pytest.raises(InputError, match="may be seconds, milliseconds or microseconds"):
        rate(stamps)
    with pytest.raises(InputError, match="stated rate is 2000 Hz"):
        rate(stamps, stated_rate=2000.0)


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_whole_numbers_since_1970(unit, per_second):
    stamps = 1_732_000_000 * per_second + np.arange(1000) * (per_second // 200)
    assert rate(stamps, time_unit=unit) == 200.0
    if unit == "ns":
        assert rate(stamps) == 200.0
    else:
        # A counter of microseconds or nanoseconds reaches such numbers in minutes or days.
        with pytest.raises(InputError, match=rf"set time_unit to {unit} if they .* \(200 Hz\)"):
            rate(stamps)
    assert rate(stamps.astype(f"datetime64[{unit}]")) == 200.0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda t: np.delete(t, 40), "sample 41: the step"),
        (lambda t: np.insert(t, 7, t[7]), "sample 9: the time does not increase"),
        (lambda t: np.where(np.arange(t.size) == 9, np.nan, t), "sample 10: the time stamp is nan"),
        (lambda t: t[::-1], "sample 2: the time does not increase"),
        (lambda t: np.where(np.arange(t.size) == 5, t + 2e-3, t), "sample 6: the step"),
        (lambda t: t * (1.0 + 0.02 * t), "off an even grid"),
        (lambda t: t[:1], "fewer than two"),
        (lambda t: t.astype(str), "holds no times"),
    ],
)
def test_what_is_not_uniform_names_the_first_bad_sample(change, expected):
    stamps = np.arange(400) / 100.0
    assert rate(stamps) == 100.0
    with pytest.raises(InputError, match=expected):
        rate(change(stamps))


def test_a_missing_date_is_named():
    stamps = np.datetime64("2024-01-01", "ns") + np.arange(50) * np.timedelta64(10, "ms")
    assert rate(stamps) == 100.0
    stamps[3] = np.datetime64("NaT")
    with pytest.raises(InputError, match="sample 4: the time stamp is missing"):
        rate(stamps)


def test_jitter_below_the_tolerance_passes_and_above_it_does_not():
    generator = np.random.default_rng(2)
    even = np.arange(2000) / 100.0
    jitter = generator.uniform(-1.0, 1.0, even.size) * 0.01
    assert rate(even + 0.045 * jitter) == pytest.approx(100.0, rel=1e-4)
    with pytest.raises(InputError, match="the step"):
        rate(even + 0.2 * jitter)


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("time", 1.0), ("t", 1.0), ("X_Value", 1.0), ("Timestamp", 1.0), ("elapsed_time", 1.0),
        ("column 1", 1.0), ("time_rel", 1.0), ("t_0", 1.0), ("t / s", 1.0), ("Zeit [s]", 1.0),
        ("Seconds elapsed", 1.0), ("TimeSec", 1.0), ("time in seconds", 1.0), ("t_sim", 1.0),
        ("Time  1 - default sample rate [s]", 1.0), ("ts", 1.0), ("d", 1.0), ("h", 1.0),
        ("time_msec", 1e-3), ("Time (milliseconds)", 1e-3), ("TimeMs", 1e-3), ("Time (ms.)", 1e-3),
        ("timems", 1e-3), ("time_ms_1", 1e-3), ("millis", 1e-3), ("uptime_millis", 1e-3),
        ("time_since_start_ms", 1e-3), ("time [MS]", 1e-3), ("Time, ms", 1e-3), ("t-ms", 1e-3),
        ("Zeit in Millisekunden", 1e-3), ("ms since start", 1e-3),
        ("time (usec)", 1e-6), ("t [\u00b5s]", 1e-6), ("t [\u03bcs]", 1e-6), ("micros", 1e-6),
        ("Time{ns}", 1e-9), ("nanoseconds", 1e-9),
        ("time [min]", 60.0), ("t_h", 3600.0), ("hours", 3600.0), ("time (d)", 86400.0),
    ],
)  # fmt: skip
def test_the_unit_in_a_name(name, seconds):
    stamps = 0.5 + 10.0 * np.arange(100)
    assert rate(stamps, name=name) == pytest.approx(0.1 / seconds, rel=1e-8)


@pytest.mark.parametrize(
    ("name", "unit", "spelled"),
    [
        ("time [ticks]", "", "ticks"),
        ("time (samples)", "", "samples"),
        ("time_ticks", "", "ticks"),
        ("Time Cycles", "", "cycles"),
        ("TimeFrames", "", "frames"),
        ("t [10 ms]", "", "10 ms"),
        ("time (hh:mm:ss)", "", "hh:mm:ss"),
        ("time", "jiffies", "jiffies"),
        ("time", "1/s", "1/s"),
        ("time", "V", "v"),
    ],
)
def test_a_unit_that_is_not_known_is_refused(name, unit, spelled):
    stamps = 0.5 + 10.0 * np.arange(100)
    with pytest.raises(InputError) as caught:
        rate(stamps, name=name, unit=unit)
    assert f'"{spelled}" is no known unit of time; set time_unit to one of s, ms' in str(
        caught.value
    )
    assert rate(stamps, name=name, unit=unit, time_unit="ms") == 100.0


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [("msec", 1e-3), ("[ms]", 1e-3), ("MSec.", 1e-3), ("usec", 1e-6), ("Sekunden", 1.0),
     ("minutes", 60.0), ("seconds since 1970-01-01 00:00", 1.0), ("-", 1.0), ("", 1.0)],
)  # fmt: skip
def test_the_unit_that_a_file_states(unit, seconds):
    stamps = 0.5 + 10.0 * np.arange(100)
    assert rate(stamps, unit=unit) == pytest.approx(0.1 / seconds, rel=1e-8)


def test_two_units_that_contradict_each_other():
    stamps = 0.5 + 10.0 * np.arange(100)
    with pytest.raises(
        InputError, match=r'states the unit "s" .* name states "ms"; set time_unit to ms or s'
    ):
        rate(stamps, name="time_ms", unit="s")
    assert rate(stamps, name="time_ms", unit="s", time_unit="ms") == 100.0


def test_the_stated_unit_of_whole_numbers():
    stamps = 10 * np.arange(600)
    with pytest.raises(InputError, match=r"set time_unit to one of .* \(ms would give 100 Hz\)"):
        rate(stamps)
    assert rate(stamps, time_unit="ms") == 100.0
    with pytest.raises(InputError, match='"msec" is no known unit of time; set time_unit'):
        rate(stamps, time_unit="msec")
    with pytest.raises(InputError, match="set time_unit if that of the stamps"):
        rate(stamps, stated_rate=100.0, time_unit="s")


@pytest.mark.parametrize(
    ("first", "step"),
    [
        (1_700_000_000, 50),  # microseconds of a counter after 28 minutes, at 20 kHz
        (1_200_000_000_000, 1_000_000),  # nanoseconds after 20 minutes, at 1 kHz
        (1_700_000_000_000_000, 10_000_000),  # nanoseconds after 20 days, at 100 Hz
    ],
)
def test_counters_are_not_taken_for_dates(first, step):
    with pytest.raises(InputError, match="set time_unit"):
        rate(first + step * np.arange(100))


@pytest.mark.parametrize("first", [45443.5, 739402.75])
def test_days_of_spreadsheets_and_matlab_are_not_taken_for_seconds(first):
    stamps = first + np.arange(2000) / 200.0 / 86400.0
    with pytest.raises(
        InputError, match=r"may be days \(200 Hz\) or seconds .* time_unit to d or s"
    ):
        rate(stamps)
    assert rate(stamps, time_unit="d") == pytest.approx(200.0, rel=1e-6)
    with pytest.raises(InputError, match=r"may be days \(0\.0166667 Hz\) or seconds \(1440 Hz\)"):
        rate(first + np.round(np.arange(300) / 1440.0, 6))  # of a logger, once a minute
    with pytest.raises(InputError, match=r"may be days \(1\.15741e-05 Hz\) or seconds \(1 Hz\)"):
        rate(first + np.arange(300))  # once a day
    assert rate(first + np.arange(2000) / 1000.0) == pytest.approx(1000.0)  # seconds of a day


def test_durations_and_large_counters():
    steps = np.arange(100)
    assert rate(steps * np.timedelta64(10, "ms")) == 100.0
    assert rate((steps * 10).astype(np.uint64), time_unit="ms") == 100.0
    with pytest.raises(InputError, match="sample 100: the time stamp is 1844"):
        rate((steps[::-1] * -10).astype(np.int64).astype(np.uint64) - 1, time_unit="ms")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"time_unit": "ns"}, "3e+06 ns where the usual one is 1e+06 ns"),
        ({"name": "time_us"}, "3e+06 us where the usual one is 1e+06 us"),
        ({}, "3e+06 where the usual one is 1e+06"),
    ],
)
def test_uneven_steps_are_told_in_their_unit(settings, said):
    stamps = 10**6 * np.r_[np.arange(100), 102 + np.arange(100)]
    with pytest.raises(InputError, match=re.escape(f"{said};")):
        rate(stamps, **settings)
    with pytest.raises(InputError, match=re.escape("0.003 s where the usual one is 0.001 s;")):
        rate(stamps.astype("datetime64[ns]"))
