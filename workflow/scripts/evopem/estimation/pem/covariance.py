"""Covariance of prediction-error estimates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Singular values of the Jacobian, its columns scaled to unit length, below this share of the
# largest one count as zero: they come from rounding, and their directions are unidentifiable.
RANK_TOLERANCE = 1e-10
# Components of a null vector below this share of its length are rounding.
COMPONENT_TOLERANCE = 1e-8
# Residuals smaller than this share of the output are rounding errors: they carry no information
# about the noise model.
RESIDUAL_ROUNDING = 1e-12


def estimate_covariance(
    triangle: Array,
    residuals: Array,
    output: Array,
    parameters: int,
    of_noise: NDArray[np.intp],
    objective: str,
) -> ParameterCovariance | None:
    """Asymptotic covariance of the n parameters, the noise state being estimated as well.

    None where the density of the residuals at zero, which that of the absolute objective needs,
    cannot be estimated.

    ``sigma^2 (J'J)^-1`` for the quadratic objective (Ljung 1999, eq. 9.17), and
    ``(J'J)^-1 / (2 f(0))^2`` for the absolute one, f the density of the residuals (Bassett &
    Koenker 1978).  The number of estimates, noise state included, is subtracted from the number
    of residuals.  Null vectors of J are unidentifiable directions.

    Parameters
    ----------
    triangle : (m, m) array
        R of the QR decomposition of the Jacobian by parameters and states.
    residuals, output : (N,) arrays
        The scored ones.
    parameters : int
        n.
    of_noise : (k,) array of int
        Places of the coefficients of C and D.  Where the residuals are rounding errors of the
        output, these are not identifiable.
    objective : {"absolute", "quadratic"}
    """
    n, estimated = parameters, triangle.shape[1]
    inverse, null_space = pseudo_inverse_factor(triangle)
    if np.linalg.norm(residuals) <= RESIDUAL_ROUNDING * np.linalg.norm(output):
        unknown = np.eye(estimated)[:, of_noise]
        null_space = np.hstack([null_space, unknown])
    null_space = null_space[:n]
    null_space = null_space[:, np.any(null_space != 0.0, axis=0)]
    if objective == "quadratic":
        deviation = np.sqrt(innovation_variance(residuals, estimated))
    else:
        density = density_at_zero(residuals, estimated)
        if not density > 0.0:
            return None
        deviation = 1.0 / (2.0 * density)
    return ParameterCovariance(deviation * inverse[:n], null_space)


def pseudo_inverse_factor(triangle: Array) -> tuple[Array, Array]:
    """A factor F of the pseudo-inverse ``F F'`` of ``R'R``, and a basis of R's null space.

    Columns of R are scaled to unit length first.

    Parameters
    ----------
    triangle : (m, n) array
        R.

    Returns
    -------
    factor : (n, r) array
        r is the rank of R.
    null_space : (n, n - r) array
    """
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0.0] = 1.0
    _, singular_values, vectors = np.linalg.svd(triangle / scale)
    rank = int(np.count_nonzero(singular_values > RANK_TOLERANCE * singular_values[0]))
    factor = vectors[:rank].T / singular_values[:rank] / scale[:, None]
    null_vectors = np.where(np.abs(vectors[rank:]) > COMPONENT_TOLERANCE, vectors[rank:], 0.0)
    return factor, null_vectors.T / scale[:, None]


def innovation_variance(residuals: Array, estimated: int) -> float:
    """Mean square of residuals, their number reduced by one for each estimated number."""
    return float(residuals @ residuals) / max(len(residuals) - estimated, 1)


def density_at_zero(residuals: Array, estimated: int) -> float:
    """Density of the innovations at zero, by a Gaussian kernel of Silverman's width.

    A least absolute fit of p numbers makes p residuals vanish (Koenker 2005, section 2.2): they
    say nothing of the density there and are left out.
    """
    vanishing = min(estimated, len(residuals) - 2)
    others = residuals[np.argsort(np.abs(residuals), kind="stable")][vanishing:]
    q25, q75 = np.quantile(others, [0.25, 0.75])
    spread = min(float(np.std(others)), float(q75 - q25) / 1.349)
    width = 0.9 * spread * len(others) ** -0.2
    if width == 0.0:
        return 0.0
    return float(np.mean(np.exp(-0.5 * (others / width) ** 2)) / (width * np.sqrt(2.0 * np.pi)))
