"""Points of a polynomial model that meet hard constraints, as functions of free coordinates.

A *point* is that of :mod:`.polynomial_objective`; *coordinates* z are unbounded numbers.  Bounded
quantities follow from them by ``(1 + sin z) / 2``, whose ends are regular minima where the
objective would fall further outside (James & Roos 1975, MINUIT):

- a plant polynomial with a restricted region of poles is the product of its fixed factor and of
  second-order sections of :mod:`.pole_region`;
- a polynomial with fixed coefficients is an offset plus a basis times free coordinates;
- with a static gain g, ``B(1) = g A(1) F(1)`` gives the mean of B's free coefficients, and the free
  coordinates their differences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels import stability_barriers
from evopem.estimation.pem.pole_region import AT_EDGE, PoleRegion
from evopem.models.polynomials import root_gradient, roots

Array = NDArray[np.float64]

FREE, SHARE, EXCESS, KIND = range(4)
# Shares of a start: away from the edges, where the slope by the coordinate vanishes.
INSIDE = 0.01


class Part(NamedTuple):
    """Coefficients of a polynomial, their derivatives by its coordinates, (m, k)."""

    coefficients: Array
    derivatives: Array


@dataclass(frozen=True, eq=False)
class Sections:
    """A monic polynomial: a fixed factor times sections whose poles lie in a region.

    Coordinates: kind and two shares of each section, and one share of a single real pole.
    """

    factor: Array
    order: int
    region: PoleRegion

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.factor) - 1 + self.order

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        return [KIND, SHARE, SHARE] * (self.order // 2) + [SHARE] * (self.order % 2)

    def _factors(self, bounded: Array) -> list[tuple[Array, Array]]:
        """Each section with its leading 1, and its derivatives by its own shares."""
        found = []
        for k in range(self.order // 2):
            kind, shares = int(bounded[3 * k]), bounded[3 * k + 1 : 3 * k + 3]
            section, derivatives = self.region.section(kind, shares)
            found.append((np.concatenate([[1.0], section]), derivatives))
        if self.order % 2:
            low, high = self.region.real or (0.0, 0.0)
            pole = low + (high - low) * bounded[-1]
            found.append((np.array([1.0, -pole]), np.array([[low - high]])))
        return found

    def part(self, bounded: Array) -> Part:
        """Coefficients, and their derivatives by the bounded coordinates."""
        factors = self._factors(bounded)
        whole = self.factor
        for section, _ in factors:
            whole = np.convolve(whole, section)
        derivatives = np.zeros((len(whole) - 1, len(bounded)))
        for k, (_, own) in enumerate(factors):
            moves = self._moves(factors, k)
            first = 3 * k + (1 if own.shape[0] == 2 else 0)
            derivatives[:, first : first + own.shape[1]] = moves @ own
        return Part(whole[1:], derivatives)

    def _moves(self, factors: list[tuple[Array, Array]], k: int) -> Array:
        """Derivatives of the coefficients by those of one section."""
        others = self.factor
        for index, (section, _) in enumerate(factors):
            if index != k:
                others = np.convolve(others, section)
        size = len(factors[k][0]) - 1
        columns = [
            np.concatenate([np.zeros(j), others, np.zeros(size - j)]) for j in range(1, size + 1)
        ]
        return np.column_stack(columns)[1:]

    def active(self, bounded: Array) -> tuple[list[str], Array]:
        """Active constraints, and the directions of the coefficients that they leave free."""
        factors = self._factors(bounded)
        names: list[str] = []
        free = []
        for k, (_, own) in enumerate(factors):
            moves = self._moves(factors, k)
            if own.shape[0] == 1:
                name = self.region.active_real(float(bounded[-1]))
                if name is None:
                    free.append(moves)
                else:
                    names.append(name)
                continue
            shares = bounded[3 * k + 1 : 3 * k + 3]
            found, fixed = self.region.active(int(bounded[3 * k]), shares)
            names += found
            left = [index for index in (0, 1) if index not in fixed]
            free.append(moves if not fixed else moves @ own[:, left])
        rows = len(self.factor) - 1 + self.order
        return names, np.hstack([np.zeros((rows, 0)), *free])

    def coordinates(self, coefficients: Array) -> Array:
        """Bounded coordinates of the nearest allowed poles."""
        free = _without(roots(coefficients), roots(self.factor[1:]))
        upper = sorted((z for z in free if z.imag > 0.0), key=lambda z: float(np.angle(z)))
        real = sorted((z for z in free if z.imag == 0.0), key=lambda z: float(z.real))
        while len(upper) > self.order // 2:
            real += [complex(upper.pop().real)] * 2
        missing = self.order - 2 * len(upper) - len(real)
        real = (real + [0j] * max(missing, 0))[: self.order - 2 * len(upper)]
        single = real[len(real) // 2 : len(real) // 2 + 1] if self.order % 2 else []
        if single:
            real.remove(single[0])
        bounded: list[float] = []
        for pair in [(z, z.conjugate()) for z in upper] + list(
            zip(real[::2], real[1::2], strict=True)
        ):
            kind, shares = self.region.shares_of(np.array(pair))
            bounded += [float(kind), *shares]
        if single:
            low, high = self.region.real or (0.0, 0.0)
            bounded.append(float(np.clip((single[0].real - low) / (high - low), 0.0, 1.0)))
        return np.array(bounded)

    def random(self, generator: np.random.Generator) -> Array:
        """Bounded coordinates of random poles."""
        bounded = generator.random(len(self.codes))
        for k in range(self.order // 2):
            bounded[3 * k] = generator.integers(self.region.kinds)
            # Poles of interest lie near the edge of their region.
            bounded[3 * k + 2] = 1.0 - generator.random() ** 2
        return bounded

    def barrier(self, bounded: Array) -> tuple[float, Array, Array]:
        """No barrier: the coordinates cannot leave the region."""
        size = len(bounded)
        return 0.0, np.zeros(size), np.zeros((size, size))


@dataclass(frozen=True, eq=False)
class Linear:
    """Coefficients ``offset + basis @ w``.

    ``factor`` times a monic polynomial ``1 + inner_offset + inner_basis @ w`` within ``radius``
    for a plant polynomial; None for others.
    """

    offset: Array
    basis: Array
    radius: float | None = None
    inner_offset: Array | None = None
    inner_basis: Array | None = None
    radius_name: str = "stability"

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.offset)

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        return [FREE] * self.basis.shape[1]

    def part(self, bounded: Array) -> Part:
        """Coefficients, and their derivatives by the bounded coordinates."""
        return Part(self.offset + self.basis @ bounded, self.basis)

    def active(self, bounded: Array) -> tuple[list[str], Array]:
        """Active constraints, and the directions of the coefficients that they leave free."""
        if self.radius is None or self.inner_basis is None or self.inner_offset is None:
            return [], self.basis
        inner = np.concatenate([[1.0], self.inner_offset + self.inner_basis @ bounded])
        normals = []
        for root in roots(inner[1:]):
            if root.imag >= 0.0 and abs(root) >= self.radius * (1.0 - AT_EDGE):
                gradient = root_gradient(inner, root)[1:]
                normals.append((np.conj(root) * gradient).real @ self.inner_basis)
        if not normals:
            return [], self.basis
        return [self.radius_name], self.basis @ null_space(np.array(normals))

    def coordinates(self, coefficients: Array) -> Array:
        """Bounded coordinates of the nearest allowed value."""
        found = np.linalg.lstsq(self.basis, coefficients - self.offset, rcond=None)[0]
        return np.asarray(found, dtype=float)

    def barrier(self, bounded: Array) -> tuple[float, Array, Array]:
        """Stability barrier of the inner polynomial, its gradient and curvature."""
        size = len(bounded)
        if self.radius is None or self.inner_basis is None or self.inner_offset is None:
            return 0.0, np.zeros(size), np.zeros((size, size))
        inner = np.ascontiguousarray((self.inner_offset + self.inner_basis @ bounded)[None, :])
        if inner.shape[1] == 0:
            return 0.0, np.zeros(size), np.zeros((size, size))
        value, gradient, curvature = stability_barriers(inner, self.radius)
        basis = self.inner_basis
        return float(value[0]), basis.T @ gradient[0], basis.T @ curvature[0] @ basis


@dataclass(frozen=True)
class Gain:
    """Bounds of the static gain; equal where it is given."""

    lower: float | None
    upper: float | None

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        if self.lower == self.upper:
            return []
        return [SHARE if self.lower is not None and self.upper is not None else EXCESS]

    def value(self, bounded: Array) -> tuple[float, float]:
        """The gain, and its derivative by its coordinate."""
        if self.lower is None:
            return float(self.upper or 0.0) - float(bounded[0]), -1.0
        if self.upper is None:
            return self.lower + float(bounded[0]), 1.0
        if self.lower == self.upper:
            return self.lower, 0.0
        # Exact at both ends.
        share, width = float(bounded[0]), self.upper - self.lower
        gain = self.upper if share == 1.0 else self.lower + width * share
        return gain, width

    def coordinates(self, gain: float) -> Array:
        """Bounded coordinates of the nearest allowed value."""
        if not self.codes:
            return np.empty(0)
        if self.lower is None:
            return np.array([max(float(self.upper or 0.0) - gain, 0.0)])
        if self.upper is None:
            return np.array([max(gain - self.lower, 0.0)])
        return np.array([np.clip((gain - self.lower) / (self.upper - self.lower), 0.0, 1.0)])

    def active(self, bounded: Array) -> bool:
        """Whether the gain is given, or lies at a bound."""
        if not self.codes or bounded[0] <= AT_EDGE:
            return True
        return self.codes == [SHARE] and bool(bounded[0] >= 1.0 - AT_EDGE)


class GivenGain(NamedTuple):
    """A static gain that determines B.

    B is the offset and basis of coefficients that sum to zero; its free ones share the rest.

    Attributes
    ----------
    gain : Gain
    shared : (nb,) array
        1 / count at the free coefficients of B, and zero elsewhere.
    f : str
        Name of the F of this B.
    """

    gain: Gain
    shared: Array
    f: str


class ConstrainedParameters:
    """Coordinates of the points of a model that meet hard constraints.

    Parameters
    ----------
    polynomials : mapping of str to Sections or Linear
        In the order of a point.  Those of the plant have names that begin with ``a`` or ``f``,
        those of the numerators with ``b``; ``rest`` are levels and states.
    gains : mapping of str to GivenGain
        By the names of numerators.
    """

    def __init__(
        self,
        polynomials: Mapping[str, Sections | Linear],
        gains: Mapping[str, GivenGain] | None = None,
    ) -> None:
        self.polynomials, self.gains = dict(polynomials), dict(gains or {})
        ends = np.cumsum([0, *(polynomial.size for polynomial in self.polynomials.values())])
        self.parts = {n: slice(ends[i], ends[i + 1]) for i, n in enumerate(self.polynomials)}
        codes: list[int] = []
        self.own: dict[str, slice] = {}
        for name, polynomial in self.polynomials.items():
            self.own[name] = slice(len(codes), len(codes) + len(polynomial.codes))
            codes += polynomial.codes
        for name, given in self.gains.items():
            own = slice(len(codes), len(codes) + len(given.gain.codes))
            self.own[_gain_of(name)] = own
            codes += given.gain.codes
        self.codes = np.array(codes, dtype=int)
        self.dimension = int(ends[-1])
        # Coordinates in which the residuals are linear.
        self.linear = np.zeros(len(codes), dtype=bool)
        for name in self.polynomials:
            if name[0] == "b" or name == "rest":
                self.linear[self.own[name]] = True

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
            own = self.own[name]
            point[where], derivatives[where, own] = self.polynomials[name].part(bounded[own])
        for name, given in self.gains.items():
            own = self.own[_gain_of(name)]
            g, by_coordinate = given.gain.value(bounded[own])
            at_a, at_f = (1.0 + float(np.sum(point[self.parts[each]])) for each in ("a", given.f))
            b = self.parts[name]
            missing = g * at_a * at_f - float(np.sum(point[b]))
            point[b] += missing * given.shared
            change = g * at_f * derivatives[self.parts["a"]].sum(axis=0)
            change += g * at_a * derivatives[self.parts[given.f]].sum(axis=0)
            change[own] += by_coordinate * at_a * at_f
            derivatives[b] += np.outer(given.shared, change)
        return point, derivatives

    def coordinates(self, point: Array) -> Array:
        """Bounded coordinates of the nearest allowed point."""
        bounded = np.zeros(len(self.codes))
        for name, where in self.parts.items():
            bounded[self.own[name]] = self.polynomials[name].coordinates(point[where])
        for name, given in self.gains.items():
            a, f = (1.0 + float(np.sum(point[self.parts[each]])) for each in ("a", given.f))
            gain = float(np.sum(point[self.parts[name]])) / (a * f)
            bounded[self.own[_gain_of(name)]] = given.gain.coordinates(gain)
        return bounded

    def random(self, bounded: Array, generator: np.random.Generator) -> Array:
        """Coordinates z with random poles where these have sections, and a random gain."""
        bounded = bounded.copy()
        for name in self.plant:
            polynomial = self.polynomials[name]
            if isinstance(polynomial, Sections):
                bounded[self.own[name]] = polynomial.random(generator)
        for name, given in self.gains.items():
            if given.gain.codes:
                bounded[self.own[_gain_of(name)]] = generator.random()
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
        names: set[str] = set()
        blocks = []
        for name, where in self.parts.items():
            found, free = self.polynomials[name].active(bounded[self.own[name]])
            names.update(found)
            block = np.zeros((self.dimension, free.shape[1]))
            block[where] = free
            blocks.append(block)
        tangent = np.hstack(blocks)
        for name, given in self.gains.items():
            where = self.own[_gain_of(name)]
            own = bounded[where]
            g, _ = given.gain.value(own)
            at_a, at_f = (1.0 + float(np.sum(point[self.parts[each]])) for each in ("a", given.f))
            change = g * at_f * tangent[self.parts["a"]].sum(axis=0)
            change += g * at_a * tangent[self.parts[given.f]].sum(axis=0)
            tangent[self.parts[name]] += np.outer(given.shared, change)
            if given.gain.active(own):
                if given.gain.codes:
                    names.add("static_gain_bounds")
            else:
                tangent = np.hstack([tangent, derivatives[:, where]])
        return tuple(sorted(names)), tangent

    def barriers(self, bounded: Array) -> tuple[float, Array, Array]:
        """Barrier of the plant polynomials with fixed coefficients, gradient and curvature."""
        value = 0.0
        gradient = np.zeros(len(bounded))
        curvature = np.zeros((len(bounded), len(bounded)))
        for name in self.plant:
            own = self.own[name]
            found, slope, bend = self.polynomials[name].barrier(bounded[own])
            value += found
            gradient[own], curvature[own, own] = slope, bend
        return value, gradient, curvature


def _gain_of(name: str) -> str:
    """The name of the coordinate of a numerator's static gain."""
    return f"gain of {name}"


def null_space(rows: Array) -> Array:
    """An orthonormal basis of the vectors that all rows are orthogonal to, (n, k)."""
    _, singular, vectors = np.linalg.svd(rows)
    rank = int(np.count_nonzero(singular > 1e-12 * max(singular[0], 1e-300))) if len(rows) else 0
    basis: Array = vectors[rank:].T
    return basis


def _without(
    poles: NDArray[np.complex128], known: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Poles less those nearest to known ones; a pair that loses one pole keeps a real one."""
    left = list(poles)
    for pole in known:
        if not left:
            break
        nearest = min(left, key=lambda z: abs(z - pole))
        left.remove(nearest)
    paired: list[complex] = []
    for z in left:
        alone = z.imag != 0.0 and not any(abs(z.conjugate() - w) < 1e-9 for w in left)
        paired.append(complex(z.real) if alone else z)
    return np.array(paired, dtype=complex)
