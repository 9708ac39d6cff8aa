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


def powers_of_z(numerator: Array, denominator: Array) -> tuple[Array, Array]:
    """Write a ratio of polynomials in q^-1 in descending powers of z, without leading zeros.

    The delay is then the difference of the degrees.

    ``numerator`` (m,), ``denominator`` (n,): coefficients from lag 0 on; the latter begins with 1.
    """
    length = max(len(numerator), len(denominator))
    above = np.pad(numerator, (0, length - len(numerator)))
    below = np.pad(denominator, (0, length - len(denominator)))
    nonzero = np.flatnonzero(above)
    return above[nonzero[0] if len(nonzero) else length - 1 :], below


def reflect_into_disc(coefficients: Array, radius: float) -> Array:
    """Coefficients whose roots lie within ``radius``, of many polynomials at once.

    Roots outside the unit circle are replaced by their reflection ``1/conj(z)``, which leaves the
    magnitude of the frequency response as it was but for a constant (Söderström & Stoica 1989);
    roots that still lie beyond ``radius`` are drawn in to it along their ray.

    ``coefficients`` (M, m).  Returns (M, m).
    """
    count, m = coefficients.shape
    companions = np.zeros((count, m, m))
    companions[:, :1, :] = -coefficients[:, None, :]
    companions[:, np.arange(1, m), np.arange(m - 1)] = 1.0
    z = np.linalg.eigvals(companions).astype(complex)
    outside = np.abs(z) > 1.0
    z[outside] = 1.0 / np.conj(z[outside])
    modulus = np.abs(z)
    beyond = modulus > radius
    z[beyond] *= radius / modulus[beyond]
    monic = np.zeros((count, m + 1), dtype=complex)
    monic[:, 0] = 1.0
    for k in range(m):
        monic[:, 1 : k + 2] -= z[:, k : k + 1] * monic[:, : k + 1]
    return monic[:, 1:].real


def root_gradient(coefficients: Array, root: complex) -> NDArray[np.complex128]:
    """Derivative of a root with respect to every coefficient of its polynomial in z.

    For p(z) = Σ c_i z^(n−i) and p(r) = 0: dr/dc_i = −r^(n−i) / p'(r). Not finite at a repeated
    root, which has no derivative.
    """
    degree = coefficients.size - 1
    powers = root ** np.arange(degree, -1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return -powers / np.polyval(np.polyder(coefficients), root)


def residue(above: Array, below: Array, pole: complex) -> complex:
    """``r`` in the term ``r / (1 - pole w)`` of the partial fractions of above/below, w = q^-1."""
    polyval, w = np.polynomial.polynomial.polyval, 1.0 / pole
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = polyval(w, np.polynomial.polynomial.polyder(below))
        return complex(-polyval(w, above) / (w * slope))
