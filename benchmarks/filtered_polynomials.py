"""Residuals and Jacobian of polynomial models by SciPy's filters, for SciPy's least squares.

No code is shared with the package: the solutions are what the search is compared with.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

Array = NDArray[np.float64]

ONE = np.ones(1)
# Square roots of the weights of the squares of the plant state and of the noise state.
STATE_WEIGHTS = (1e-3, 1e-1)


class FilteredPolynomials:
    """Residuals of ``A y = (B/F) u q^-nk + (C/D) e`` with the initial states of both filters.

    Parameters
    ----------
    u, y : (N,) arrays
    orders : (na, nb, nc, nd, nf, nk)
    start : int
        First residual.
    """

    def __init__(self, u: Array, y: Array, orders: tuple[int, ...], start: int) -> None:
        self.u, self.y, self.start = u, y, start
        self.na, self.nb, self.nc, self.nd, self.nf, self.nk = orders
        self.states = max(self.nc, self.nd)
        sizes = [self.na, self.nb, self.nc, self.nd, self.nf, self.nf, self.states]
        self.splits = np.cumsum(sizes)[:-1]
        self.dimension = sum(sizes)
        weights = [np.full(self.nf, STATE_WEIGHTS[0]), np.full(self.states, STATE_WEIGHTS[1])]
        self.weights = np.concatenate(weights)
        self.state_rows = np.eye(
            len(self.weights), self.dimension, self.dimension - len(self.weights)
        )
        self.impulse = np.zeros(len(y) - start)
        self.impulse[0] = 1.0
        self.past_y = [self._from(y, i) for i in range(1, self.na + 1)]
        self.past_u = [self._from(u, self.nk + j) for j in range(self.nb)]

    def residuals(self, point: Array) -> Array:
        """Residuals and weighted states."""
        e = self._signals(point)[2]
        return np.concatenate([e, self.weights * point[self.dimension - len(self.weights) :]])

    def jacobian(self, point: Array) -> Array:
        """Their derivatives."""
        _, _, c, d, f, _, _ = self._polynomials(point)
        x, v, e = self._signals(point)
        through_f = [-column for column in self.past_u]
        through_f += [-self._delayed(x, k) for k in range(1, self.nf + 1)]
        through_f += [self._delayed(self.impulse, k) for k in range(self.nf)]
        by_f = [lfilter(d, np.convolve(c, f), column) for column in through_f]
        by_d = [lfilter(d, c, column) for column in self.past_y]
        through_c = [-self._delayed(e, k) for k in range(1, self.nc + 1)]
        through_c += [self._delayed(v, k) for k in range(1, self.nd + 1)]
        through_c += [self._delayed(self.impulse, k) for k in range(self.states)]
        by_c = [lfilter(ONE, c, column) for column in through_c]
        noise = self.nc + self.nd
        columns = by_d + by_f[: self.nb] + by_c[:noise] + by_f[self.nb :] + by_c[noise:]
        weighted = self.weights[:, None] * self.state_rows
        return np.concatenate([np.column_stack(columns), weighted])

    def objective(self, point: Array) -> float:
        """100 times the sum of squares over that of the output."""
        r = self.residuals(point)
        return 100.0 * float(r @ r) / float(self.y[self.start :] @ self.y[self.start :])

    def solve(self, start: Array, steps: int = 200) -> Array:
        """The local solution from a point."""
        return least_squares(
            self.residuals,
            start,
            self.jacobian,
            x_scale="jac",
            max_nfev=steps,
            xtol=1e-13,
            ftol=1e-13,
            gtol=1e-13,
        ).x

    def stable(self, point: Array, radius: float) -> bool:
        """Whether the roots of A, C, D and F lie within a radius."""
        a, _, c, d, f, _, _ = self._polynomials(point)
        return all(np.all(np.abs(np.roots(part)) <= radius) for part in (a, c, d, f))

    def random_start(self, generator: np.random.Generator) -> Array:
        """Stable random polynomials, B by least squares on the simulated output."""
        point = np.zeros(self.dimension)
        parts = np.split(point, self.splits)
        for index in (0, 2, 3, 4):
            parts[index][:] = _random_monic(len(parts[index]), generator)
        if self.nb:
            f = np.concatenate([ONE, parts[4]])
            columns = np.column_stack([lfilter(ONE, f, column) for column in self.past_u])
            target = lfilter(np.concatenate([ONE, parts[0]]), ONE, self.y)[self.start :]
            parts[1][:] = np.linalg.lstsq(columns, target, rcond=1e-12)[0]
        return np.concatenate(parts)

    def _polynomials(self, point: Array) -> list[Array]:
        a, b, c, d, f, plant, noise = np.split(point, self.splits)
        a, c, d, f = (np.concatenate([ONE, part]) for part in (a, c, d, f))
        return [a, b, c, d, f, plant, noise]

    def _signals(self, point: Array) -> tuple[Array, Array, Array]:
        a, b, c, d, f, plant, noise = self._polynomials(point)
        x = np.zeros_like(self.impulse)
        for coefficient, column in zip(b, self.past_u, strict=True):
            x -= coefficient * column
        x[: self.nf] += plant
        x = lfilter(ONE, f, x)
        v = x + self._from(self.y, 0)
        for coefficient, column in zip(a[1:], self.past_y, strict=True):
            v = v + coefficient * column
        by_d = lfilter(d, ONE, v)
        by_d[: self.states] += noise
        return x, v, lfilter(ONE, c, by_d)

    def _from(self, signal: Array, lag: int) -> Array:
        return signal[self.start - lag : len(signal) - lag]

    def _delayed(self, signal: Array, lag: int) -> Array:
        return np.concatenate([np.zeros(lag), signal[: len(signal) - lag]])


def _random_monic(order: int, generator: np.random.Generator) -> Array:
    """Coefficients of a polynomial with roots uniform in angle and in the square of the radius."""
    pairs = order // 2
    upper = 0.99 * np.sqrt(generator.random(pairs)) * np.exp(1j * np.pi * generator.random(pairs))
    real = generator.uniform(-0.99, 0.99, order % 2)
    return np.atleast_1d(np.real(np.poly(np.concatenate([upper, upper.conj(), real]))))[1:]
