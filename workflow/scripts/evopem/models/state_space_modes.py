"""Modes of a state-space model: frequencies, damping, complex shapes, and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Product of the left and right eigenvectors of unit length below which an eigenvalue is defective.
DEFECTIVE = 1e-13


@dataclass(frozen=True, eq=False)
class ShapedMode:
    """One oscillating mode of a model with one or more outputs.

    Attributes
    ----------
    frequency_hz : float
        Undamped natural frequency ``|s| / 2 pi``, ``s = ln(z) fs``.
    damping_ratio : float
        ``-Re(s) / |s|``.
    pole : complex
        Pole in the z plane, upper half.
    shape : (ny,) complex array
        ``C v``, v the eigenvector of A, scaled so that its largest entry is 1.
    input_participation : (nu,) complex array
        How each input drives the mode whose shape is scaled like this: ``w' B``, w the left
        eigenvector with ``w' v = 1``.
    noise_participation : (ny,) complex array
        The same of the innovations, ``w' K``.
    output_shares : (ny,) array
        Share of the mode in the sum, over all modes and real poles, of the energies of their own
        impulse responses: from the inputs, or from the innovations for a model without input.
    phase_collinearity : float
        1 for a shape whose entries move in phase or in opposite phase, 0 for a circling one
        (modal phase collinearity, Pappa, Elliott & Schenk 1993; no mean is removed).
    mean_phase_deg : float
        Angle of the straight line through the origin that fits the entries best, -90 to 90.
    phase_deviation_deg : float
        Mean angle between the entries and that line, weighed by their magnitudes.
    frequency_se_hz, damping_se : float
        Standard errors; NaN when the covariance is not known.
    shape_se_real, shape_se_imag : (ny,) arrays
        Standard errors of the shape; 0 for the entry that is 1 by definition.
    """

    frequency_hz: float
    damping_ratio: float
    pole: complex
    shape: Complex
    input_participation: Complex
    noise_participation: Complex
    output_shares: Array
    phase_collinearity: float
    mean_phase_deg: float
    phase_deviation_deg: float
    frequency_se_hz: float
    damping_se: float
    shape_se_real: Array
    shape_se_imag: Array


def shaped_modes(
    A: Array,
    B: Array,
    C: Array,
    K: Array,
    levels: int,
    sampling_rate: float,
    covariance: ParameterCovariance | None = None,
) -> list[ShapedMode]:
    """Modes of ``x+ = A x + B u + K e, y = C x + ...``, by frequency.

    Parameters
    ----------
    A : (n, n) array
    B : (n, nu) array
    C : (ny, n) array
    K : (n, ny) array
    levels : int
        Entries that follow ``[A, B, C, D, K]`` in the covariance.
    sampling_rate : float
        Hz.
    covariance : ParameterCovariance, optional
        Of ``[A, B, C, D, K, level]``, row by row; propagated to first order.
    """
    poles, right, left = _eigenvectors(A)
    adjoint: Complex = left.conj().T.astype(complex)
    shapes: Complex = (C @ right).astype(complex)
    energies = _energies(poles, shapes, (adjoint @ (B if B.shape[1] else K)).astype(complex))
    total = energies.sum(axis=1)
    modes = []
    for k in map(int, np.flatnonzero(poles.imag > 0.0)):
        shape = shapes[:, k]
        largest = int(np.argmax(np.abs(shape)))
        scale = shape[largest] if shape[largest] != 0.0 else 1.0
        frequency_se, damping_se, real_se, imag_se = _standard_errors(
            poles, right, left, k, C, scale, largest, covariance, levels, sampling_rate
        )
        shape = shape / scale
        phase, deviation = mean_phase(shape)
        s = np.log(poles[k]) * sampling_rate
        # Both of a conjugate pair belong to the mode.
        share = np.divide(2.0 * energies[:, k], total, out=np.zeros(len(C)), where=total > 0.0)
        modes.append(
            ShapedMode(
                frequency_hz=float(abs(s) / (2.0 * np.pi)),
                damping_ratio=float(-s.real / abs(s)),
                pole=complex(poles[k]),
                shape=shape,
                input_participation=scale * (adjoint[k] @ B),
                noise_participation=scale * (adjoint[k] @ K),
                output_shares=share,
                phase_collinearity=phase_collinearity(shape),
                mean_phase_deg=phase,
                phase_deviation_deg=deviation,
                frequency_se_hz=frequency_se,
                damping_se=damping_se,
                shape_se_real=real_se,
                shape_se_imag=imag_se,
            )
        )
    return sorted(modes, key=lambda mode: mode.frequency_hz)


def _eigenvectors(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, right and left eigenvectors with ``left[:, k]^H right[:, k] = 1``.

    Left vectors of defective eigenvalues, such as repeated ones at zero, are zero: these have no
    part of their own.
    """
    from scipy.linalg import eig

    poles, left, right = eig(A, left=True, right=True)
    products = np.sum(left.conj() * right, axis=0)
    defective = np.abs(products) < DEFECTIVE
    scales = np.where(defective, np.inf, products.conj())
    return poles, right.astype(complex), left / scales


def phase_collinearity(shape: Complex) -> float:
    """Modal phase collinearity of a shape, 0 to 1.

    ``((l1 - l2) / (l1 + l2))^2`` of the eigenvalues of the second moments of real and imaginary
    parts (Pappa, Elliott & Schenk 1993).

    Examples
    --------
    >>> phase_collinearity(np.array([1.0, -0.5]) * np.exp(0.3j))
    1.0
    """
    xx, yy = float(shape.real @ shape.real), float(shape.imag @ shape.imag)
    xy = float(shape.real @ shape.imag)
    if xx + yy == 0.0:
        return float("nan")
    return round(((xx - yy) ** 2 + 4.0 * xy**2) / (xx + yy) ** 2, 15)


def mean_phase(shape: Complex) -> tuple[float, float]:
    """Angle of the best straight line through a shape, and the mean deviation, in degrees.

    Examples
    --------
    >>> mean_phase(np.array([1.0, -0.5]) * np.exp(1j * np.pi / 6))
    (30.0, 0.0)
    """
    magnitudes = np.abs(shape)
    if not magnitudes.any():
        return float("nan"), float("nan")
    angle = 0.5 * np.angle(np.sum(shape**2))
    along = np.abs((shape * np.exp(-1j * angle)).real)
    away = np.arccos(np.clip(along / np.where(magnitudes > 0.0, magnitudes, 1.0), 0.0, 1.0))
    deviation = float(np.sum(magnitudes * away) / np.sum(magnitudes))
    return round(float(np.degrees(angle)), 10), round(float(np.degrees(deviation)), 5)


def assurance(first: Complex, second: Complex) -> float:
    """Modal assurance criterion of two shapes, ``|a' b|^2 / (a'a b'b)`` (Allemang 1982)."""
    size = float(np.vdot(first, first).real * np.vdot(second, second).real)
    return float(abs(np.vdot(first, second)) ** 2 / size) if size > 0.0 else float("nan")


def _energies(poles: Complex, shapes: Complex, drives: Complex) -> Array:
    """Energy of each pole's own impulse response at each output, (ny, n); 0 where unbounded."""
    decay = 1.0 - np.abs(poles) ** 2
    finite = decay > 0.0
    driven = np.sum(np.abs(drives) ** 2, axis=1)
    per_pole = np.where(finite, driven / np.where(finite, decay, 1.0), 0.0)
    energies: Array = np.abs(shapes) ** 2 * per_pole
    return energies


def _standard_errors(
    poles: Complex,
    right: Complex,
    left: Complex,
    k: int,
    C: Array,
    scale: complex,
    largest: int,
    covariance: ParameterCovariance | None,
    levels: int,
    sampling_rate: float,
) -> tuple[float, float, Array, Array]:
    """Standard errors of frequency, damping, and the real and imaginary parts of the shape."""
    n, ny = len(poles), len(C)
    if covariance is None:
        return float("nan"), float("nan"), np.full(ny, np.nan), np.full(ny, np.nan)
    entries = len(covariance)
    nu = (entries - levels - n * n - 2 * n * ny) // (n + ny)
    # d pole = w' dA v; d v = sum over the other poles of v_j (w_j' dA v) / (pole - pole_j).
    d_pole = np.zeros(entries, dtype=complex)
    d_pole[: n * n] = np.outer(left[:, k].conj(), right[:, k]).ravel()
    others = np.arange(n) != k
    gaps = poles[k] - poles[others]
    spread = (C @ right[:, others] / gaps) @ left[:, others].conj().T
    d_shape = np.zeros((ny, entries), dtype=complex)
    d_shape[:, : n * n] = np.einsum("ij,k->ijk", spread, right[:, k]).reshape(ny, n * n)
    first = n * n + n * nu
    for row in range(ny):
        d_shape[row, first + row * n : first + (row + 1) * n] += right[:, k]
    shape = C @ right[:, k] / scale
    d_shape = (d_shape - np.outer(shape, d_shape[largest])) / scale
    s = np.log(poles[k]) * sampling_rate
    ds = sampling_rate * d_pole / poles[k]
    d_modulus = (np.conj(s) * ds).real / abs(s)
    d_damping = -ds.real / abs(s) + s.real * d_modulus / abs(s) ** 2
    # The largest entry is 1 by definition, whatever the data determine.
    d_shape[largest] = 0.0
    gradients = np.vstack([d_modulus / (2.0 * np.pi), d_damping, d_shape.real, d_shape.imag])
    found = covariance.standard_errors(gradients)
    return float(found[0]), float(found[1]), found[2 : 2 + ny], found[2 + ny :]
