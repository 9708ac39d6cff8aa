"""Short records with known truths for the tests of the automatic recipe."""

import numpy as np
from scipy.signal import lfilter


def noisy(y, noise, percent):
    return y + percent / 100.0 * y.std() / noise.std() * noise


def output_error_record(samples=400, percent=20.0, delay=1, seed=3):
    """A second-order resonance with white noise at the output; input, output, noise-free output."""
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    y = lfilter([0.0] * delay + [1.0, 0.5], [1.0, -1.5, 0.8], u)
    return u, noisy(y, e, percent), y


def error_percent(y, computed):
    return 100.0 * np.linalg.norm(y - computed) / np.linalg.norm(y - y.mean())
