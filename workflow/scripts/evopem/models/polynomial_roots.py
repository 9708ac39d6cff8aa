"""Polynomials in the backshift operator and their roots in z.

Monic ones are given by their coefficients after the leading 1.
"""

import warnings

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array, Complex
from evopem.models.parameter_covariance import ParameterCovariance

HALF = 0.5 + 1e-9  # of the sampling rate, with what rounding adds
# 95 % points of chi-square with one and two degrees of freedom.
CHI_SQUARE_95 = {1: 3.841458820694124, 2: 5.991464547107979}


def on_circle(frequencies: ArrayLike, sampling_rate: float) -> Complex:
    """Points of the unit circle of the z plane at frequencies in Hz, of their shape.

    Warns of frequencies above half the sampling rate, where a response repeats that below.
    """
    angles = np.asarray(frequencies, dtype=float) / sampling_rate
    if (highest := float(np.max(np.abs(angles), initial=0.0))) > HALF:
        problem = f"{highest * sampling_rate:g} Hz is above half the sampling rate of the model"
        warnings.warn(f"{problem}, {sampling_rate / 2:g} Hz: its response repeats", stacklevel=3)
    return np.asarray(np.exp(2j * np.pi * angles), dtype=complex)


def roots(coefficients: Array) -> Complex:
    """Roots z of ``z^m + x_1 z^(m-1) + ... + x_m``; (m,) complex."""
    z = np.zeros(len(coefficients), dtype=complex)
    if len(known := np.flatnonzero(coefficients)):
        z[: known[-1] + 1] = roots_of_each(coefficients[None, : known[-1] + 1])[0]
    return z


def roots_of_each(coefficients: Array) -> Complex:
    """Roots of many polynomials alike, (M, m) of (M, m), at once."""
    count, m = coefficients.shape
    companions = np.zeros((count, m, m))
    companions[:, :1] = -coefficients[:, None]
    companions[:, np.arange(1, m), np.arange(m - 1)] = 1.0
    return np.linalg.eigvals(companions).astype(complex)


def max_root_radius(coefficients: Array) -> float:
    """Largest root radius; 0 for an empty polynomial."""
    all_roots = roots(coefficients)
    return float(np.max(np.abs(all_roots))) if len(all_roots) else 0.0


def powers_of_z(numerator: Array, denominator: Array) -> tuple[Array, Array]:
    """Write a ratio of polynomials in q^-1, lag 0 first, in descending powers of z.

    Without leading zeros: the delay is then the difference of the degrees.
    """
    length = max(len(numerator), len(denominator))
    above, below = (np.pad(part, (0, length - len(part))) for part in (numerator, denominator))
    nonzero = np.flatnonzero(above)
    return above[nonzero[0] if len(nonzero) else length - 1 :], below


def reflect_into_disc(coefficients: Array, radius: float) -> Array:
    """Coefficients whose roots lie within ``radius``, of many polynomials, (M, m), at once.

    Roots outside the unit circle are replaced by ``1/conj(z)``, which leaves the shape of the
    frequency response (Söderström & Stoica 1989); those still beyond ``radius`` are drawn in.
    """
    count, m = coefficients.shape
    z = roots_of_each(coefficients)
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


def root_gradient(coefficients: Array, root: complex) -> Complex:
    """Derivative of a root with respect to every coefficient of its polynomial in z.

    dr/dc_i = −r^(n−i) / p'(r); not finite at a repeated root.
    """
    powers = root ** np.arange(coefficients.size - 1, -1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return -powers / np.polyval(np.polyder(coefficients), root)


def uncertain_roots(
    coefficients: Array, covariance: ParameterCovariance | None
) -> list[tuple[complex, Array]]:
    """Roots of a polynomial, highest power first, with the covariance of real and imaginary part.

    As of :func:`root_covariance`, (2, 2); NaN where it is not known or not finite.
    """
    uncertain, unknown = [], np.full((2, 2), np.nan)
    for root in map(complex, np.roots(coefficients)):
        spread = unknown if covariance is None else root_covariance(coefficients, root, covariance)
        uncertain.append((root, spread if np.isfinite(spread).all() else unknown))
    return uncertain


def root_covariance(coefficients: Array, root: complex, covariance: ParameterCovariance) -> Array:
    """Covariance of a root's real and imaginary part, to first order, (2, 2).

    ``covariance`` of all ``coefficients``, highest power first, or of all but a leading 1.
    Infinite where the data do not determine the root, NaN for a repeated root.
    """
    gradient = root_gradient(coefficients, root)[-len(covariance) :]
    return covariance.of(np.vstack([gradient.real, gradient.imag]))


def ellipse_outline(root: complex, covariance: Array, points: int = 73) -> Array:
    """Points on the 95 % confidence ellipse of a root, real and imaginary parts, (2, points).

    A real root varies on the real axis alone and has one degree of freedom.
    """
    variances, directions = np.linalg.eigh(covariance)
    radii = np.sqrt(np.clip(variances, 0, None) * CHI_SQUARE_95[1 if root.imag == 0 else 2])
    angle = np.linspace(0, 2 * np.pi, points)
    outline: Array = directions @ (radii[:, None] * np.vstack([np.cos(angle), np.sin(angle)]))
    return outline + np.array([[root.real], [root.imag]])
