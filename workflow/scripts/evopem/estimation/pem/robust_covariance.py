"""Covariance of estimates whose residuals are coloured, because the model has no noise model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.autoregression import autoregression
from evopem.estimation.pem.covariance import density_at_zero, pseudo_inverse_factor
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Largest order of the autoregression that describes the residuals.
MOST_COLOURING = 50


def coloured_covariance(
    jacobian: Array,
    residuals: Array,
    parameters: int,
    objective: str,
    input_alone: bool,
    counts: Sequence[int] = (),
) -> ParameterCovariance | None:
    """Asymptotic covariance of estimates for residuals of any colour, (n, n).

    ``J^-1 Q J^-1`` with ``J = sum psi psi'`` and Q the covariance of the score ``sum psi s``, where
    s are the residuals, or their signs over twice their density at zero for the absolute objective
    (Ljung 1999, eq. 9.9 to 9.11).

    Where the gradient psi depends on the input alone, as that of an output-error model, s is
    independent of it and ``Q = v sum psi~ psi~'`` with ``psi~_t = sum_i h_i psi_(t+i)``, where h is
    the impulse response of a noise filter of s and v the variance of its innovations (Ljung 1999,
    eq. 9.41 and 9.42).  The filter is an autoregression; its order, chosen by BIC, is 0 for white
    residuals, and the covariance then is the classical one.

    Where psi depends on past outputs as well, ``sum psi s`` has no such form.  Q is then the sum of
    its sample autocovariances with the weights of Newey and West (1987).

    Parameters
    ----------
    jacobian : (N, n) array
        Of the residuals that count, by everything estimated.
    residuals : (N,) array
    parameters : int
        Coefficients whose covariance is wanted, the first of the estimates.
    objective : {"absolute", "quadratic"}
    input_alone : bool
        Whether the gradient depends on the input alone.
    counts : sequence of int
        Residuals of each of several stretches, between which there is no correlation.

    Returns
    -------
    ParameterCovariance or None
        None where the density at zero cannot be estimated.
    """
    from scipy.signal import lfilter

    samples, estimated = jacobian.shape
    joints = np.cumsum(np.asarray(counts, dtype=int))[:-1]
    score = residuals
    if objective == "absolute":
        density = density_at_zero(residuals, estimated)
        if not density > 0.0:
            return None
        score = np.sign(residuals) / (2.0 * density)
    triangle = np.asarray(np.linalg.qr(jacobian, mode="r"))
    inverse, null_space = pseudo_inverse_factor(triangle)
    if input_alone:
        whitening = autoregression(score - score.mean(), MOST_COLOURING)
        innovations = np.convolve(score - score.mean(), whitening, mode="valid")
        # The innovations of signs are as large as those of residuals: their mean square.
        variance = float(innovations @ innovations) / max(len(innovations) - estimated, 1)
        parts = np.split(jacobian, joints)
        filtered = np.concatenate([lfilter([1.0], whitening, p[::-1], axis=0) for p in parts])
        half = np.sqrt(variance) * np.asarray(np.linalg.qr(filtered, mode="r")).T
        meat = half @ half.T
    else:
        scores = np.split(jacobian * score[:, None], joints)
        meat = sum(map(_newey_west, scores)) * samples / max(samples - estimated, 1)
    bread = inverse @ inverse.T
    eigenvalues, vectors = np.linalg.eigh(bread @ meat @ bread.T)
    factor = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    null_space = null_space[:parameters]
    null_space = null_space[:, np.any(null_space != 0.0, axis=0)]
    return ParameterCovariance(factor[:parameters], null_space)


def _newey_west(scores: Array) -> Array:
    """Covariance of the sum of a series of vectors, (N, n), with Bartlett weights.

    The number of lags grows with the third root of the length.
    """
    samples = len(scores)
    lags = min(int(4.0 * samples ** (1.0 / 3.0)), samples - 1)
    total: Array = scores.T @ scores
    for lag in range(1, lags + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (shifted + shifted.T)
    return total
