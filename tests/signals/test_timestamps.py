from __future__ import annotations

import numpy as np
import pytest

from evopem.errors import InputError
from evopem.signals.timestamps import sampling_rate_of


def rate(stamps, name="time", **settings) -> float:
    return sampling_rate_of(np.asarray(stamps), "r.csv", name, **settings)


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
    with pytest.raises(InputError, match="stated sampling rate is 2000 Hz"):
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
