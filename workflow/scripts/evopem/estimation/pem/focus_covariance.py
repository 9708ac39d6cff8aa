"""Covariance of estimates under active constraints, with priors, and from coloured errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.covariance import (
    density_at_zero,
    innovation_variance,
    pseudo_inverse_factor,
)
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]


def loss_deviation(residuals: Array, estimated: int, objective: str) -> float:
    """Deviation s with which the covariance of a fit to white residuals is ``s^2 (J'J)^-1``.

    The standard deviation for the quadratic objective, ``1 / (2 f(0))`` for the absolute one, f
    the density of the residuals; NaN where that is not known.
    """
    if objective == "quadratic":
        return float(np.sqrt(innovation_variance(residuals, estimated)))
    density = density_at_zero(residuals, estimated)
    return 1.0 / (2.0 * density) if density > 0.0 else float("nan")


def tangent_covariance(
    jacobian: Array,
    tangent: Array,
    prior_rows: Array,
    noise_filter: tuple[Array, Array],
    deviation: float,
) -> ParameterCovariance:
    """Covariance of a point, zero across active constraints.

    With T a basis of the directions that the active constraints leave free (the null space of
    their gradients), J the derivatives of the errors and L those of the priors' deviations, the
    coordinates along T have ``s^2 M^-1 (V'V + s^2 (LT)'(LT)) M^-1``, ``M = (JT)'JT +
    s^2 (LT)'(LT)``; V is JT filtered backwards in time through the noise filter that makes the
    errors from white innovations of deviation s (Ljung 1999, section 9.4; Söderström & Stoica
    1989, section 7.5).  White errors give ``s^2 M^-1``.

    Parameters
    ----------
    jacobian : (N, n) array
    tangent : (n, k) array
    prior_rows : (p, n) array
    noise_filter : (numerator, denominator)
    deviation : float
    """
    from scipy.signal import lfilter

    along = jacobian @ tangent
    priors = deviation * (prior_rows @ tangent)
    triangle = np.asarray(np.linalg.qr(np.concatenate([along, priors]), mode="r"))
    inverse, null_space = pseudo_inverse_factor(triangle)
    numerator, denominator = noise_filter
    if len(numerator) == 1 and len(denominator) == 1:
        factor = deviation * inverse
    else:
        backwards = lfilter(numerator, denominator, along[::-1], axis=0)
        spread = np.linalg.qr(np.concatenate([backwards, priors]), mode="r")
        factor = deviation * inverse @ (inverse.T @ np.asarray(spread).T)
    return ParameterCovariance(tangent @ factor, tangent @ null_space)


def stacked(first: ParameterCovariance, second: ParameterCovariance) -> ParameterCovariance:
    """Covariance of two independent groups of parameters, one after the other."""

    def blocks(one: Array, other: Array) -> Array:
        together = np.zeros((len(one) + len(other), one.shape[1] + other.shape[1]))
        together[: len(one), : one.shape[1]] = one
        together[len(one) :, one.shape[1] :] = other
        return together

    return ParameterCovariance(
        blocks(first.factor, second.factor), blocks(first.null_space, second.null_space)
    )
