"""The covariance for coloured residuals, against repeated records."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.estimation.pem.covariance import coloured_covariance

COEFFICIENTS = np.array([1.0, 0.5])
RECORDS, SAMPLES = 400, 800


def fitted(generator, objective="quadratic"):
    """Least squares of an FIR model whose input and noise are both slow."""
    u, e = lfilter([1.0], [1.0, -0.9], generator.standard_normal((2, SAMPLES + 100)))[:, 100:]
    regressors = np.column_stack([u[1:], u[:-1]])
    output = regressors @ COEFFICIENTS + e[1:]
    estimate = np.linalg.lstsq(regressors, output, rcond=None)[0]
    return estimate, -regressors, output - regressors @ estimate


@pytest.mark.parametrize("input_alone", [True, False])
def test_intervals_cover_the_truth_although_the_residuals_are_coloured(input_alone):
    generator = np.random.default_rng(1)
    inside = classical = 0
    for _ in range(RECORDS):
        estimate, jacobian, residuals = fitted(generator)
        known = coloured_covariance(jacobian, residuals, 2, "quadratic", input_alone)
        # The static gain, which slow noise makes most uncertain.
        error = abs(np.sum(estimate - COEFFICIENTS))
        inside += error < 1.96 * known.standard_errors(np.ones((1, 2)))[0]
        white = np.linalg.inv(jacobian.T @ jacobian) * np.var(residuals)
        classical += error < 1.96 * np.sqrt(white.sum())
    # Three standard deviations of the share are 3.3 %; lag windows underestimate slow noise.
    assert inside / RECORDS == pytest.approx(0.95, abs=0.035 if input_alone else 0.08)
    assert classical / RECORDS < 0.6


def test_white_residuals_have_the_classical_covariance():
    generator = np.random.default_rng(2)
    jacobian, residuals = generator.standard_normal((2000, 3)), generator.standard_normal(2000)
    known = coloured_covariance(jacobian, residuals, 3, "quadratic", input_alone=True)
    classical = np.linalg.inv(jacobian.T @ jacobian) * np.var(residuals)
    np.testing.assert_allclose(known.matrix, classical, rtol=5e-3, atol=1e-6)
