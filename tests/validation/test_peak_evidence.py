"""Peaks of the output's spectrum against the spectrum that a model gives the output."""

import numpy as np
import pytest
from scipy.signal import lfilter
from two_outputs import beside_white_noise

from evopem.config.settings import SpectrumSettings
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.validation.spectra import peak_evidence

RATE, SAMPLES = 100.0, 4000
SPECTRUM = SpectrumSettings(4.0, 4096)
TWO_MODES = np.real(
    np.poly([r * np.exp(s * 1j * w) for r, w in ((0.97, 0.6), (0.98, 1.9)) for s in (1, -1)])
)
ONE_MODE = np.real(np.poly([0.97 * np.exp(s * 0.6j) for s in (1, -1)]))


def record(seed, noise):
    """Two resonances, reached by a white input, and noise of the same colour."""
    u, e = np.random.default_rng(seed).standard_normal((2, SAMPLES))
    return Recording(
        u, lfilter([0.0, 1.0], TWO_MODES, u) + noise * lfilter([1.0], TWO_MODES, e), RATE
    )


def model(a, noise):
    one = np.array([1.0])
    found = PolynomialModel(a, one, one, nk=1, sampling_rate=RATE, noise_variance=noise**2)
    return found.state_space()


@pytest.mark.parametrize("noise", [0.01, 1.0, 100.0])
def test_the_true_model_gives_every_peak_its_height(noise):
    exceeded = sum(
        any(
            peak.excess > peak.chance
            for peak in peak_evidence(model(TWO_MODES, noise), found, 0, SPECTRUM)
        )
        for found in (record(seed, noise) for seed in range(20))
    )
    assert exceeded <= 1  # 0.2 expected at most; two or more have a probability of 2 %


@pytest.mark.parametrize("noise", [0.01, 1.0, 100.0])
def test_a_model_without_the_mode_lacks_its_power(noise):
    evidence = peak_evidence(model(ONE_MODE, noise), record(1, noise), 0, SPECTRUM)
    (missed,) = [peak for peak in evidence if peak.excess > peak.chance]
    assert missed.frequency_hz == pytest.approx(1.9 * RATE / (2 * np.pi), abs=0.3)


def test_the_limit_counts_the_peaks_of_all_outputs():
    alone, recorded = model(TWO_MODES, 1.0), record(1, 1.0)
    both = beside_white_noise(alone)
    chances = [peak_evidence(each, recorded, 0, SPECTRUM)[0].chance for each in (alone, both)]
    assert chances[1] > 1.02 * chances[0]


def test_of_an_unstable_model_there_is_no_density():
    unstable = model(np.array([1.0, -1.5]), 1.0)
    evidence = peak_evidence(unstable, record(1, 1.0), 0, SPECTRUM)
    assert evidence
    assert all(np.isnan(peak.excess) for peak in evidence)
