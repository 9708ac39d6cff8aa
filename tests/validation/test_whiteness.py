"""The null distribution of the Ljung-Box statistic for the residuals of a fit."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from evopem import SearchSettings, estimate
from evopem.errors import InputError
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.signals.recording import Segment
from evopem.validation.residual_tests import residual_autocorrelation_covariance, whiteness_test

SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=4, nu=4, evaluations=1)


def regression(seed, samples=400, p=3, autoregressive=True):
    """Residuals and Jacobian of an AR(p) fit, or of a regression on p exogenous signals."""
    generator = np.random.default_rng(seed)
    e = generator.standard_normal(samples)
    x = lfilter([1.0], [1.0, -1.0, 0.5], e)
    if autoregressive:
        jacobian = toeplitz(np.r_[0.0, x[:-1]], np.zeros(p))
    else:
        jacobian = generator.standard_normal((samples, p))
    return x - jacobian @ np.linalg.lstsq(jacobian, x, rcond=None)[0], jacobian


def test_an_autoregression_takes_its_order_from_the_expected_value():
    """Box & Pierce (1970): the covariance is a projection of rank lags - p for many lags."""
    residuals, jacobian = regression(1, samples=20_000)
    covariance = residual_autocorrelation_covariance(residuals, [jacobian], 30, "quadratic")
    eigenvalues = np.linalg.eigvalsh(covariance)
    assert eigenvalues[:2] == pytest.approx([0.0, 0.0], abs=0.05)
    assert eigenvalues[3:] == pytest.approx(np.ones(27), abs=0.05)
    # The theory of McLeod (1978) for AR(2): I - X J^-1 X', from the impulse response of 1/A.
    impulse = lfilter([1.0], [1.0, -1.0, 0.5], np.eye(1, 30)[0])
    score = toeplitz(impulse, np.zeros(3))
    theory = np.eye(30) - score @ np.linalg.pinv(score.T @ score) @ score.T
    assert np.abs(covariance - theory).max() < 0.05


def test_exogenous_regressors_take_nothing():
    _, jacobian = regression(2, samples=20_000, autoregressive=False)
    white = np.random.default_rng(3).standard_normal(20_000)
    covariance = residual_autocorrelation_covariance(white, [jacobian], 30, "quadratic")
    assert np.trace(covariance) == pytest.approx(30.0, abs=0.1)


def test_blocks_of_rows_give_what_the_whole_matrix_gives():
    residuals, jacobian = regression(4)
    blocks = [jacobian[:7], jacobian[7:150], jacobian[150:]]
    for objective in ("quadratic", "absolute"):
        np.testing.assert_allclose(
            residual_autocorrelation_covariance(residuals, blocks, 20, objective),
            residual_autocorrelation_covariance(residuals, [jacobian], 20, objective),
            atol=1e-12,
        )


def test_columns_that_say_the_same_count_once():
    residuals, jacobian = regression(5)
    twice = np.hstack([jacobian, jacobian[:, :1] - 1e3 * jacobian[:, 1:2]])
    np.testing.assert_allclose(
        residual_autocorrelation_covariance(residuals, [twice], 20, "quadratic"),
        residual_autocorrelation_covariance(residuals, [jacobian], 20, "quadratic"),
        atol=1e-9,
    )


def test_a_least_absolute_fit_takes_less():
    """Gaussian innovations: it takes 2 - π/2 of what least squares takes."""
    residuals, jacobian = regression(6, samples=20_000)
    traces = [
        np.trace(residual_autocorrelation_covariance(residuals, [jacobian], 30, objective))
        for objective in ("quadratic", "absolute")
    ]
    assert (30 - traces[1]) / (30 - traces[0]) == pytest.approx(2 - np.pi / 2, abs=0.05)


def test_sizes_that_do_not_fit_are_refused():
    residuals, jacobian = regression(7)
    with pytest.raises(ValueError, match="rows"):
        whiteness_test(residuals, [jacobian[:-1]], 20, "quadratic")
    with pytest.raises(ValueError, match="lags"):
        whiteness_test(residuals, [jacobian], 400, "quadratic")


def test_residuals_that_vanish_are_not_judged():
    assert np.isnan(whiteness_test(np.zeros(50), [np.ones((50, 1))], 10, "quadratic").p_value)


def jacobian_of(fit, u, y):
    given = ([Segment(u, y)], fit.model.orders, "quadratic", 1.0, 1.0, False, fit.window)
    errors = PolynomialErrors(*given)
    return errors.jacobian_blocks(np.concatenate([fit.model.parameters, fit.noise_state]))


def false_alarms(noise, records):
    """p-values at the true orders of ARMAX(2,2,1,1)."""
    found = []
    for seed in range(records):
        u, e = np.random.default_rng([8, seed]).standard_normal((2, 600))
        y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
        y += noise * lfilter([1.0, -0.6], [1.0, -1.5, 0.7], e)
        fit = estimate(u, y, (2, 2, 1, 1), settings=SEARCH)
        jacobian = jacobian_of(fit, u, y)
        residuals = fit.residuals[fit.window.loss_start :]
        found.append(whiteness_test(residuals, jacobian, 13, "quadratic").p_value)
    return np.array(found)


@pytest.mark.parametrize("noise", [0.05, 50.0])
def test_true_models_are_rejected_at_the_stated_level(noise):
    p_values = false_alarms(noise, 150)
    # Four binomial standard errors.
    for level in (0.05, 0.5):
        error = np.sqrt(level * (1 - level) / len(p_values))
        assert np.mean(p_values < level) == pytest.approx(level, abs=4 * error)


def test_residuals_of_a_model_too_small_are_rejected():
    u, e = np.random.default_rng(9).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + lfilter([1.0], [1.0, 0.0, 0.4], e)
    fit = estimate(u, y, (2, 2, 1, 1), settings=SEARCH)
    jacobian = jacobian_of(fit, u, y)
    test = whiteness_test(fit.residuals[fit.window.loss_start :], jacobian, 20, "quadratic")
    assert test.p_value < 1e-6


def test_an_unknown_objective_is_refused():
    residuals, jacobian = regression(6)
    with pytest.raises(InputError, match="'cubic' is not known; give absolute or quadratic"):
        whiteness_test(residuals, [jacobian], 20, "cubic")
