"""Points with roots beyond their radius, moved inside."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomials import reflect_into_disc

Array = NDArray[np.float64]

# Roots are moved this share of the radius inside it.
MARGIN = 1e-6


class BoundedRoots(Protocol):
    """Points of polynomials whose roots have to lie within a radius each."""

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether they do, for each row."""

    def parts(self) -> dict[str, slice]:
        """Where the coefficients of each polynomial stand in a point."""

    def radius_of(self, name: str) -> float:
        """Largest allowed radius of the roots of a polynomial."""


def repaired(errors: BoundedRoots, points: Array, names: str) -> Array:
    """Move the roots of infeasible rows inside by reflection at the unit circle.

    Reflection leaves the magnitude of a frequency response as it was but for a constant, and that
    of a root of C the spectrum of the noise (Söderström & Stoica 1989, section 6.2); roots between
    the allowed radius and the unit circle go to that radius.

    Parameters
    ----------
    errors : BoundedRoots
    points : (M, n) array
    names : str
        Of the polynomials, a letter each.
    """
    moved = points.copy()
    rows = np.flatnonzero(~errors.feasible(points))
    finite = np.where(np.isfinite(points[rows]), points[rows], 0.0)
    parts = errors.parts()
    for name in names:
        part = parts[name]
        if part.stop > part.start and len(rows):
            inside = errors.radius_of(name) * (1.0 - MARGIN)
            finite[:, part] = reflect_into_disc(finite[:, part], inside)
    moved[rows] = finite
    return moved
