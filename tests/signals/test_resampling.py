from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.signal import freqz

from evopem.errors import InputError
from evopem.signals.recording import Recording
from evopem.signals.transforms import anti_alias_filter, resample_recording, resample_signal

RATIOS = [Fraction(1, 2), Fraction(4, 5), Fraction(2, 25), Fraction(147, 160), Fraction(1, 25)]


def tone(frequency: float, rate: float, seconds: float, phase: float = 0.3) -> np.ndarray:
    return np.sin(2.0 * np.pi * frequency * np.arange(round(seconds * rate)) / rate + phase)


@pytest.mark.parametrize("ratio", RATIOS)
def test_filter_meets_its_promise(ratio):
    taps = anti_alias_filter(ratio)
    nyquist = np.pi / ratio.denominator  # the new one, at the intermediate rate
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-15)
    _, passed = freqz(taps, worN=np.linspace(0.0, 0.9 * nyquist, 500))
    assert np.abs(np.abs(passed) - 1.0).max() < 1e-3
    _, stopped = freqz(taps, worN=np.linspace(nyquist, np.pi, 20_000))
    assert 20.0 * np.log10(np.abs(stopped).max()) < -80.0


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("share", [0.05, 0.5, 0.89])
def test_a_tone_below_keeps_its_size_and_time(ratio, share):
    old = 1000.0
    new = float(old * ratio)
    frequency = share * new / 2.0
    seconds = 1500.0 / new
    resampled = resample_signal(tone(frequency, old, seconds), ratio)
    expected = tone(frequency, new, resampled.size / new)[: resampled.size]
    inner = slice(80, -80)
    assert np.abs(resampled[inner] - expected[inner]).max() < 1e-3


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_a_tone_above_the_new_nyquist_is_gone(ratio, share):
    old = 1000.0
    new = float(old * ratio)
    frequency = (new + share * (old - new)) / 2.0
    resampled = resample_signal(tone(frequency, old, 1500.0 / new), ratio)
    assert np.abs(resampled[80:-80]).max() < 1e-4


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_straight_line_stays_one_up_to_its_ends(ratio):
    line = 5.0 - 0.01 * np.arange(3000)
    resampled = resample_signal(line, ratio)
    expected = 5.0 - 0.01 * np.arange(resampled.size) / float(ratio)
    assert np.abs(resampled - expected).max() < 1e-3 * np.ptp(line)


def test_input_and_output_stay_together_and_are_not_changed():
    generator = np.random.default_rng(0)
    u, y = generator.standard_normal((2, 3001))
    kept = u.copy()
    recording = Recording(u, y, 125.0, output_units=("m",))
    resampled = resample_recording(recording, 100.0, "resample")
    assert resampled.input.size == resampled.output.size == -(-3001 * 4 // 5)
    assert (resampled.sampling_rate, resampled.output_units[0]) == (100.0, "m")
    np.testing.assert_array_equal(u, kept)
    assert resample_recording(recording, 125.0, "resample") is recording


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        (200.0, "above the recording's 125 Hz"),
        (100.0 / np.pi, "not in the ratio of whole numbers"),
        (1e-6, "not in the ratio of whole numbers"),
    ],
)
def test_rates_that_cannot_be_reached(rate, expected):
    signal = np.random.default_rng(1).standard_normal(500)
    with pytest.raises(InputError, match=expected):
        resample_recording(Recording(signal, signal, 125.0), rate, "datasets.a.resample")
