"""Points of a polynomial model that meet hard constraints, as functions of free coordinates z.
Bounded quantities are ``(1 + sin z) / 2``, whose ends are regular minima where the objective would
fall further outside (James & Roos 1975, MINUIT).  ``B(1) = g A(1) F(1)`` with a static gain g."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.estimation.pem.constrained_polynomials import (
    EXCESS,
    KIND,
    SHARE,
    Linear,
    RegionSections,
)
from evopem.estimation.pem.derived_errors import Mapped
from evopem.estimation.pem.pole_region import AT_EDGE

INSIDE = 0.01  # shares of a start: away from the edges, where the slope by the coordinate vanishes


@dataclass(frozen=True)
class Gain:
    """Bounds of the static gain, infinite where there is none; equal where it is given."""

    lower: float
    upper: float

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        if self.lower == self.upper:
            return []
        return [SHARE if np.isfinite(self.upper - self.lower) else EXCESS]

    def value(self, bounded: Array) -> tuple[float, float]:
        """The gain, and its derivative by its coordinate."""
        if not self.codes:
            return self.lower, 0.0
        at, width = float(bounded[0]), self.upper - self.lower
        if self.codes == [EXCESS]:
            return (self.lower + at, 1.0) if np.isinf(self.upper) else (self.upper - at, -1.0)
        # Exact at both ends.
        return (self.upper if at == 1.0 else self.lower + width * at), width

    def coordinates(self, gain: float) -> Array:
        """Bounded coordinates of the nearest allowed value."""
        if self.codes == [EXCESS]:
            return np.array([max(min(gain - self.lower, self.upper - gain), 0.0)])
        if not self.codes:
            return np.empty(0)
        return np.array([np.clip((gain - self.lower) / (self.upper - self.lower), 0.0, 1.0)])

    def active(self, bounded: Array) -> bool:
        """Whether the gain is given, or lies at a bound."""
        if not self.codes or bounded[0] <= AT_EDGE:
            return True
        return self.codes == [SHARE] and bool(bounded[0] >= 1.0 - AT_EDGE)


class GivenGain(NamedTuple):
    """A static gain that determines B.  B is the offset and basis of coefficients that sum to zero;
    its free ones share the rest.  ``shared`` (nb,): 1 / count at the free coefficients of B, and
    zero elsewhere.  ``f``: name of the F of this B."""

    gain: Gain
    shared: Array
    f: str


class ConstrainedParameters:
    """Coordinates of the points of a model that meet hard constraints.  ``polynomials``: in the
    order of a point, a and f of the plant, b of numerators, ``rest`` of levels and states.
    ``gains``: by the names of numerators.  ``tied``: C is A, so that without D the one-step errors
    are those of simulation, and the noise state is the initial state of 1/A."""

    def __init__(
        self,
        polynomials: Mapping[str, RegionSections | Linear],
        gains: Mapping[str, GivenGain] | None = None,
        tied: bool = False,
    ) -> None:
        self.polynomials, self.gains, self.tied = dict(polynomials), dict(gains or {}), tied
        ends = np.cumsum([0, *(polynomial.size for polynomial in self.polynomials.values())])
        self.parts = {n: slice(ends[i], ends[i + 1]) for i, n in enumerate(self.polynomials)}
        codes: list[int] = []
        self.columns: dict[str, slice] = {}
        for name, polynomial in self.polynomials.items():
            self.columns[name] = slice(len(codes), len(codes) + len(polynomial.codes))
            codes += polynomial.codes
        for name, given in self.gains.items():
            self.columns[_gain_of(name)] = slice(len(codes), len(codes) + len(given.gain.codes))
            codes += given.gain.codes
        self.codes = np.array(codes, dtype=int)
        self.dimension = int(ends[-1])
        # Coordinates in which the residuals are linear.
        self.linear = np.zeros(len(codes), dtype=bool)
        for name in self.polynomials:
            if name[0] == "b" or name == "rest":
                self.linear[self.columns[name]] = True

    @property
    def plant(self) -> list[str]:
        """Names of the polynomials with the poles of the plant."""
        return [name for name in self.polynomials if name[0] in "af"]

    def bounded(self, z: Array) -> tuple[Array, Array, Array]:
        """Bounded coordinates, and their first and second derivatives by z."""
        shares, excess = self.codes == SHARE, self.codes == EXCESS
        value = np.where(shares, 0.5 * (1.0 + np.sin(z)), z)
        value = np.where(excess, np.sqrt(1.0 + z**2) - 1.0, value)
        slope = np.where(shares, 0.5 * np.cos(z), np.where(self.codes == KIND, 0.0, 1.0))
        slope = np.where(excess, z / np.sqrt(1.0 + z**2), slope)
        bend = np.where(shares, -0.5 * np.sin(z), 0.0)
        return value, slope, np.where(excess, (1.0 + z**2) ** -1.5, bend)

    def unbounded(self, bounded: Array, margin: float = INSIDE) -> Array:
        """Coordinates z of bounded coordinates, shares kept a margin away from their ends."""
        shares, excess = self.codes == SHARE, self.codes == EXCESS
        inside = np.where(shares, np.clip(bounded, margin, 1.0 - margin), 0.5)
        z = np.where(shares, np.arcsin(2.0 * inside - 1.0), bounded)
        longer = np.maximum(np.where(excess, bounded, 0.0), margin)
        return np.where(excess, np.sqrt((1.0 + longer) ** 2 - 1.0), z)

    def point(self, bounded: Array) -> tuple[Array, Array]:
        """The point of bounded coordinates, and its derivatives by them."""
        point, derivatives = np.zeros(self.dimension), np.zeros((self.dimension, len(bounded)))
        for name, where in self.parts.items():
            span = self.columns[name]
            point[where], derivatives[where, span] = self.polynomials[name].part(bounded[span])
        if self.tied:
            point[self.parts["c"]] = point[self.parts["a"]]
            derivatives[self.parts["c"]] = derivatives[self.parts["a"]]
        for name, given in self.gains.items():
            span, b = self.columns[_gain_of(name)], self.parts[name]
            g, by_coordinate = given.gain.value(bounded[span])
            at_one, change = self._at_one(given, point, derivatives)
            point[b] += (g * at_one - float(np.sum(point[b]))) * given.shared
            change *= g
            change[span] += by_coordinate * at_one
            derivatives[b] += np.outer(given.shared, change)
        return point, derivatives

    def _at_one(self, given: GivenGain, point: Array, derivatives: Array) -> tuple[float, Array]:
        """A(1) F(1) of a point, and its derivatives, the point's being (n, k)."""
        a, f = self.parts["a"], self.parts[given.f]
        at_a, at_f = (1.0 + float(np.sum(point[part])) for part in (a, f))
        change = at_f * derivatives[a].sum(axis=0) + at_a * derivatives[f].sum(axis=0)
        return at_a * at_f, change

    def coordinates(self, point: Array) -> Array:
        """Bounded coordinates of the nearest allowed point."""
        bounded = np.zeros(len(self.codes))
        for name, where in self.parts.items():
            bounded[self.columns[name]] = self.polynomials[name].coordinates(point[where])
        for name, given in self.gains.items():
            at_one, _ = self._at_one(given, point, np.zeros((len(point), 0)))
            gain = float(np.sum(point[self.parts[name]])) / at_one
            bounded[self.columns[_gain_of(name)]] = given.gain.coordinates(gain)
        return bounded

    def random(self, bounded: Array, generator: np.random.Generator) -> Array:
        """Coordinates z with random poles where these have sections, and a random gain."""
        bounded = bounded.copy()
        for name in self.plant:
            polynomial = self.polynomials[name]
            if isinstance(polynomial, RegionSections):
                bounded[self.columns[name]] = polynomial.random(generator)
        for name, given in self.gains.items():
            if given.gain.codes:
                bounded[self.columns[_gain_of(name)]] = generator.random()
        return self.unbounded(bounded)

    def snapped(self, z: Array) -> Array:
        """Coordinates with shares that are as good as at an end moved there."""
        bounded, _, _ = self.bounded(z)
        snapped = z.copy()
        shares = self.codes == SHARE
        snapped[shares & (bounded >= 1.0 - AT_EDGE)] = 0.5 * np.pi
        snapped[shares & (bounded <= AT_EDGE)] = -0.5 * np.pi
        snapped[(self.codes == EXCESS) & (bounded <= AT_EDGE)] = 0.0
        return snapped

    def active(self, z: Array) -> tuple[tuple[str, ...], Array]:
        """Inequalities that are active, and a basis of the free directions of a point, (n, k)."""
        bounded, _, _ = self.bounded(z)
        point, derivatives = self.point(bounded)
        of_polynomials = [
            p.active(bounded[self.columns[name]]) for name, p in self.polynomials.items()
        ]
        names = {name for is_active, _ in of_polynomials for name in is_active}
        tangent = scipy.linalg.block_diag(*(free for _, free in of_polynomials))
        if self.tied:
            tangent[self.parts["c"]] = tangent[self.parts["a"]]
        for name, given in self.gains.items():
            where = self.columns[_gain_of(name)]
            values = bounded[where]
            _, change = self._at_one(given, point, tangent)
            change *= given.gain.value(values)[0]
            tangent[self.parts[name]] += np.outer(given.shared, change)
            if given.gain.active(values):
                if given.gain.codes:
                    names.add("static_gain_bounds")
            else:
                tangent = np.hstack([tangent, derivatives[:, where]])
        return tuple(sorted(names)), tangent

    def mapped(self, z: Array) -> Mapped:
        """The points of rows of coordinates."""
        rows = [self.bounded(row) for row in z]
        values, slopes, bends = (np.array(columns) for columns in zip(*rows, strict=True))
        points, derivatives = zip(*map(self.point, values), strict=True)
        barrier, by_bounded, bend = zip(*map(self.barriers, values), strict=True)
        barriers = np.array(barrier), np.array(by_bounded), np.array(bend)
        return Mapped(np.array(points), np.array(derivatives), slopes, bends, barriers)

    def barriers(self, bounded: Array) -> tuple[float, Array, Array]:
        """Barrier of the plant polynomials with fixed coefficients, gradient and curvature."""
        value = 0.0
        gradient = np.zeros(len(bounded))
        curvature = np.zeros((len(bounded), len(bounded)))
        for name in self.plant:
            span, polynomial = self.columns[name], self.polynomials[name]
            if isinstance(polynomial, Linear):  # sections cannot leave their region
                barrier, slope, bend = polynomial.barrier(bounded[span])
                value += barrier
                gradient[span], curvature[span, span] = slope, bend
        return value, gradient, curvature


def _gain_of(name: str) -> str:
    """The name of the coordinate of a numerator's static gain."""
    return f"gain of {name}"
