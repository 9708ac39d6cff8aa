"""Covariance of prediction-error estimates: ``(J'J)^-1 sum psi s`` is their error, psi the rows of
the Jacobian J and s the *scores*: residuals, or of the absolute objective their signs over twice
their density at zero (Bassett & Koenker 1978)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, Indices
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.signals.least_squares import autoregression

# Singular values of the Jacobian, its columns scaled to unit length, below this share of the
# largest one count as zero: they come from rounding, and their directions are unidentifiable.
RANK_TOLERANCE = 1e-10
# Components of a null vector below this share of its length are rounding.
COMPONENT_TOLERANCE = 1e-8
# Residuals smaller than this share of the output are rounding errors, without a noise model.
RESIDUAL_ROUNDING = 1e-12
MOST_COLOURING = 50  # largest order of the autoregression that describes coloured residuals


def estimate_covariance(
    triangle: Array,
    residuals: Array,
    output: Array,
    parameters: int,
    of_noise: Indices,
    objective: str,
) -> ParameterCovariance | None:
    """Covariance of the first ``parameters`` estimates for white residuals, ``s^2 (J'J)^-1`` with s
    as of :func:`loss_deviation` (Ljung 1999, eq. 9.17) or None, from R of the QR decomposition of
    J. Where residuals are rounding errors of the output, coefficients ``of_noise`` are not
    identifiable."""
    estimated = triangle.shape[1]
    inverse, null_space = pseudo_inverse_factor(triangle)
    if np.linalg.norm(residuals) <= RESIDUAL_ROUNDING * np.linalg.norm(output):
        null_space = np.hstack([null_space, np.eye(estimated)[:, of_noise]])
    deviation = loss_deviation(residuals, estimated, objective)
    if not np.isfinite(deviation):
        return None
    return of_coefficients(ParameterCovariance(deviation * inverse, null_space), parameters)


def coloured_covariance(
    jacobian: Array,
    residuals: Array,
    parameters: int,
    objective: str,
    input_alone: bool,
    counts: Sequence[int] = (),
) -> ParameterCovariance | None:
    """Covariance of the first ``parameters`` estimates for residuals of any colour (Ljung 1999, eq.
    9.9-9.11).  Where psi depends on the inputs alone, ``sum psi s`` has the covariance ``v sum psi~
    psi~'``, psi filtered backwards by an autoregression of s, v the variance of its innovations
    (eq. 9.41-42); else it is summed from sample autocovariances of each stretch (Newey & West
    1987)."""
    samples, estimated = jacobian.shape
    score = scores_of(residuals, estimated, objective)
    if not np.isfinite(score).all():
        return None
    if input_alone:
        fitted = Fitted(jacobian, np.eye(estimated), np.zeros((0, estimated)), counts)
        covariance = whitened_covariance(fitted, residuals, objective)
        return covariance and of_coefficients(covariance, parameters)
    inverse, null_space = pseudo_inverse_factor(np.asarray(np.linalg.qr(jacobian, mode="r")))
    scores = np.split(jacobian * score[:, None], np.cumsum(np.asarray(counts, dtype=int))[:-1])
    meat = sum(map(_newey_west, scores)) * samples / max(samples - estimated, 1)
    bread = inverse @ inverse.T
    eigenvalues, vectors = np.linalg.eigh(bread @ meat @ bread.T)
    factor = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    return of_coefficients(ParameterCovariance(factor, null_space), parameters)


def scores_of(residuals: Array, estimated: int, objective: str) -> Array:
    """The scores of residuals; NaN where their density at zero is not known."""
    if objective == "quadratic":
        return residuals
    return np.asarray(np.sign(residuals) * loss_deviation(residuals, estimated, objective))


def whitened_covariance(
    fitted: Fitted, residuals: Array, objective: str
) -> ParameterCovariance | None:
    """Covariance of a fit whose derivatives depend on inputs alone; residuals may be coloured."""
    estimated = fitted.tangent.shape[1]
    deviation = loss_deviation(residuals, estimated, objective)
    if not np.isfinite(deviation):
        return None
    scores = scores_of(residuals, estimated, objective)
    return tangent_covariance(fitted, *innovations_of(scores, estimated, deviation))


def innovations_of(
    scores: Array, estimated: int, deviation: float
) -> tuple[tuple[Array, Array], float]:
    """The noise filter of coloured scores, and the deviation of its innovations; of white ones 1
    and their own ``deviation``."""
    centred = scores - scores.mean()
    whitening = autoregression(centred, MOST_COLOURING)
    if len(whitening) > 1:
        innovations = np.convolve(centred, whitening, mode="valid")
        # The innovations of signs are as large as those of residuals: their mean square.
        deviation = float(np.sqrt(innovation_variance(innovations, estimated)))
    return (np.ones(1), whitening), deviation


def is_coloured(residuals: Array) -> bool:
    """Whether BIC prefers an autoregression of the residuals to white noise."""
    return len(autoregression(residuals - residuals.mean(), MOST_COLOURING)) > 1


def _newey_west(scores: Array) -> Array:
    """Covariance of the sum of a series of vectors, (N, n), with Bartlett weights.  The number of
    lags grows with the third root of the length."""
    samples = len(scores)
    lags = min(int(4.0 * samples ** (1.0 / 3.0)), samples - 1)
    total: Array = scores.T @ scores
    for lag in range(1, lags + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (shifted + shifted.T)
    return total


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit: its errors' derivatives, the directions it was free in, and its priors."""

    jacobian: Array  # (N, n), of the samples that count
    tangent: Array  # (n, k), directions that active constraints leave free
    prior_rows: Array  # (p, n), derivatives of the deviations from priors
    counts: Sequence[int] = ()  # residuals of each of several stretches

    def response(
        self, noise_filter: tuple[Array, Array], deviation: float
    ) -> tuple[Array, Array, Array]:
        """Errors of the estimates by unit innovations, (n, N), by unit priors, and a null space."""
        samples, count = len(self.jacobian), len(self.tangent)
        if self.tangent.shape[1] == 0:
            return np.zeros((count, samples)), np.zeros((count, 0)), np.zeros((count, 0))
        along = self.jacobian @ self.tangent
        priors = deviation * (self.prior_rows @ self.tangent)
        triangle = np.asarray(np.linalg.qr(np.concatenate([along, priors]), mode="r"))
        inverse, null_space = pseudo_inverse_factor(triangle)
        solve = self.tangent @ inverse @ inverse.T
        backwards = filtered_backwards(along, noise_filter, self.counts)
        return -solve @ backwards.T, -solve @ priors.T, self.tangent @ null_space


def filtered_backwards(
    columns: Array, noise_filter: tuple[Array, Array], counts: Sequence[int] = ()
) -> Array:
    """Columns filtered backwards in time, each of the stretches of so many rows alone."""
    if len(noise_filter[0]) == 1 and len(noise_filter[1]) == 1:
        return columns
    parts = np.split(columns, np.cumsum(np.asarray(counts, dtype=int))[:-1])
    return np.concatenate(
        [scipy.signal.lfilter(*noise_filter, part[::-1], axis=0)[::-1] for part in parts]
    )


def tangent_covariance(
    fitted: Fitted, noise_filter: tuple[Array, Array], deviation: float
) -> ParameterCovariance:
    """Covariance of a point, zero across active constraints: along the free directions T it is
    ``s^2 M^-1 (V'V + s^2 (LT)'(LT)) M^-1``, ``M = (JT)'JT + s^2 (LT)'(LT)``, L the derivatives of
    the priors' deviations and V JT filtered backwards through the noise filter (numerator,
    denominator) that makes the errors from innovations of deviation s (Ljung 1999, section 9.4)."""
    innovations, priors, null_space = fitted.response(noise_filter, deviation)
    return _of_responses(np.hstack([innovations, priors]), null_space, deviation)


def two_stage_covariance(
    first: Fitted,
    second: Fitted,
    noise_filter: tuple[Array, Array],
    to_second: Array,
    crossed: Array,
    deviation: float,
) -> ParameterCovariance:
    """Joint covariance of a plant fitted to coloured errors, and of C and D fitted given the plant,
    whose residuals the errors of the first stage add to.  ``to_second`` (m, n): derivatives of the
    plant's m parameters, as the second stage holds them, by the n of the first.  ``crossed`` (N,
    m): derivatives of the errors of the second stage by those."""
    plant, plant_priors, plant_null = (
        to_second @ part for part in first.response(noise_filter, deviation)
    )
    noise, noise_priors, noise_null = second.response((np.ones(1), np.ones(1)), deviation)
    # noise responds to any addition to the residuals; crossed @ plant is such an addition.
    passed = noise @ crossed
    innovations = np.concatenate([plant, noise + passed @ plant])
    priors = scipy.linalg.block_diag(plant_priors, noise_priors)
    null_space = scipy.linalg.block_diag(plant_null, noise_null)
    priors[len(plant) :, : plant_priors.shape[1]] = passed @ plant_priors
    return _of_responses(np.hstack([innovations, priors]), null_space, deviation)


def _of_responses(responses: Array, null_space: Array, deviation: float) -> ParameterCovariance:
    """Covariance of estimates that respond so to innovations and priors of unit deviation."""
    factor = np.asarray(np.linalg.qr(responses.T, mode="r")).T
    return ParameterCovariance(deviation * factor, null_space)


def of_coefficients(
    covariance: ParameterCovariance, count: int, units: Array | None = None
) -> ParameterCovariance:
    """The covariance of the first entries alone, times their units, (n,)."""
    scale = np.ones((count, 1)) if units is None else units[:count, None]
    null_space = covariance.null_space[:count] * scale
    null_space = null_space[:, np.any(null_space != 0.0, axis=0)]
    return ParameterCovariance(covariance.factor[:count] * scale, null_space)


def pseudo_inverse_factor(triangle: Array) -> tuple[Array, Array]:
    """A factor F (n, r) of the pseudo-inverse ``F F'`` of ``R'R``, and a basis of R's null space.
    R (m, n) of rank r, its columns scaled to unit length first."""
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0.0] = 1.0
    _, singular_values, vectors = np.linalg.svd(triangle / scale)
    rank = int(np.count_nonzero(singular_values > RANK_TOLERANCE * singular_values[0]))
    factor = vectors[:rank].T / singular_values[:rank] / scale[:, None]
    null_vectors = np.where(np.abs(vectors[rank:]) > COMPONENT_TOLERANCE, vectors[rank:], 0.0)
    return factor, null_vectors.T / scale[:, None]


def loss_deviation(residuals: Array, estimated: int, objective: str) -> float:
    """Deviation s with which the covariance of a fit to white residuals is ``s^2 (J'J)^-1``.  The
    standard deviation for the quadratic objective, ``1 / (2 f(0))`` for the absolute one, f the
    density of the residuals; NaN where that is not known."""
    if objective == "quadratic":
        return float(np.sqrt(innovation_variance(residuals, estimated)))
    density = density_at_zero(residuals, estimated)
    return 1.0 / (2.0 * density) if density > 0.0 else float("nan")


def innovation_variance(residuals: Array, estimated: int) -> float:
    """Mean square of residuals, their number reduced by one for each estimated number."""
    return float(residuals @ residuals) / max(len(residuals) - estimated, 1)


def density_at_zero(residuals: Array, estimated: int) -> float:
    """Density of the innovations at zero, by a Gaussian kernel of Silverman's width.  A least
    absolute fit of p numbers makes p residuals vanish (Koenker 2005, section 2.2): they say nothing
    of the density there and are left out."""
    vanishing = min(estimated, len(residuals) - 2)
    others = residuals[np.argsort(np.abs(residuals), kind="stable")][vanishing:]
    q25, q75 = np.quantile(others, [0.25, 0.75])
    spread = min(float(np.std(others)), float(q75 - q25) / 1.349)
    width = 0.9 * spread * len(others) ** -0.2
    if width == 0.0:
        return 0.0
    return float(np.mean(np.exp(-0.5 * (others / width) ** 2)) / (width * np.sqrt(2.0 * np.pi)))
