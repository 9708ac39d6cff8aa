"""Covariance of prediction-error estimates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.filtering import filter_rows
from evopem.estimation.pem.least_squares import chunks, triangle_of
from evopem.models.armax import ArmaxModel

Array = NDArray[np.float64]


def jacobian_triangle(
    model: ArmaxModel,
    input: Array,  # noqa: A002
    output: Array,
    residuals: Array,
    recursion_start: int,
    scoring_start: int,
) -> Array:
    """R of the QR decomposition of the scored residuals' Jacobian, (n + nc, n + nc) or fewer rows.

    With respect to ``[a, b, c]`` and the noise state: ``d e/d a_i = y_F(t-i)``,
    ``d e/d b_j = -u_F(t-nk-j)``, ``d e/d c_k = -e_F(t-k)`` with signals filtered through 1/C from
    rest at ``recursion_start`` (Ljung 1999, section 10.3), and impulses
    there for the noise state.
    """
    blocks = _jacobian_blocks(model, input, output, residuals, recursion_start)
    return triangle_of(
        block[max(scoring_start - first, 0) :]
        for first, block in blocks
        if first + len(block) > scoring_start
    )


def _jacobian_blocks(
    model: ArmaxModel,
    input: Array,  # noqa: A002
    output: Array,
    residuals: Array,
    recursion_start: int,
) -> Iterator[tuple[int, Array]]:
    """First sample and rows of the Jacobian, chunk by chunk."""
    o = model.orders
    samples = len(output)
    impulse = np.zeros(samples)
    impulse[recursion_start] = 1.0
    columns = (
        [(output, i, 1.0) for i in range(1, o.na + 1)]
        + [(input, o.nk + j, -1.0) for j in range(o.nb)]
        + [(residuals, k, -1.0) for k in range(1, o.nc + 1)]
        + [(impulse, k, 1.0) for k in range(o.nc)]
    )
    states = np.zeros((len(columns), o.nc))
    for first, stop in chunks(recursion_start, samples):
        filtered = np.empty((len(columns), stop - first))
        for row, (signal, lag, sign) in enumerate(columns):
            filtered[row] = sign * signal[first - lag : stop - lag]
        filter_rows(filtered, model.c, states)
        yield first, filtered.T


def parameter_covariance(
    triangle: Array, residuals: Array, parameters: int, objective: str
) -> Array | None:
    """Asymptotic covariance of the parameters, (n, n), the noise state being estimated as well.

    None where the density of the residuals at zero, which that of the absolute objective needs,
    cannot be estimated.

    ``sigma^2 (J'J)^-1`` for the quadratic objective (Ljung 1999, eq. 9.17), and
    ``(J'J)^-1 / (2 f(0))^2`` for the absolute one, f the density of the residuals (Bassett &
    Koenker 1978).  What is estimated, noise state included, is taken from the number of residuals.

    Parameters
    ----------
    triangle : (n + nc, n + nc) array
        Of :func:`jacobian_triangle`.
    residuals : (N,) array
        The scored ones.
    parameters : int
        n.
    objective : {"absolute", "quadratic"}
    """
    n, estimated = parameters, triangle.shape[1]
    scale = np.linalg.norm(triangle, axis=0)
    scale[scale == 0.0] = 1.0
    # A noise state that has died out before the first scored sample leaves no trace there.
    inverse = np.linalg.pinv(triangle / scale, rcond=1e-10)
    information_inverse = ((inverse @ inverse.T) / np.outer(scale, scale))[:n, :n]
    if objective == "quadratic":
        spread = innovation_variance(residuals, estimated)
    else:
        squared = (2.0 * _density_at_zero(residuals, estimated)) ** 2
        if squared == 0.0:
            return None
        spread = 1.0 / squared
    covariance: Array = spread * information_inverse
    return covariance


def innovation_variance(residuals: Array, estimated: int) -> float:
    """Mean square of residuals, less one of them for each number that was estimated."""
    return float(residuals @ residuals) / max(len(residuals) - estimated, 1)


def _density_at_zero(residuals: Array, estimated: int) -> float:
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
