"""Factored covariances: propagation, unidentifiable directions, Wald tests."""

import numpy as np
import pytest
from covariances import covariance_of_matrix

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial_roots import root_covariance


def test_a_matrix_and_its_factored_form_agree():
    root = np.random.default_rng(1).standard_normal((4, 4)) * [1.0, 1e-3, 1e3, 1.0]
    matrix = root.T @ root
    covariance = covariance_of_matrix(matrix)
    np.testing.assert_allclose(covariance.matrix, matrix, rtol=1e-9)
    jacobian = np.random.default_rng(2).standard_normal((3, 4))
    np.testing.assert_allclose(covariance.of(jacobian), jacobian @ matrix @ jacobian.T, rtol=1e-9)
    np.testing.assert_allclose(
        covariance.standard_errors(jacobian) ** 2, np.diag(covariance.of(jacobian)), rtol=1e-12
    )


def test_variances_that_rounding_makes_negative_stay_positive():
    """Nearly dependent parameters, as a fit with many poles close together has."""
    basis = np.vander(np.linspace(0.9, 1.0, 7), 7)
    factor = np.linalg.inv(basis)
    difference = basis[[3]]
    by_matrix = difference @ (factor @ factor.T) @ difference.T
    error = ParameterCovariance(factor, np.zeros((7, 0))).standard_errors(difference)
    # The row of the basis times its inverse is a unit vector; the product with P is lost.
    assert error[0] == pytest.approx(1.0, rel=1e-4)
    assert abs(by_matrix[0, 0] - 1.0) > 0.1


def test_what_depends_on_an_unidentifiable_direction_has_an_infinite_error():
    direction = np.array([[1.0], [-1.0], [0.0]])
    factor = np.array([[0.5, 0.0], [0.5, 0.0], [0.0, 2.0]])
    covariance = ParameterCovariance(factor, direction)
    jacobian = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0 + 1e-3, 0.0]]
    assert covariance.standard_errors(jacobian).tolist() == [np.inf, 1.0, 2.0, np.inf]
    matrix = covariance.matrix
    assert np.diag(matrix).tolist() == [np.inf, np.inf, 4.0]
    assert np.isnan(matrix[0, 1:]).all()


def test_a_gradient_that_is_not_finite_has_no_error():
    covariance = ParameterCovariance(np.eye(2), np.zeros((2, 0)))
    assert np.isnan(covariance.standard_errors([[np.inf, 1.0]])).all()
    assert np.isnan(covariance.of([[np.nan, 1.0], [1.0, 0.0]])[0]).all()


def test_a_matrix_with_unknown_entries_leaves_their_parameters_unidentifiable():
    matrix = np.array([[1.0, np.nan, 0.1], [np.nan, np.inf, np.nan], [0.1, np.nan, 2.0]])
    covariance = covariance_of_matrix(matrix)
    assert covariance.standard_errors(np.eye(3)) == pytest.approx([1.0, np.inf, np.sqrt(2.0)])


def test_a_root_that_the_data_do_not_determine_has_infinite_variances():
    # 1 - 0.5 q^-1 times an arbitrary factor 1 - x q^-1: only the root 0.5 is identifiable.
    a = np.convolve([1.0, -0.5], [1.0, -0.2])
    direction = np.array([[-1.0], [0.5]])
    covariance = ParameterCovariance(np.array([[0.1], [-0.05]]), direction)
    assert np.isfinite(root_covariance(a, 0.5, covariance)[0, 0])
    assert root_covariance(a, 0.2, covariance)[0, 0] == np.inf
