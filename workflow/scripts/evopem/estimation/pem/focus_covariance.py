"""Covariance of estimates under active constraints, with priors, and from coloured errors."""

from __future__ import annotations

from dataclasses import dataclass

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
    fitted = Fitted(jacobian, tangent, prior_rows)
    innovations, priors, null_space = fitted.response(noise_filter, deviation)
    responses = np.hstack([innovations, priors])
    factor = np.asarray(np.linalg.qr(responses.T, mode="r")).T
    return ParameterCovariance(deviation * factor, null_space)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Derivatives of errors (N, n), free directions (n, k) and rows of the priors (p, n) of a fit.

    The errors are those of the samples that count.
    """

    jacobian: Array
    tangent: Array
    prior_rows: Array

    def response(
        self, noise_filter: tuple[Array, Array], deviation: float
    ) -> tuple[Array, Array, Array]:
        """Errors of the estimates by unit innovations, (n, N), by unit priors, and a null space."""
        from scipy.signal import lfilter

        samples, count = len(self.jacobian), len(self.tangent)
        if self.tangent.shape[1] == 0:
            return np.zeros((count, samples)), np.zeros((count, 0)), np.zeros((count, 0))
        along = self.jacobian @ self.tangent
        priors = deviation * (self.prior_rows @ self.tangent)
        triangle = np.asarray(np.linalg.qr(np.concatenate([along, priors]), mode="r"))
        inverse, null_space = pseudo_inverse_factor(triangle)
        backwards = along
        if len(noise_filter[0]) > 1 or len(noise_filter[1]) > 1:
            backwards = lfilter(*noise_filter, along[::-1], axis=0)[::-1]
        solve = self.tangent @ inverse @ inverse.T
        return -solve @ backwards.T, -solve @ priors.T, self.tangent @ null_space


def two_stage_covariance(
    first: Fitted,
    second: Fitted,
    noise_filter: tuple[Array, Array],
    to_second: Array,
    crossed: Array,
    deviation: float,
) -> ParameterCovariance:
    """Joint covariance of a plant fitted to coloured errors, and of C and D fitted given the plant.

    To first order the estimates of the second stage are in error by their own response to the
    innovations, and by that to what the errors of the first stage add to the residuals.

    Parameters
    ----------
    first, second : Fitted
    noise_filter : (numerator, denominator)
        From the innovations to the errors of the first stage.
    to_second : (m, n) array
        Derivatives of the m parameters of the plant, as the second stage holds them, by the n of
        the first.
    crossed : (N, m) array
        Derivatives of the errors of the second stage by those m parameters.
    deviation : float
        Of the innovations.

    Returns
    -------
    ParameterCovariance
        Of the m parameters of the plant, then of those of the second stage.
    """
    plant, plant_priors, plant_null = first.response(noise_filter, deviation)
    noise, noise_priors, noise_null = second.response((np.ones(1), np.ones(1)), deviation)
    plant, plant_priors, plant_null = (
        to_second @ part for part in (plant, plant_priors, plant_null)
    )
    # noise responds to any addition to the residuals; crossed @ plant is such an addition.
    passed = noise @ crossed
    innovations = np.concatenate([plant, noise + passed @ plant])
    priors = np.zeros((len(innovations), plant_priors.shape[1] + noise_priors.shape[1]))
    priors[: len(plant), : plant_priors.shape[1]] = plant_priors
    priors[len(plant) :, : plant_priors.shape[1]] = passed @ plant_priors
    priors[len(plant) :, plant_priors.shape[1] :] = noise_priors
    null_space = np.zeros((len(innovations), plant_null.shape[1] + noise_null.shape[1]))
    null_space[: len(plant), : plant_null.shape[1]] = plant_null
    null_space[len(plant) :, plant_null.shape[1] :] = noise_null
    responses = np.hstack([innovations, priors])
    factor = np.asarray(np.linalg.qr(responses.T, mode="r")).T
    return ParameterCovariance(deviation * factor, null_space)
