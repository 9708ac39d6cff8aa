"""Roots of a model's polynomials in the z plane with their covariance and confidence ellipses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import root_gradient
from evopem.models.polynomials import roots as roots_of

Array = NDArray[np.float64]
Polynomial = Literal["A", "B", "C", "D", "F"]

# 95 % points of chi-square with one and two degrees of freedom.
CHI_SQUARE_95 = {1: 3.841458820694124, 2: 5.991464547107979}


@dataclass(frozen=True, eq=False)
class UncertainRoot:
    """A root of a polynomial with the covariance of its real and imaginary part.

    Attributes
    ----------
    value : complex
    covariance : (2, 2) array
        NaN where it is not known or not finite.
    """

    value: complex
    covariance: Array

    @property
    def covariance_known(self) -> bool:
        """Whether the covariance is finite."""
        return bool(np.isfinite(self.covariance).all())

    @property
    def half_axes(self) -> Array:
        """Half axes of the 95 % confidence ellipse, the smaller first, (2,); NaN where unknown.

        A real root varies on the real axis alone and has one degree of freedom.
        """
        if not self.covariance_known:
            return np.full(2, np.nan)
        freedom = 1 if self.value.imag == 0 else 2
        variances = np.clip(np.linalg.eigvalsh(self.covariance), 0, None)
        radii: Array = np.sqrt(variances * CHI_SQUARE_95[freedom])
        return radii

    def outline(self, points: int = 73) -> Array:
        """Points on the 95 % confidence ellipse, real and imaginary parts as rows, (2, points)."""
        if not self.covariance_known:
            return np.full((2, points), np.nan)
        angle = np.linspace(0, 2 * np.pi, points)
        circle = np.vstack([np.cos(angle), np.sin(angle)])
        directions = np.linalg.eigh(self.covariance)[1]
        centre = np.array([[self.value.real], [self.value.imag]])
        outline: Array = centre + directions @ (self.half_axes[:, None] * circle)
        return outline


def ellipse_outline(
    real: float, imag: float, variance_real: float, variance_imag: float, covariance: float
) -> Array:
    """Points on the 95 % confidence ellipse of a root, real and imaginary parts as rows."""
    matrix = np.array([[variance_real, covariance], [covariance, variance_imag]])
    return UncertainRoot(complex(real, imag), matrix).outline()


def uncertain_roots(model: PolynomialModel, polynomial: Polynomial) -> list[UncertainRoot]:
    """Roots in the z plane of one polynomial of a model, with their covariances.

    The covariance of the coefficients is propagated to the roots to first order.

    ``polynomial`` {"A", "B", "C", "D", "F"}.
    """
    letter = polynomial.lower()
    coefficients = getattr(model, letter)
    roots = model.zeros() if polynomial == "B" else roots_of(coefficients[1:])
    unknown = np.full((2, 2), np.nan)
    if model.covariance is None:
        return [UncertainRoot(complex(root), unknown) for root in roots]
    own = model.covariance.part(model.part(letter))
    found = []
    for root in roots:
        covariance = root_covariance(coefficients, complex(root), own)
        finite = bool(np.isfinite(covariance).all())
        found.append(UncertainRoot(complex(root), covariance if finite else unknown))
    return found


def root_covariance(
    coefficients: Array,
    root: complex,
    covariance: ParameterCovariance | Array,
) -> Array:
    """Covariance of a root's real and imaginary part, to first order.

    ``coefficients`` (n + 1,): A polynomial in z, highest power first.  ``root``: one of its roots.
    ``covariance`` (n, n): covariance of the coefficients; of all but the first where that is a 1
    known exactly.  Returns (2, 2): Infinite variances where the data do not determine the root, NaN
    for a repeated root.
    """
    if not isinstance(covariance, ParameterCovariance):
        covariance = ParameterCovariance.from_matrix(covariance)
    gradient = root_gradient(coefficients, root)[-len(covariance) :]
    return covariance.of(np.vstack([gradient.real, gradient.imag]))
