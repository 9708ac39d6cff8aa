"""Distribution of a weighted sum of independent chi-square variables."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# Weights below this share of the largest one do not move the distribution.
NEGLIGIBLE = 1e-12
# Absolute error of the tail probability that truncating and discretising the integral may cause.
ACCURACY = 1e-10
# Largest number of nodes of the quadrature.
MOST_NODES = 200_000


def weighted_chi_square_tail(value: float, weights: ArrayLike) -> float:
    """P(sum of weights_i x_i² > value) for independent standard normal x_i.

    The characteristic function is inverted numerically (Imhof 1961, Biometrika 48:419; Davies
    1980): the trapezoidal rule is applied with a step that keeps the aliasing error below
    :data:`ACCURACY`.  NaN when no weight is positive or the value is not finite.

    Parameters
    ----------
    value : float
    weights : array_like
        Of at least zero.
    """
    from scipy.special import chdtrc

    lam = np.asarray(weights, dtype=float)
    lam = lam[lam > NEGLIGIBLE * np.max(lam, initial=0.0)]
    if lam.size == 0 or not np.isfinite(value):
        return float("nan")
    if value <= 0.0:
        return 1.0
    if np.ptp(lam) <= 1e-9 * lam.max():
        return float(chdtrc(lam.size, value / lam.mean()))
    mean, deviation = lam.sum(), np.sqrt(2.0 * np.sum(lam**2))
    if value > mean + 60.0 * deviation + 60.0 * lam.max():
        return 0.0
    # The sum and the value lie within this range up to a probability of about ACCURACY.
    reach = max(value, mean + 60.0 * deviation + 60.0 * lam.max())
    step = np.pi / reach
    last = _truncation(lam)
    nodes = min(int(np.ceil(last / step)), MOST_NODES)
    u = (np.arange(nodes) + 0.5) * step
    scaled = u[:, None] * lam
    angle = 0.5 * (np.sum(np.arctan(scaled), axis=1) - value * u)
    log_modulus = -0.25 * np.sum(np.log1p(scaled**2), axis=1)
    tail = 0.5 + step / np.pi * np.sum(np.sin(angle) / u * np.exp(log_modulus))
    return float(np.clip(tail, 0.0, 1.0))


def _truncation(lam: np.ndarray) -> float:
    """Where the modulus of the integrand has fallen to :data:`ACCURACY`."""
    last = 1.0 / lam.max()
    while -0.25 * np.sum(np.log1p((last * lam) ** 2)) > np.log(ACCURACY):
        last *= 1.5
    return float(last)
