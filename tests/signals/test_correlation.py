from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evopem.errors import InputError
from evopem.signals.correlation import autocorrelation
from evopem.signals.spectra import cross_correlation


def direct(x: np.ndarray, y: np.ndarray, lag: int) -> float:
    """The definition, summed term by term."""
    x, y = x - x.mean(), y - y.mean()
    total = sum(x[t + lag] * y[t] for t in range(x.size) if 0 <= t + lag < x.size)
    return total / np.sqrt(np.sum(x**2) * np.sum(y**2))


@given(st.integers(2, 40), st.integers(0, 39), st.integers(0, 2**32 - 1))
def test_against_the_definition(samples, lags, seed):
    lags = min(lags, samples - 1)
    x, y = np.random.default_rng(seed).standard_normal((2, samples)) + 5.0
    cross = cross_correlation(x, y, lags)
    expected = [direct(x, y, lag) for lag in range(-lags, lags + 1)]
    np.testing.assert_allclose(cross, expected, atol=1e-12)
    auto = autocorrelation(x, lags)
    np.testing.assert_allclose(auto, [direct(x, x, k) for k in range(lags + 1)], atol=1e-12)


def test_signals_whose_squares_underflow_correlate_as_others_do():
    """What is left of a record without noise."""
    x, y = np.random.default_rng(3).standard_normal((2, 50))
    small = 1e-200 * x
    np.testing.assert_allclose(autocorrelation(small, 5), autocorrelation(x, 5), atol=1e-12)
    np.testing.assert_allclose(
        cross_correlation(small, y, 5), cross_correlation(x, y, 5), atol=1e-12
    )
    with pytest.raises(InputError, match="constant"):
        autocorrelation(np.zeros(50), 5)


def test_against_statsmodels():
    acf = pytest.importorskip("statsmodels.tsa.stattools").acf
    signals = np.random.default_rng(0).standard_normal((2, 500))
    expected = [acf(x, nlags=100) for x in signals]
    np.testing.assert_allclose(autocorrelation(signals, 100), expected, atol=1e-12)


def test_a_delayed_copy_peaks_at_its_delay():
    u = np.random.default_rng(1).standard_normal(5000)
    y = np.concatenate([np.zeros(7), u[:-7]])
    cross = cross_correlation(y, u, 20)
    assert np.argmax(cross) - 20 == 7
    assert cross.max() == pytest.approx(1.0, abs=0.01)


def test_share_of_white_noise_within_its_bounds():
    shares = [
        np.mean(
            np.abs(autocorrelation(np.random.default_rng(seed).standard_normal(4000), 400)[1:])
            <= 1.96 / np.sqrt(4000)
        )
        for seed in range(30)
    ]
    assert np.mean(shares) == pytest.approx(0.957, abs=0.012)


def test_what_cannot_be_correlated():
    x = np.arange(10.0)
    with pytest.raises(InputError, match="constant"):
        cross_correlation(x, np.ones(10), 2)
