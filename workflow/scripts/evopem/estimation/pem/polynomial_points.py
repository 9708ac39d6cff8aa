"""Points of polynomial models: where their parts stand, and roots moved into the allowed region.

A *point* holds the coefficients ``[a, b_1 ... b_m, c, d, f_1 ... f_m]`` (chapter eq. 18), a level
for each recording where levels are estimated, and for each stretch the states of all plants
``B_i / F_i`` (nf_i entries each), then for each stretch the noise state (``max(nc, nd)`` entries).
The states are what the unknown past adds to the first equations of ``F_i x_i = -B_i u_i + g_i``
and ``C e = D v + s``.  Estimated along, they leave no transient, however slow the roots of C.  A
population of points is an (M, n) array.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomials import reflect_into_disc
from evopem.models.structures import Orders

if TYPE_CHECKING:
    from evopem.estimation.pem.polynomial_objective import PolynomialErrors

Array = NDArray[np.float64]
Places = NDArray[np.intp]

# Roots are moved this share of the radius inside it.
MARGIN = 1e-6


class PolynomialPoints(ABC):
    """What prediction errors of one stretch and of several have in common."""

    orders: Orders
    objective: str  # "absolute" or "quadratic"
    plant_radius: float  # largest radius of the roots of A and F_i
    noise_radius: float  # of C and D
    levels: int = 0  # constants that are estimated
    stretches_count: int = 1

    @property
    def level(self) -> bool:
        """Whether a constant is estimated for each recording."""
        return self.levels > 0

    @property
    def parameters(self) -> int:
        """Number of coefficients and levels, without the states."""
        return self.orders.parameters + self.levels

    @property
    def dimension(self) -> int:
        """Length of a point."""
        states = sum(self.orders.nf) + self.orders.noise_states
        return self.parameters + self.stretches_count * states

    def parts(self) -> dict[str, slice]:
        """Where a, c, d, all b, all f, the levels, plant and noise states stand in a point."""
        o, count = self.orders, self.stretches_count
        lengths = {"a": o.na, "b": sum(o.nb), "c": o.nc, "d": o.nd, "f": sum(o.nf)}
        lengths["level"] = self.levels
        lengths |= {"plant": count * sum(o.nf), "noise": count * o.noise_states}
        parts, first = {}, 0
        for name, length in lengths.items():
            parts[name] = slice(first, first + length)
            first += length
        return parts

    def polynomials(self) -> list[tuple[str, slice]]:
        """Letter and place in a point of each of A, C, D and F_i that has coefficients."""
        o = self.orders
        found = [(name, o.part(name)) for name in "acd"]
        found += [("f", o.part("f", place)) for place in range(o.inputs)]
        return [(name, part) for name, part in found if part.stop > part.start]

    def linear(self, *names: str) -> NDArray[np.bool_]:
        """Which entries of a point some parts are."""
        chosen = np.zeros(self.dimension, dtype=bool)
        for name in names:
            chosen[self.parts()[name]] = True
        return chosen

    def radius_of(self, name: str) -> float:
        """Largest allowed radius of the roots of a polynomial, "a", "c", "d" or "f"."""
        return self.plant_radius if name in "af" else self.noise_radius

    @abstractmethod
    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether all roots of A, C, D and F_i of each row lie within their radii."""

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible rows inside by reflection at the unit circle.

        It leaves the magnitude of a frequency response as it was but for a constant, and that of a
        root of C the spectrum of the noise (Söderström & Stoica 1989, section 6.2).  Roots between
        the allowed radius and the unit circle go to that radius.
        """
        moved = points.copy()
        rows = np.flatnonzero(~self.feasible(points))
        if not len(rows):
            return moved
        finite = np.where(np.isfinite(points[rows]), points[rows], 0.0)
        for name, part in self.polynomials():
            inside = self.radius_of(name) * (1.0 - MARGIN)
            finite[:, part] = reflect_into_disc(finite[:, part], inside)
        moved[rows] = finite
        return moved

    @abstractmethod
    def places(self) -> list[tuple[PolynomialErrors, Places]]:
        """The errors of each stretch alone, and where its point stands in the point of all."""

    def residual_counts(self) -> list[int]:
        """Number of residuals that count in each stretch."""
        return [errors.scored_samples for errors, _ in self.places()]

    @abstractmethod
    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Consecutive rows of :meth:`jacobian`, which long records need."""

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals that count by a point, (N, n)."""
        return np.concatenate(list(self.jacobian_blocks(point)))
