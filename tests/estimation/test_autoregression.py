"""Autoregressions of chosen order."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.signals import least_squares
from evopem.signals.least_squares import autoregression


def test_a_resonance_is_found():
    x = lfilter([1.0], [1.0, -1.5, 0.8], np.random.default_rng(8).standard_normal(20_000))
    assert autoregression(x, 30) == pytest.approx([1.0, -1.5, 0.8], abs=0.02)


def test_white_noise_needs_no_coefficient():
    white = np.random.default_rng(9).standard_normal(5000)
    assert autoregression(white, 30).tolist() == [1.0]


def test_the_rows_of_a_long_signal_are_reduced_in_parts(monkeypatch):
    x = lfilter([1.0], [1.0, -1.5, 0.8], np.random.default_rng(8).standard_normal(3000))
    whole = autoregression(x, 30)
    monkeypatch.setattr(least_squares, "ROWS", 700)
    assert autoregression(x, 30) == pytest.approx(whole, rel=1e-9)
