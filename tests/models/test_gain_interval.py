"""The band of the gain, against a closed form and against drawn parameters."""

import numpy as np
import pytest
from covariances import covariance_of_matrix

from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import NORMAL_95, response_interval

FREQUENCIES = np.linspace(0.5, 45.0, 12)


def gain_band(model, frequencies):
    return [each[:, 0, 0] for each in response_interval(model, frequencies)[:2]]


def model(covariance):
    return PolynomialModel(
        A=np.array([1.0, -1.2, 0.8]),
        B=np.array([0.5, 0.3]),
        C=np.array([1.0, 0.4]),
        nk=2,
        sampling_rate=100.0,
        covariance=None if covariance is None else covariance_of_matrix(covariance),
    )


def test_a_pure_gain_has_the_band_of_its_coefficient():
    covariance = np.diag([0.01, 0.5])
    pure = PolynomialModel(
        np.ones(1),
        np.array([-2.0]),
        np.array([1.0, 0.1]),
        nk=3,
        sampling_rate=100.0,
        covariance=covariance_of_matrix(covariance),
    )
    lower, upper = gain_band(pure, FREQUENCIES)
    spread = np.exp(NORMAL_95 * 0.1 / 2.0)
    assert lower == pytest.approx(np.full(12, 2.0 / spread), rel=1e-12)
    assert upper == pytest.approx(np.full(12, 2.0 * spread), rel=1e-12)


def test_drawn_parameters_lie_inside_the_band_as_often_as_it_says():
    generator = np.random.default_rng(1)
    root = generator.normal(size=(5, 5)) * 2e-3
    covariance = root @ root.T
    true = model(covariance)
    lower, upper = gain_band(true, FREQUENCIES)
    draws = 4000
    drawn = generator.multivariate_normal(true.parameters, covariance, size=draws)
    gains = np.array(
        [
            np.abs(
                PolynomialModel(
                    np.r_[1.0, p[:2]], p[2:4], np.r_[1.0, p[4:]], nk=2, sampling_rate=100.0
                ).frequency_response(FREQUENCIES)[:, 0, 0]
            )
            for p in drawn
        ]
    )
    inside = np.mean((gains > lower) & (gains < upper), axis=0)
    # Four standard errors of a share of 95 % of the draws.
    assert inside == pytest.approx(np.full(12, 0.95), abs=4.0 * np.sqrt(0.95 * 0.05 / draws))


def test_without_a_covariance_there_is_no_band():
    lower, upper = gain_band(model(None), FREQUENCIES)
    assert np.isnan(lower).all()
    assert np.isnan(upper).all()
