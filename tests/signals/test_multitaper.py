from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from evopem.errors import InputError
from evopem.signals.peaks import spectral_peaks
from evopem.signals.recording import Recording, concatenated
from evopem.signals.spectra import frequency_response, multitaper_spectrum

# Percival & Walden (1993, eq. 46a): two close resonances, a range of 65 dB.
AR4 = np.array([1.0, -2.7607, 3.8106, -2.6535, 0.9238])
RATE = 100.0


def response_of(u, y, rate, *settings):
    """The response of one output to one input, its only row and column."""
    found = frequency_response(Recording(u, y, rate), *settings)
    names = ("response", "gain", "gain_lower", "gain_upper", "phase_deg")
    plain = {name: getattr(found, name)[:, 0, 0] for name in names}
    return SimpleNamespace(coherence=found.coherence[:, 0], **plain)


def process(denominator, samples, seed, numerator=(1.0,)) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(samples + 3000)
    return lfilter(numerator, denominator, noise)[3000:]


def true_density(denominator, nfft, rate=RATE, numerator=(1.0,)) -> np.ndarray:
    _, response = freqz(numerator, denominator, worN=nfft // 2 + 1, include_nyquist=True)
    return 2.0 * np.abs(response) ** 2 / rate


def inner(spectrum) -> np.ndarray:
    """Frequencies more than W from zero and Nyquist, where the theory is that of complex values."""
    w = spectrum.halfbandwidth_hz
    frequencies = spectrum.frequencies
    return (frequencies > w) & (frequencies < frequencies[-1] - w)


@pytest.mark.parametrize(
    ("samples", "nfft"), [(1024, 2048), (1000, 1000), (777, 1001), (5000, 1024)]
)
@pytest.mark.parametrize("half", [2.0, 4.0])
def test_integral_is_the_variance(samples, nfft, half):
    signal = 3.0 + process(AR4, samples, seed=1)
    spectrum = multitaper_spectrum(signal, RATE, half, nfft)
    assert spectrum.frequencies.size == nfft // 2 + 1
    integral = spectrum.density.sum() * RATE / nfft
    assert integral == pytest.approx(signal.var(), rel=1e-10)
    # White noise of 1 V² at 100 Hz is 0.02 V²/Hz, one-sided.
    white = np.random.default_rng(0).standard_normal(50_000)
    assert multitaper_spectrum(white, RATE, half, nfft).density[5:-5].mean() == pytest.approx(
        0.02, rel=0.02
    )


@pytest.mark.parametrize("denominator", [[1.0, -0.8], AR4])
def test_density_agrees_with_prietos_multitaper(denominator):
    """An independent port of Thomson's own programs (Prieto 2022)."""
    mtspec = pytest.importorskip("multitaper").MTSpec
    signal = process(denominator, 1024, seed=2)
    peer = mtspec(signal, nw=4, kspec=7, dt=1.0 / RATE, nfft=2048, iadapt=0)
    frequencies, density = peer.rspec()
    spectrum = multitaper_spectrum(signal, RATE, 4.0, 2048)
    np.testing.assert_allclose(spectrum.frequencies, frequencies.ravel(), atol=1e-9)
    decibels = 10.0 * np.log10(spectrum.density / density.ravel())
    assert np.abs(decibels[inner(spectrum)]).max() < 0.15
    assert spectrum.tapers == 7


def test_response_and_coherence_agree_with_prietos_multitaper():
    """It takes the smaller of the two signals' weights where we take their geometric mean."""
    mtcross = pytest.importorskip("multitaper").MTCross
    u = np.random.default_rng(0).standard_normal(1024)
    y = lfilter([1.0, 0.5], [1.0], u) + 0.5 * process([1.0], 1024, seed=5)
    peer = mtcross(y - y.mean(), u - u.mean(), nw=4, kspec=7, dt=1.0 / RATE, nfft=2048)
    estimate = response_of(u, y, RATE, 4.0, 2048)
    inside = slice(10, 1015)
    difference = np.abs(estimate.response - peer.trf[:1025, 0])[inside]
    assert difference.max() < 0.015 * estimate.gain.max()
    assert np.median(difference) < 0.001 * estimate.gain.max()
    assert np.abs(estimate.coherence - peer.cohe[:1025, 0])[inside].max() < 0.04


@pytest.mark.parametrize(
    ("denominator", "samples", "nfft"),
    [([1.0], 1000, 1024), ([1.0, -0.8], 1000, 2048), (AR4, 1000, 1024), (AR4, 12_000, 4096)],
)
def test_band_covers_the_true_density_in_95_percent(denominator, samples, nfft):
    truth = true_density(denominator, nfft)
    covered = []
    for seed in range(100):
        spectrum = multitaper_spectrum(process(denominator, samples, seed), RATE, 4.0, nfft)
        within = (spectrum.lower <= truth) & (truth <= spectrum.upper)
        covered.append(within[inner(spectrum)].mean())
    # 100 records of some 100 independent cells: the standard error is near 0.2 %.
    assert np.mean(covered) == pytest.approx(0.95, abs=0.012)


def test_degrees_of_freedom():
    white = np.random.default_rng(0).standard_normal(1024)
    one = multitaper_spectrum(white, RATE, 4.0, 1024)
    assert 13.0 < np.median(one.degrees_of_freedom) <= 14.0
    assert one.degrees_of_freedom.max() <= 14.0
    assert one.degrees_of_freedom[[0, -1]].max() <= 7.0
    many = multitaper_spectrum(np.random.default_rng(0).standard_normal(10_240), RATE, 4.0, 1024)
    assert many.segments == 10
    assert 130.0 < np.median(many.degrees_of_freedom) <= 140.0
    assert one.resolution_hz == pytest.approx(2 * 4 * RATE / 1024)


def test_leakage_stays_below_a_spectrum_of_110_db():
    """A pure tone must not hide a floor 110 dB below it, a few resolutions away."""
    samples = 4096
    time = np.arange(samples) / RATE
    floor = 1e-5 * np.random.default_rng(1).standard_normal(samples)
    spectrum = multitaper_spectrum(np.sin(2 * np.pi * 20.0 * time) + floor, RATE, 4.0, 4096)
    away = np.abs(spectrum.frequencies - 20.0) > 20 * spectrum.resolution_hz
    level = spectrum.density[away & inner(spectrum)].mean()
    assert level == pytest.approx(2.0 * 1e-10 / RATE, rel=0.2)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_signals_without_power_at_some_frequencies(scale):
    """A beat of the half rate, an impulse and a step: no value is lost to a division by zero."""
    for signal in (np.resize([1.0, -1.0], 512), np.eye(1, 512, 3)[0], np.repeat([0.0, 1.0], 256)):
        spectrum = multitaper_spectrum(scale * signal, RATE, 4.0, 1024)
        assert np.all(np.isfinite(spectrum.density))
        assert np.all(spectrum.lower <= spectrum.density)
        assert np.all(spectrum.density <= spectrum.upper)
        assert all(np.isfinite(peak.prominence_db) for peak in spectral_peaks(spectrum))
        unscaled = multitaper_spectrum(signal, RATE, 4.0, 1024)
        np.testing.assert_allclose(spectrum.density, scale**2 * unscaled.density, rtol=1e-6)


def test_long_signals_take_bounded_memory():
    import tracemalloc

    signal = np.random.default_rng(0).standard_normal(1_000_000)
    tracemalloc.start()
    spectrum = multitaper_spectrum(signal, RATE, 4.0, 8192)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert spectrum.segments == 123
    assert peak < 4 * signal.nbytes
    assert spectrum.density[20:-20].std() < 0.05 * spectrum.density.mean()


def mode(frequency: float, damping: float) -> np.ndarray:
    s = 2.0 * np.pi * frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    pole = np.exp(s / RATE)
    return np.real(np.poly([pole, pole.conj()]))


@pytest.mark.parametrize(
    ("numerator", "denominator", "samples", "nfft"),
    [
        ([1.0], [1.0], 1000, 4096),
        ([1.0], [1.0], 8000, 1024),
        ([1.0], [1.0, -0.95], 1500, 4096),
        ([1.0, -2.0, 1.0], [1.0], 1500, 4096),
    ],
)
def test_noise_without_modes_shows_hardly_a_peak(numerator, denominator, samples, nfft):
    """White, low-pass and twice differenced noise: at most one record in twenty may err."""
    found = 0
    for seed in range(80):
        signal = process(denominator, samples, seed, numerator)
        found += bool(spectral_peaks(multitaper_spectrum(signal, RATE, 4.0, nfft)))
    assert found <= 4


def test_known_modes_are_the_peaks():
    """Three modes, one of them damped by 17.5 %, seen through their accelerations."""
    modes = {5.36: (0.0091, 0.02), 16.65: (0.175, 1.0), 37.0: (0.0107, 0.05)}
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(7500)
        signal = sum(
            weight * lfilter([1.0, -1.0], mode(frequency, damping), noise)
            for frequency, (damping, weight) in modes.items()
        )[3000:]
        spectrum = multitaper_spectrum(signal, RATE, 4.0, 8192)
        peaks = spectral_peaks(spectrum)
        assert len(peaks) == 3
        np.testing.assert_allclose(
            [peak.frequency_hz for peak in peaks], list(modes), atol=0.2, rtol=0.15
        )
        for peak in peaks:
            assert peak.lower < peak.density < peak.upper
            assert peak.prominence_db > 2.0


def test_two_close_lines_are_two_peaks_and_their_place_is_right():
    time = np.arange(4000) / RATE
    signal = np.sin(2 * np.pi * 10.0 * time) + 0.5 * np.sin(2 * np.pi * 10.7 * time)
    signal += 0.01 * np.random.default_rng(0).standard_normal(4000)
    spectrum = multitaper_spectrum(signal, RATE, 4.0, 8192)
    frequencies = [peak.frequency_hz for peak in spectral_peaks(spectrum)]
    w = spectrum.halfbandwidth_hz
    assert any(abs(f - 10.0) < w for f in frequencies)
    assert any(abs(f - 10.7) < w for f in frequencies)
    assert all(min(abs(f - 10.0), abs(f - 10.7)) < w for f in frequencies)


@pytest.mark.parametrize(("samples", "noise"), [(500, 0.1), (500, 1.0), (4000, 1.0), (4000, 5.0)])
def test_gain_band_covers_the_true_gain_in_95_percent(samples, noise):
    numerator, denominator, nfft = [0.5, 0.3], [1.0, -0.5], 512
    _, truth = freqz(numerator, denominator, worN=nfft // 2 + 1, include_nyquist=True)
    covered = []
    for seed in range(100):
        generator = np.random.default_rng(seed)
        u = generator.standard_normal(samples)
        y = lfilter(numerator, denominator, u) + noise * generator.standard_normal(samples)
        estimate = response_of(u, y, RATE, 4.0, nfft)
        within = (estimate.gain_lower <= np.abs(truth)) & (np.abs(truth) <= estimate.gain_upper)
        covered.append(within[20:-20].mean())
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)


def test_frequency_response_and_coherence_of_a_known_system():
    numerator, denominator = [0.0, 0.5, 0.3], [1.0, -0.5]
    u = np.random.default_rng(0).standard_normal(200_000)
    clean = lfilter(numerator, denominator, u)
    y = clean + clean.std() * np.random.default_rng(1).standard_normal(u.size)
    estimate = response_of(u, y, RATE, 4.0, 1024)
    _, truth = freqz(numerator, denominator, worN=513, include_nyquist=True)
    level = np.abs(truth) ** 2
    expected = level / (level + clean.var())
    # ν = 14 · 196: the standard error of a complex value, and five of them over 500 frequencies.
    allowed = 5.0 * np.sqrt((1.0 - expected) / expected / (7 * 196)) * np.abs(truth)
    assert np.all(np.abs(estimate.response - truth)[4:-4] < allowed[4:-4])
    allowed = 5.0 * (1.0 - expected) * np.sqrt(2.0 * expected / (7 * 196)) + 5.0 / (7 * 196)
    assert np.all(np.abs(estimate.coherence - expected)[4:-4] < allowed[4:-4])
    np.testing.assert_allclose(estimate.phase_deg, np.degrees(np.angle(estimate.response)))


def test_noise_free_systems_and_unrelated_signals():
    u, v = np.random.default_rng(2).standard_normal((2, 4000))
    same = response_of(u, -2.0 * u, RATE, 4.0, 4096)
    np.testing.assert_allclose(same.response, -2.0, atol=1e-10)
    np.testing.assert_allclose(same.coherence, 1.0, atol=1e-10)
    np.testing.assert_allclose(np.abs(same.phase_deg), 180.0, atol=1e-8)
    apart = response_of(u, v, RATE, 4.0, 4096)
    # With K = 7 estimates the mean coherence of unrelated signals is 1 / K.
    assert np.mean(apart.coherence) == pytest.approx(1.0 / 7.0, abs=0.02)
    assert np.all(np.isfinite(apart.gain_upper))
    assert apart.coherence.max() <= 1.0


@pytest.mark.parametrize(
    ("signal", "settings", "problem"),
    [
        (np.ones(100), {}, "constant"),
        (np.arange(6.0), {}, "too short"),
        (np.arange(100.0), {"nfft": 8}, "too short"),
        (np.arange(100.0), {"time_halfbandwidth": 0.5}, "leaves no taper"),
        (np.arange(100.0), {"time_halfbandwidth": 60.0}, "too short"),
    ],
)
def test_settings_that_do_not_fit(signal, settings, problem):
    with pytest.raises(InputError, match=problem):
        multitaper_spectrum(signal, RATE, **settings)


def test_frequency_responses_that_cannot_be_estimated():
    u = np.random.default_rng(0).standard_normal(100)
    with pytest.raises(InputError, match="single taper"):
        response_of(u, u, RATE, 1.0)
    with pytest.raises(InputError, match="constant"):
        response_of(u, np.ones(100), RATE)


def test_several_channels_and_recordings_of_a_known_system():
    """Two correlated inputs and two outputs in three recordings, against the true response."""
    generator = np.random.default_rng(4)
    recordings = []
    for samples in (30_000, 20_000, 25_000):
        u = generator.standard_normal((samples, 2)) @ np.array([[1.0, 0.7], [0.0, 1.0]])
        clean = np.column_stack([lfilter([0.0, 0.5], [1.0, -0.5], u[:, 0]), u[:, 1]])
        clean[:, 1] += lfilter([0.3], [1.0, 0.4], u[:, 0])
        recordings.append(Recording(u, clean + 0.5 * generator.standard_normal(u.shape), RATE))
    found = frequency_response(concatenated(recordings), 5.0, 512)
    other = frequency_response(concatenated(recordings[::-1]), 5.0, 512)
    np.testing.assert_allclose(found.response, other.response, rtol=1e-9)
    first = freqz([0.0, 0.5], [1.0, -0.5], worN=257, include_nyquist=True)[1]
    second = freqz([0.3], [1.0, 0.4], worN=257, include_nyquist=True)[1]
    truth = np.moveaxis(np.array([[first, 0.0 * first], [second, 1.0 + 0.0 * first]]), -1, 0)
    inner_ones = slice(6, -6)
    assert np.abs(found.response - truth)[inner_ones].max() < 0.08
    covered = (found.gain_lower <= np.abs(truth)) & (np.abs(truth) <= found.gain_upper)
    for row, column in ((0, 0), (1, 0), (1, 1)):
        assert np.mean(covered[inner_ones, row, column]) > 0.9
    assert found.coherence.shape == (257, 2)


def test_coherence_of_independent_signals_exceeds_its_limit_as_often_as_stated():
    u, y = np.random.default_rng(5).standard_normal((2, 60_000))
    both = Recording(np.column_stack([u, np.roll(u, 7000) ** 3]), y, 1.0)
    for recording in (Recording(u, y, 1.0), both):
        found = frequency_response(recording, 4.0, 2048)
        exceeded = found.coherence[:, 0] > found.coherence_limit(0.05)
        assert np.mean(exceeded) == pytest.approx(0.05, abs=0.04)
