"""Residual tests against another library, brute force and Monte Carlo."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.validation.residual_tests import (
    autocorrelation_of,
    correlation_with_input,
    ljung_box_lags,
    whiteness_test,
)
from evopem.validation.spectra import excitation_order
from evopem.validation.tables import error_percent


def test_the_statistic_is_that_of_statsmodels():
    diagnostic = pytest.importorskip(
        "statsmodels.stats.diagnostic", reason="statsmodels is not installed to compare with"
    )
    e = lfilter([1, 0.1], [1.0], np.random.default_rng(1).normal(size=900))
    e = np.sign(e - np.median(e))  # of one size, so that no correlation has a spread of its own
    for lags in (20, 100):
        theirs = diagnostic.acorr_ljungbox(e, lags=[lags]).iloc[0]
        # Without any estimate the weights are 1, and the distribution is chi-square.
        ours = whiteness_test(e, lags)
        assert ours.statistic == pytest.approx(theirs["lb_stat"], rel=1e-10)
        assert ours.expected == pytest.approx(lags)
        assert ours.p_value == pytest.approx(theirs["lb_pvalue"], rel=1e-5)


def test_lag_count_leaves_freedom():
    assert ljung_box_lags(4000, 14, 1200) == 36
    assert ljung_box_lags(4000, 40, 1200) == 50
    assert ljung_box_lags(100, 14, 12) == 12


def test_autocorrelation_is_cut_to_the_record():
    table = autocorrelation_of(np.random.default_rng(2).normal(size=30), 1200).table(
        "autocorrelation"
    )
    assert table["lag"].max() == 29
    assert table["autocorrelation"].iloc[0] == pytest.approx(1.0)


def test_white_residuals_have_95_percent_inside():
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(400):
        found = autocorrelation_of(rng.normal(size=1000), 20)
        inside.append(found.share_inside)
    # 8000 nearly independent lags: standard error 0.25 %.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_cross_correlation_sign_and_values_by_brute_force():
    rng = np.random.default_rng(4)
    u, e = rng.normal(size=50), rng.normal(size=50)
    table = (
        correlation_with_input(e, u, 7)
        .table("cross_correlation")
        .set_index("lag")["cross_correlation"]
    )
    e0, u0 = e - e.mean(), u - u.mean()
    scale = np.sqrt((e0 @ e0) * (u0 @ u0))
    for lag in range(-7, 8):
        pairs = [e0[t] * u0[t - lag] for t in range(50) if 0 <= t - lag < 50]
        assert table[lag] == pytest.approx(sum(pairs) / scale, abs=1e-12)


def test_a_residual_that_follows_the_input_shows_at_positive_lag():
    u = np.random.default_rng(5).normal(size=500)
    e = np.concatenate([np.zeros(3), u[:-3]])
    table = correlation_with_input(e, u, 10).table("cross_correlation")
    assert table.loc[table["cross_correlation"].idxmax(), "lag"] == 3


def test_cross_correlation_bound_covers_95_percent_for_coloured_signals():
    """The bound of white signals, 1.96/√N, covers far less here."""
    rng = np.random.default_rng(6)
    inside, inside_white = [], []
    for _ in range(300):
        u = lfilter([1.0], [1, -0.8], rng.normal(size=2000))
        e = lfilter([1.0], [1, -0.6], rng.normal(size=2000))
        found = correlation_with_input(e, u, 20)
        inside.append(found.share_inside)
        inside_white.append(np.mean(np.abs(found.values) <= 1.96 / np.sqrt(2000)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.mean(inside_white) < 0.85


@pytest.mark.parametrize("pole", [0.0, 0.8])
@pytest.mark.parametrize("held", [1, 50])
def test_cross_correlations_that_hang_together_hold_their_level(pole, held):
    """As many as 15 % of such pairs have less than 90 % of the correlations inside their bounds."""
    rng, few, significant = np.random.default_rng(8), 0, 0
    for _ in range(200):
        u = np.repeat(rng.normal(size=3000 // held), held)
        e = lfilter([1.0], [1, -pole], rng.normal(size=3000))
        found = correlation_with_input(e, u)
        few, significant = few + (found.share_inside < 0.9), significant + (found.p_value < 0.05)
    assert significant <= 20  # expectation 10; more has a probability below 0.2 %
    assert (few >= 10) == (held > 1)


@pytest.mark.parametrize("held", [20, 50])
def test_a_slow_response_that_is_missed_is_found_in_all_cross_correlations_together(held):
    """6 % of the variance of residuals, spread over more lags than show it one by one."""
    rng, together, one = np.random.default_rng(9), 0, 0
    for _ in range(40):
        u = np.repeat(rng.normal(size=600 // held), held)
        missed = lfilter([1.0], [1, -0.9], u)
        e = rng.normal(size=600) + np.sqrt(0.06) * missed / missed.std()
        found = correlation_with_input(e, u)
        together, one = together + (found.p_value < 0.01), one + (found.largest_ratio > 2.15)
    assert together >= 20
    assert one <= together


@pytest.mark.parametrize("segments", [1, 10])
def test_a_long_response_that_is_missed_is_found_where_lags_are_many(segments):
    """Of 500 samples, or stretches of 50, the largest lags have few or no products."""
    rng, found = np.random.default_rng(10), 0
    bounds = np.linspace(0, 500, segments + 1).astype(int)
    for _ in range(40):
        u, taps = rng.normal(size=500), rng.normal(size=30)
        missed = lfilter(taps, [1.0], u)
        e = rng.normal(size=500) + 0.5 * missed / missed.std()
        found += correlation_with_input(e, u, bounds=bounds).p_value < 0.01
    assert found >= 30


def test_cross_correlation_bound_of_white_residuals_is_that_of_white_signals():
    rng = np.random.default_rng(7)
    u = lfilter([1.0], [1, -0.9], rng.normal(size=4000))
    bound = (
        correlation_with_input(rng.normal(size=4000), u, 5)
        .table("cross_correlation")["bound95"]
        .iloc[0]
    )
    assert bound == pytest.approx(1.96 / np.sqrt(4000), rel=0.1)


def test_constant_signals_have_no_correlation():
    found = correlation_with_input(np.zeros(20), np.arange(20.0), 4)
    assert found.table("cross_correlation")["cross_correlation"].isna().all()
    assert np.isnan(found.share_inside)
    assert np.isnan(found.p_value)


def test_scores_by_hand():
    y, y_hat = [3.0, 4.0, 0.0, -1.0], [3.0, 4.0, 1.0, -3.0]
    # ‖y − ŷ‖² = 5, mean 1.5: ‖y − ȳ‖² = 17.
    assert error_percent(y, y_hat) == pytest.approx(100 * np.sqrt(5 / 17))
    assert np.isnan(error_percent([0.0, 0.0], [1.0, 1.0]))


@pytest.mark.parametrize(("lines", "order"), [(1, 2), (3, 6)])
def test_sines_excite_two_directions_each(lines, order):
    t = np.arange(20_000)
    u = sum(np.sin(2 * np.pi * (0.07 + 0.11 * k) * t) for k in range(lines))
    assert excitation_order(u, 12) == order


def test_white_noise_excites_every_direction_and_a_constant_none():
    assert excitation_order(np.random.default_rng(8).normal(size=5000), 25) == 25
    assert excitation_order(np.full(100, 0.1), 5) == 0
