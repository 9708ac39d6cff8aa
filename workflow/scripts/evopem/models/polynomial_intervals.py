"""Standard errors of what follows from the coefficients of a polynomial model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

# Step of a central difference, in standard errors of a coefficient: small against the curvature of
# a response, large against rounding.
STEP = 1e-3


def response_standard_errors(
    model: PolynomialModel, response: Callable[[PolynomialModel], Array]
) -> Array:
    """Standard errors of a real function of a model, to first order (Ljung 1999, section 9.4).

    Parameters
    ----------
    model : PolynomialModel
        With a covariance.
    response : callable
        For instance ``lambda model: model.step_response(100)``, or
        ``lambda model: 20 * np.log10(np.abs(model.frequency_response(frequencies)))``.

    Returns
    -------
    array
        Of the shape of the response; infinite where it depends on a direction of the coefficients
        that the data do not determine.

    Raises
    ------
    ValueError
        When the model has no covariance.
    """
    if model.covariance is None:
        raise ValueError("the model has no covariance of its coefficients")
    point = model.parameters
    slopes = []
    deviations = model.covariance.standard_errors(np.eye(len(point)))
    for index, deviation in enumerate(deviations):
        step = np.zeros(len(point))
        # Of a coefficient without a finite standard error, a step of its own size.
        size = deviation if 0.0 < deviation < np.inf else max(abs(point[index]), 1.0)
        step[index] = STEP * size
        up, down = (response(model.with_parameters(point + sign * step)) for sign in (1, -1))
        slopes.append((up - down) / (2.0 * step[index]))
    jacobian = np.array(slopes)
    errors = model.covariance.standard_errors(jacobian.reshape(len(point), -1).T)
    return errors.reshape(jacobian.shape[1:])
