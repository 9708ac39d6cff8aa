"""Standard errors of responses against closed forms and Monte Carlo."""

import numpy as np
import pytest
from covariances import covariance_of_matrix, response_standard_errors

from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import time_response_table

ONE = np.ones(1)


def model(covariance):
    if covariance is not None:
        covariance = covariance_of_matrix(covariance)
    return PolynomialModel(
        ONE, np.array([2.0, 1.0]), ONE, ONE, np.array([1.0, -0.8]), 1, covariance=covariance
    )


def test_the_static_gain_has_the_error_of_its_closed_form():
    covariance = np.array([[4.0, 1.0, 0.2], [1.0, 3.0, -0.1], [0.2, -0.1, 1.0]]) * 1e-4
    found = response_standard_errors(model(covariance), lambda m: m.frequency_response(0.0).real)
    # G(1) = (b0 + b1) / (1 + f1).
    slope = np.array([1 / 0.2, 1 / 0.2, -3.0 / 0.2**2])
    assert found == pytest.approx(np.sqrt(slope @ covariance @ slope), rel=1e-5)


def test_the_step_response_scatters_as_its_errors_say():
    covariance = np.diag([4.0, 3.0, 0.5]) * 1e-5
    table = time_response_table(model(covariance), ("u",), ("y",), model(covariance))
    found = (table["step_upper"] - table["step"])[:15, None, None] / NORMAL_95
    generator = np.random.default_rng(1)
    drawn = generator.multivariate_normal([2.0, 1.0, -0.8], covariance, size=4000)
    responses = [
        PolynomialModel(ONE, p[:2], ONE, ONE, np.array([1.0, p[2]]), 1).step_response(15)
        for p in drawn
    ]
    np.testing.assert_allclose(found, np.std(responses, axis=0), rtol=0.06, atol=1e-12)
