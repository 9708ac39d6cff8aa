"""Covariances from matrices, and errors of responses by central differences.

For tests and benchmarks.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import Model

# Step of a central difference, in standard errors of a coefficient: small against the curvature of
# a response, large against rounding.
STEP = 1e-3


def covariance_of_matrix(matrix: ArrayLike) -> ParameterCovariance:
    """The factored form of a covariance matrix, (n, n).

    A parameter whose variance is not finite is unidentifiable.  Eigenvalues of the correlation
    matrix below its rounding error are raised to that error.
    """
    covariance = np.asarray(matrix, dtype=float)
    variances = np.diag(covariance)
    known = np.isfinite(variances) & (variances >= 0.0)
    known[known] = np.isfinite(covariance[np.ix_(known, known)]).all(axis=1)
    scale = np.sqrt(variances[known])
    divisor = np.where(scale > 0.0, scale, 1.0)
    correlation = covariance[np.ix_(known, known)] / np.outer(divisor, divisor)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (correlation + correlation.T))
    if eigenvalues.size:
        rounding = eigenvalues.size * np.finfo(float).eps * max(eigenvalues[-1], 0.0)
        eigenvalues = np.maximum(eigenvalues, rounding)
    factor = np.zeros((len(covariance), len(scale)))
    factor[known] = scale[:, None] * vectors * np.sqrt(eigenvalues)
    return ParameterCovariance(factor, np.eye(len(covariance))[:, ~known])


def response_standard_errors(model: Model, response: Callable[[Any], Array]) -> Array:
    """Standard errors of a real function of a model, to first order (Ljung 1999, section 9.4).

    ``model``: with a covariance.  ``response``: for instance ``lambda model:
    model.step_response(100)``.  Of the shape of the response; infinite where it depends on a
    direction of the coefficients that the data do not determine.
    """
    point = model.parameters

    def slope(step: Array, size: float) -> Array:
        up, down = (response(model.with_parameters(point + sign * step)) for sign in (1, -1))
        return (up - down) / (2.0 * size)

    if not model.covariance.null_space.size:
        # Along the independent directions of the errors, which are fewer than the coefficients.
        squares = np.zeros_like(response(model))
        for direction in model.covariance.factor.T:
            squares += slope(STEP * direction, STEP) ** 2
        return np.sqrt(squares)
    slopes = []
    deviations = model.covariance.standard_errors(np.eye(len(point)))
    for index, deviation in enumerate(deviations):
        step = np.zeros(len(point))
        # Of a coefficient without a finite standard error, a step of its own size.
        size = deviation if 0.0 < deviation < np.inf else max(abs(point[index]), 1.0)
        step[index] = STEP * size
        slopes.append(slope(step, step[index]))
    jacobian = np.array(slopes)
    errors = model.covariance.standard_errors(jacobian.reshape(len(point), -1).T)
    return errors.reshape(jacobian.shape[1:])
