"""Compiled kernels of the general polynomial model, under one name."""

from evopem.estimation.pem.kernels.polynomial_gauss_newton import (
    polynomial_gauss_newton_matrices,
    polynomial_jacobian,
)
from evopem.estimation.pem.kernels.polynomial_gradient import (
    polynomial_residuals,
    polynomial_values,
    polynomial_values_and_gradients,
)
from evopem.estimation.pem.kernels.polynomial_record import (
    PolynomialObjective,
    PolynomialRecord,
    PolynomialWorkspace,
    polynomial_record,
    polynomial_workspace,
)
from evopem.estimation.pem.kernels.polynomial_residuals import feasible_polynomials

__all__ = [
    "PolynomialObjective",
    "PolynomialRecord",
    "PolynomialWorkspace",
    "feasible_polynomials",
    "polynomial_gauss_newton_matrices",
    "polynomial_jacobian",
    "polynomial_record",
    "polynomial_residuals",
    "polynomial_values",
    "polynomial_values_and_gradients",
    "polynomial_workspace",
]
