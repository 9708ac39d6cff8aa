"""Polynomials in the backshift operator and their roots in z.

Monic ones are given by their coefficients after the leading 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def roots(coefficients: Array) -> NDArray[np.complex128]:
    """Roots z of ``z^m + x_1 z^(m-1) + ... + x_m``; (m,) complex."""
    if len(coefficients) == 0:
        return np.empty(0, dtype=complex)
    return np.roots(np.concatenate([[1.0], coefficients])).astype(complex)


def max_root_radius(coefficients: Array) -> float:
    """Largest root radius; 0 for an empty polynomial."""
    found = roots(coefficients)
    return float(np.max(np.abs(found))) if len(found) else 0.0


def reflect_into_disc(coefficients: Array, radius: float) -> Array:
    """Coefficients whose roots lie within ``radius``.

    Roots outside the unit circle are replaced by their reflection ``1/conj(z)``, which leaves the
    magnitude of the frequency response as it was but for a constant (Söderström & Stoica 1989);
    roots that still lie beyond ``radius`` are drawn in to it along their ray.
    """
    z = roots(coefficients)
    outside = np.abs(z) > 1.0
    z[outside] = 1.0 / np.conj(z[outside])
    modulus = np.abs(z)
    beyond = modulus > radius
    z[beyond] *= radius / modulus[beyond]
    # np.roots drops trailing zero coefficients (roots at the origin) from its result.
    monic = np.real(np.poly(z)) if len(z) else np.array([1.0])
    inside = np.zeros(len(coefficients))
    inside[: len(monic) - 1] = monic[1:]
    return inside


def root_gradient(coefficients: Array, root: complex) -> NDArray[np.complex128]:
    """Derivative of a root with respect to every coefficient of its polynomial in z.

    For p(z) = Σ c_i z^(n−i) and p(r) = 0: dr/dc_i = −r^(n−i) / p'(r). Not finite at a repeated
    root, which has no derivative.
    """
    degree = coefficients.size - 1
    powers = root ** np.arange(degree, -1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return -powers / np.polyval(np.polyder(coefficients), root)
