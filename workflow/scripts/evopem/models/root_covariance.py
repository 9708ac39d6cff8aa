"""Covariance of a polynomial's roots, from that of its coefficients."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import root_gradient

# 95 % points of chi-square with one and two degrees of freedom.
CHI_SQUARE_95 = {1: 3.841458820694124, 2: 5.991464547107979}


def root_covariance(
    coefficients: NDArray[np.float64],
    root: complex,
    covariance: ParameterCovariance | NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of a root's real and imaginary part, to first order.

    Parameters
    ----------
    coefficients : ndarray, shape (n + 1,)
        A polynomial in z, highest power first.
    root : complex
        One of its roots.
    covariance : ParameterCovariance, or ndarray of shape (n, n) or (n + 1, n + 1)
        Covariance of the coefficients; of all but the first where that is a 1 known exactly.

    Returns
    -------
    ndarray, shape (2, 2)
        Infinite variances where the data do not determine the root, NaN for a repeated root.
    """
    if not isinstance(covariance, ParameterCovariance):
        covariance = ParameterCovariance.from_matrix(covariance)
    gradient = root_gradient(coefficients, root)[-len(covariance) :]
    return covariance.of(np.vstack([gradient.real, gradient.imag]))
