"""Polynomials in the backshift operator and their roots in z.

Monic ones are given by their coefficients after the leading 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def roots(coefficients: Array) -> NDArray[np.complex128]:
    """Roots z of ``z^m + x_1 z^(m-1) + ... + x_m``; (m,) complex.

    Examples
    --------
    >>> roots(np.array([-1.2, 0.8])).round(3)
    array([0.6+0.663j, 0.6-0.663j])
    """
    if len(coefficients) == 0:
        return np.empty(0, dtype=complex)
    return np.roots(np.concatenate([[1.0], coefficients])).astype(complex)


def max_root_radius(coefficients: Array) -> float:
    """Largest root radius; 0 for an empty polynomial.

    Examples
    --------
    >>> round(max_root_radius(np.array([-1.2, 0.8])), 3)
    0.894
    """
    found = roots(coefficients)
    return float(np.max(np.abs(found))) if len(found) else 0.0


def powers_of_z(numerator: Array, denominator: Array) -> tuple[Array, Array]:
    """Write a ratio of polynomials in q^-1 in descending powers of z, without leading zeros.

    The delay is then the difference of the degrees.

    ``numerator``, ``denominator`` (m,): coefficients from lag 0 on; the denominator begins with 1.

    Examples
    --------
    2 q^-2 / (1 - 0.5 q^-1) = 2 / (z² - 0.5 z):

    >>> powers_of_z(np.array([0.0, 0.0, 2.0]), np.array([1.0, -0.5]))
    (array([2.]), array([ 1. , -0.5,  0. ]))
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

    Examples
    --------
    The root 2 is reflected to 0.5, and the root 0.995 is moved to the bound:

    >>> reflect_into_disc(np.array([[-2.0], [-0.995]]), radius=0.99)
    array([[-0.5 ],
           [-0.99]])
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

    Examples
    --------
    The root 2 of z² - 3z + 2:

    >>> root_gradient(np.array([1.0, -3.0, 2.0]), 2.0)
    array([-4., -2., -1.])
    """
    degree = coefficients.size - 1
    powers = root ** np.arange(degree, -1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return -powers / np.polyval(np.polyder(coefficients), root)
