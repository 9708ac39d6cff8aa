"""Natural frequencies and damping ratios of a discrete-time denominator, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import root_gradient, roots

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mode:
    """One oscillating mode.

    Attributes
    ----------
    frequency_hz : float
        Undamped natural frequency ``|s| / 2 pi``.
    damping_ratio : float
        ``-Re(s) / |s|``.
    pole : complex
        Pole in the z plane, upper half.
    frequency_se_hz, damping_se : float
        Standard errors.  Infinite when the data do not determine the mode, NaN when the
        covariance is not known.
    """

    frequency_hz: float
    damping_ratio: float
    pole: complex
    frequency_se_hz: float = float("nan")
    damping_se: float = float("nan")


def modes_of(
    coefficients: Array, sampling_rate: float, covariance: ParameterCovariance | None = None
) -> list[Mode]:
    """Modes of ``A = 1 + a_1 q^-1 + ...`` from ``s = ln(z) fs`` (chapter table 2), by frequency.

    Parameters
    ----------
    coefficients : (na,) array
        ``a_1 ... a_na``.
    sampling_rate : float
        Hz.
    covariance : ParameterCovariance, optional
        Of the na coefficients; propagated to the modes to first order.

    Examples
    --------
    >>> (mode,) = modes_of(np.array([-1.2, 0.8]), 50.0)
    >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 3)
    (6.71, 0.132)
    """
    modes = []
    for z in roots(coefficients):
        if z.imag <= 0.0:
            continue
        frequency, damping = _frequency_and_damping(z, sampling_rate)
        frequency_se = damping_se = float("nan")
        if covariance is not None:
            jacobian = _mode_jacobian(coefficients, z, sampling_rate)
            frequency_se, damping_se = (float(s) for s in covariance.standard_errors(jacobian))
        modes.append(Mode(frequency, damping, complex(z), frequency_se, damping_se))
    return sorted(modes, key=lambda mode: mode.frequency_hz)


def _frequency_and_damping(z: complex, sampling_rate: float) -> tuple[float, float]:
    s = np.log(z) * sampling_rate
    return float(abs(s) / (2.0 * np.pi)), float(-s.real / abs(s))


def pole_mode(coefficients: Array, pole: complex, sampling_rate: float) -> tuple[Array, Array]:
    """Frequency in Hz and damping ratio of one pole, (2,), and their derivatives, (2, na).

    Parameters
    ----------
    coefficients : (na,) array
        ``a_1 ... a_na``.
    pole : complex
        A root; for zero, and for a repeated root, the derivatives are taken for zero.
    sampling_rate : float
        Hz.
    """
    if pole == 0.0:
        return np.array([sampling_rate, 1.0]), np.zeros((2, len(coefficients)))
    values = np.array(_frequency_and_damping(pole, sampling_rate))
    slopes = _mode_jacobian(coefficients, pole, sampling_rate)
    return values, np.where(np.isfinite(slopes), slopes, 0.0)


def _mode_jacobian(coefficients: Array, z: complex, sampling_rate: float) -> Array:
    """Derivatives of (frequency in Hz, damping ratio) with respect to ``a_1 ... a_na``, (2, na)."""
    s = np.log(z) * sampling_rate
    ds = sampling_rate / z * root_gradient(np.concatenate([[1.0], coefficients]), z)[1:]
    modulus = abs(s)
    d_modulus = (np.conj(s) * ds).real / modulus
    d_damping = -ds.real / modulus + s.real * d_modulus / modulus**2
    return np.vstack([d_modulus / (2.0 * np.pi), d_damping])
