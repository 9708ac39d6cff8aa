"""Polynomials that meet hard constraints, as functions of bounded coordinates: a fixed factor times
sections of :mod:`.pole_region`, or an offset plus a basis times free coordinates."""

from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, Complex
from evopem.estimation.pem.kernels.polynomials import stability_barriers
from evopem.estimation.pem.pole_region import AT_EDGE, PoleRegion
from evopem.models.polynomial_roots import root_gradient, roots

# Kinds of coordinates: any number, a share of 0 to 1, an excess over a bound, a kind of section.
FREE, SHARE, EXCESS, KIND = range(4)


@dataclass(frozen=True, eq=False)
class RegionSections:
    """A monic polynomial: a fixed factor times sections whose poles lie in a region.  Coordinates:
    kind and two shares of each section, and one share of a single real pole."""

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
        factors = []
        for k in range(self.order // 2):
            kind, shares = int(bounded[3 * k]), bounded[3 * k + 1 : 3 * k + 3]
            section, derivatives = self.region.section(kind, shares)
            factors.append((np.concatenate([[1.0], section]), derivatives))
        if self.order % 2:
            low, high = self.region.real or (0.0, 0.0)
            pole = low + (high - low) * bounded[-1]
            factors.append((np.array([1.0, -pole]), np.array([[low - high]])))
        return factors

    def part(self, bounded: Array) -> tuple[Array, Array]:
        """Coefficients, and their derivatives by the bounded coordinates."""
        factors = self._factors(bounded)
        whole = self.factor
        for section, _ in factors:
            whole = np.convolve(whole, section)
        derivatives = np.zeros((len(whole) - 1, len(bounded)))
        for k, (_, slopes) in enumerate(factors):
            moves = self._moves(factors, k)
            first = 3 * k + (1 if slopes.shape[0] == 2 else 0)
            derivatives[:, first : first + slopes.shape[1]] = moves @ slopes
        return whole[1:], derivatives

    def _moves(self, factors: list[tuple[Array, Array]], k: int) -> Array:
        """Derivatives of the coefficients by those of one section."""
        others = self.factor
        for index, (section, _) in enumerate(factors):
            if index != k:
                others = np.convolve(others, section)
        return np.asarray(scipy.linalg.convolution_matrix(others, len(factors[k][0]) - 1))

    def active(self, bounded: Array) -> tuple[list[str], Array]:
        """Active constraints, and the directions of the coefficients that they leave free."""
        factors = self._factors(bounded)
        names: list[str] = []
        free = []
        for k, (_, slopes) in enumerate(factors):
            moves = self._moves(factors, k)
            if slopes.shape[0] == 1:
                name = self.region.active_real(float(bounded[-1]))
                if name is None:
                    free.append(moves)
                else:
                    names.append(name)
                continue
            shares = bounded[3 * k + 1 : 3 * k + 3]
            is_active, fixed = self.region.active(int(bounded[3 * k]), shares)
            names += is_active
            left = [index for index in (0, 1) if index not in fixed]
            free.append(moves if not fixed else moves @ slopes[:, left])
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


@dataclass(frozen=True, eq=False)
class Linear:
    """Coefficients ``offset + basis @ w``.  ``factor`` times a monic polynomial ``1 + inner_offset
    + inner_basis @ w`` within ``radius`` for a plant polynomial; None for others."""

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

    def part(self, bounded: Array) -> tuple[Array, Array]:
        """Coefficients, and their derivatives by the bounded coordinates."""
        return self.offset + self.basis @ bounded, self.basis

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
        point = np.linalg.lstsq(self.basis, coefficients - self.offset, rcond=None)[0]
        return np.asarray(point, dtype=float)

    def barrier(self, bounded: Array) -> tuple[float, Array, Array]:
        """Stability barrier of the inner polynomial, its gradient and curvature."""
        basis = self.inner_basis
        if self.radius is None or basis is None or self.inner_offset is None or not len(basis):
            size = len(bounded)
            return 0.0, np.zeros(size), np.zeros((size, size))
        inner = np.ascontiguousarray((self.inner_offset + basis @ bounded)[None, :])
        value, gradient, curvature = stability_barriers(inner, self.radius)
        return float(value[0]), basis.T @ gradient[0], basis.T @ curvature[0] @ basis


def null_space(rows: Array) -> Array:
    """An orthonormal basis of the vectors that all rows are orthogonal to, (n, k)."""
    _, singular, vectors = np.linalg.svd(rows)
    rank = int(np.count_nonzero(singular > 1e-12 * max(singular[0], 1e-300))) if len(rows) else 0
    return np.asarray(vectors[rank:].T)


def _without(poles: Complex, known: Complex) -> Complex:
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
