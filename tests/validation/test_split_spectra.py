"""Spectra of the two parts of a split: equal, different, and not known."""

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from evopem.validation.spectra import hidden_bands, split_spectra

RATE = 100.0


def white(generator, samples):
    return generator.standard_normal(samples)


def narrow(generator, samples):
    return lfilter([1.0], [1.0, -1.9, 0.98], generator.standard_normal(samples))


def two_sines(generator, samples):
    f, phase = generator.uniform(0.02, 0.48, 2), generator.uniform(0, 6.28, 2)
    t = np.arange(samples)
    return np.sin(2 * np.pi * f[0] * t + phase[0]) + np.sin(2 * np.pi * f[1] * t + phase[1])


def binary(generator, samples):
    return np.repeat(generator.choice([-1.0, 1.0], samples // 5 + 1), 5)[:samples]


@pytest.mark.parametrize("signal", [white, narrow, two_sines, binary])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_one_kind_of_input_throughout_is_comparable(signal, share):
    for seed in range(30):
        generator = np.random.default_rng([1, seed])
        samples = int(generator.choice([400, 1000, 3000]))
        u = signal(generator, samples)
        cut = int(share * samples)
        # Amplitude alone makes no difference.
        assert split_spectra(u[:cut], 10.0 * u[cut:], RATE).comparable is True


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("share", [0.5, 0.7, 0.9])
def test_a_sweep_cut_in_time_is_not(share, noise):
    t = np.arange(4000) / RATE
    u = chirp(t, 1.0, 40.0, 40.0) + noise * np.random.default_rng(2).standard_normal(4000)
    cut = int(share * 4000)
    found = split_spectra(u[:cut], u[cut:], RATE)
    assert found.comparable is False
    assert found.share_outside > 0.8
    # The sweep rises by about 0.01 Hz a sample.
    first, last = found.bands_hz[0][0], found.bands_hz[-1][1]
    resolution = 2.0 * 4.0 * RATE / min(cut, 4000 - cut)
    assert first == pytest.approx(1 + 39 * share, abs=2 * resolution)
    assert last > 40.0 - 2 * resolution


def test_a_narrower_validation_input_is_comparable():
    generator = np.random.default_rng(3)
    t = np.arange(1000)
    found = split_spectra(generator.standard_normal(2000), np.sin(0.7 * t), RATE)
    assert found.comparable is True


def test_a_part_that_is_short_or_constant_is_not_judged():
    u = np.random.default_rng(4).standard_normal(500)
    assert split_spectra(u, u[:40], RATE).comparable is None
    assert split_spectra(u, np.ones(200), RATE).comparable is None
    assert np.isnan(split_spectra(np.zeros(200), u, RATE).share_outside)


def swept(samples, start, phase):
    return chirp(np.arange(samples), start, samples, 0.15, phi=phase)


@pytest.mark.parametrize("unit", [1e-6, 1.0])
def test_two_nearly_equal_sweeps_hide_each_others_response(unit):
    """Where they have power, up to 0.15 of the sampling rate, and an independent input nowhere."""
    noise = np.random.default_rng(1).standard_normal(700)
    inputs = np.column_stack([swept(700, 0.001, 30.0), unit * swept(700, 0.0015, 210.0), noise])
    first, second, other = hidden_bands(inputs, 100.0)
    for ((low, high),) in (first, second):
        assert 0.0 < low < 1.0
        assert 10.0 < high < 20.0
    assert other == ()


@pytest.mark.parametrize("pole", [0.0, 0.98])
def test_independent_inputs_hide_no_response(pole):
    """Slow ones neither, nor one that is another a hundred samples later."""
    u = lfilter([1.0], [1.0, -pole], np.random.default_rng(2).standard_normal((600, 3)), axis=0)
    u[:, 2] = np.roll(u[:, 0], 100)
    assert hidden_bands(u, 1.0) == [(), (), ()]
