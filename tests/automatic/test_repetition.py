"""How many samples are independent, where residuals repeat with the input."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic.cross_validation.folds import decide_repetition
from evopem.signals.recording import Segment
from evopem.signals.spectra import repetition_lag

A, B = [1.0, -1.5, 0.8], [0.0, 1.0, 0.5]


def periodic(generator, periods=5):
    return np.tile(generator.standard_normal(200), periods)


def test_a_cubic_system_repeats_its_errors_with_the_input():
    generator = np.random.default_rng(1)
    u = periodic(generator)
    y = lfilter(B, A, u + 0.2 * u**3)
    found = decide_repetition([Segment(u, y + 1e-3 * generator.standard_normal(len(y)))])
    # Five periods of the same errors count as one.
    assert (found.lag, found.independent) == (200, pytest.approx(0.2, abs=0.03))


def test_every_sample_of_a_linear_system_counts():
    generator = np.random.default_rng(2)
    u = periodic(generator)
    y = lfilter(B, A, u) + generator.standard_normal(len(u))
    found = decide_repetition([Segment(u, y)])
    assert (found.lag, found.independent) == (200, 1.0)


def test_what_repeats_counts_as_much_as_its_share_of_the_residuals():
    generator = np.random.default_rng(3)
    u = periodic(generator)
    errors = np.tile(generator.standard_normal(200), 5)
    y = lfilter(B, A, u) + lfilter([1.0], A, errors + generator.standard_normal(len(u)))
    found = decide_repetition([Segment(u, y)])
    # Half of the power repeats: 1 / (1 + 4 / 2) of the samples.
    assert found.independent == pytest.approx(1 / 3, abs=0.06)


@pytest.mark.parametrize(("sign", "lag"), [(1.0, 200), (-1.0, 100)])
def test_half_periods_of_the_opposite_sign_are_repetitions(sign, lag):
    part = np.random.default_rng(4).standard_normal(100)
    other = sign * part if sign < 0 else np.random.default_rng(5).standard_normal(100)
    assert repetition_lag(np.tile(np.concatenate([part, other]), 4)) == lag


@pytest.mark.parametrize(
    "signal",
    [
        np.random.default_rng(6).standard_normal(500),
        np.cumsum(np.random.default_rng(7).standard_normal(500)),
        np.ones(50),
        np.arange(50.0),
        np.array([1.0]),
    ],
)
def test_other_inputs_do_not_repeat(signal):
    assert repetition_lag(signal) == 0
