"""The null distribution of the Ljung-Box statistic for the residuals of a fit."""

from dataclasses import replace

import numpy as np
import pytest
from covariances import covariance_of_matrix
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.estimation.state_space.estimate import estimates_of_orders
from evopem.signals.recording import Recording
from evopem.validation.residual_tests import (
    EstimationResiduals,
    autocorrelation_of,
    fit_effects,
    whiteness_test,
)
from evopem.validation.responses import stretches_of

SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=4, nu=4, evaluations=1)


def expected(seed, autoregressive=True, objective="quadratic"):
    """Expected statistic over 30 lags of an AR(3) fit, or of a regression on exogenous signals."""
    generator = np.random.default_rng(seed)
    x = lfilter([1.0], [1.0, -1.0, 0.5], generator.standard_normal(20_000))
    target, regressors = x, toeplitz(np.r_[0.0, x[:-1]], np.zeros(3))
    if not autoregressive:
        target, *columns = generator.standard_normal((4, 20_000))
        regressors = np.column_stack(columns)
    found = np.linalg.lstsq(regressors, target, rcond=None)[0]
    residuals = target - regressors @ found
    # Of least absolute errors of normal residuals the variance is π/2 times as large.
    spread = np.var(residuals) * (1.0 if objective == "quadratic" else np.pi / 2)
    covariance = covariance_of_matrix(spread * np.linalg.inv(regressors.T @ regressors))
    along = lambda step: (-regressors @ step)[:, None]  # noqa: E731
    effects = fit_effects(residuals[:, None], along, covariance, 30)
    return whiteness_test(residuals, 30, (), effects[0], objective).expected


def test_a_fit_takes_what_it_determines_from_the_autocorrelations():
    """An autoregression its order (Box & Pierce 1970), exogenous regressors nothing."""
    assert expected(1) == pytest.approx(27.0, abs=0.1)
    assert expected(2, autoregressive=False) == pytest.approx(30.0, abs=0.1)


def test_a_least_absolute_fit_takes_less():
    """Gaussian innovations: it takes 2 - π/2 of what least squares takes."""
    taken = 30.0 - expected(6, objective="absolute")
    assert taken / (30.0 - expected(6)) == pytest.approx(2 - np.pi / 2, abs=0.05)


def test_a_fit_takes_nothing_where_no_residual_is_near_zero():
    """Their density there is 0, of residuals of two sizes alone."""
    e = np.sign(lfilter([1.0], [1.0, -0.8], np.random.default_rng(8).standard_normal(500)))
    test = whiteness_test(e, 10, effects=np.full((1, 10), 1e150), objective="absolute")
    assert test.expected == 10.0
    assert test.p_value < 1e-6


def test_what_cannot_be_tested_is_not_judged():
    assert np.isnan(whiteness_test(np.zeros(50), 10).p_value)
    assert np.isnan(whiteness_test(np.arange(50.0), 50).p_value)
    endless = whiteness_test(np.random.default_rng(1).normal(size=50), 4, (), 100.0 * np.eye(4))
    assert np.isnan(endless.p_value)


def p_value(model, u, y, lags):
    recording = Recording(u.reshape(len(y), -1), y.reshape(len(y), -1), 1.0)
    tested = EstimationResiduals.of(stretches_of(model, recording))
    effects = tested.fit_effects(lags)
    return whiteness_test(tested.residuals[:, 0], lags, tested.bounds, effects[0]).p_value


def test_effects_are_the_derivatives_of_the_autocorrelations():
    """Of a delayed input, two outputs, two recordings: differences of fourth order beside them."""
    generator = np.random.default_rng(3)
    u, e = generator.standard_normal((200, 1)), generator.standard_normal((200, 2))
    y = lfilter([0.0, 0.0, 1.0], [1.0, -1.5, 0.7], u, axis=0) * [1.0, 2.0] + e + [5.0, -3.0]
    pair = {"segment_starts": (0, 90), "segment_recordings": (0, 1)}
    recording = Recording(u, y, 1.0, **pair)
    (fit,) = estimates_of_orders(recording, [2], delays=2, width=1)
    stretches = stretches_of(fit.model, recording)
    tested = EstimationResiduals.of(stretches)

    def correlations(step):
        moved = fit.model.with_parameters(fit.model.parameters + step)
        residuals = EstimationResiduals.of([replace(s, model=moved) for s in stretches]).residuals
        return np.array([autocorrelation_of(r, 8, tested.bounds).values[1:] for r in residuals.T])

    effects = tested.fit_effects(8) / np.sqrt(len(tested.residuals))
    for column, effect in zip(
        fit.model.covariance.factor.T, effects.transpose(1, 0, 2), strict=True
    ):
        near, far = (correlations(h * column) - correlations(-h * column) for h in (1e-3, 2e-3))
        assert effect == pytest.approx((8.0 * near - far) / 12e-3, abs=1e-8)


def record(seed, noise, samples=600):
    u, e = np.random.default_rng([8, seed]).standard_normal((2, samples))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
    return u, y + noise * lfilter([1.0, -0.6], [1.0, -1.5, 0.7], e)


@pytest.mark.parametrize("noise", [0.05, 50.0])
def test_true_models_are_rejected_at_the_stated_level(noise):
    p_values = []
    for seed in range(100):
        u, y = record(seed, noise)
        fit = estimate(u, y, (2, 2, 1, 1), settings=SEARCH)
        p_values.append(p_value(fit.model, u, y, 13))
    _assert_level(p_values)


def test_state_space_models_of_the_right_order_are_rejected_at_the_stated_level():
    """With as many degrees of freedom as lags less states the test would be too strict or weak."""
    p_values = []
    for seed in range(60):
        u, y = record(seed, 2.0)
        recording = Recording(u[:, None], y[:, None], 1.0)
        (fit,) = estimates_of_orders(recording, [2], level=False, width=2)
        p_values.append(p_value(fit.model, u, y, 20))
    _assert_level(p_values)


def _assert_level(p_values):
    # Four binomial standard errors.
    for level in (0.05, 0.5):
        error = np.sqrt(level * (1 - level) / len(p_values))
        assert np.mean(np.array(p_values) < level) == pytest.approx(level, abs=4 * error)


def test_residuals_of_a_model_too_small_are_rejected():
    u, e = np.random.default_rng(9).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + lfilter([1.0], [1.0, 0.0, 0.4], e)
    fit = estimate(u, y, (2, 2, 1, 1), settings=SEARCH)
    assert p_value(fit.model, u, y, 20) < 1e-6


def test_white_noise_whose_size_comes_and_goes_is_white():
    """Without its spread, the statistic rejects two in three of these records at 1 %."""
    generator, rejected = np.random.default_rng(3), []
    for colour in (0.0, 0.3):
        e, size = generator.standard_normal((2, 100, 600))
        e *= np.exp(lfilter([0.3], [1.0, -0.95], size))
        records = lfilter([1.0], [1.0, -colour], e)
        rejected.append(
            np.mean([whiteness_test(e, 25, uneven=True).p_value < 0.01 for e in records])
        )
    # Four binomial standard errors.
    assert rejected[0] <= 0.05 < 0.25 < rejected[1]
