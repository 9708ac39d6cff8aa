"""The Fletcher-Powell function and its instances (Fletcher & Powell 1963; Bäck 1996)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fletcher_powell.packages import import_package

Array = NDArray[np.float64]

CEC_2005 = "cec2005-f12"
SEEDED = "seed-"
LARGEST_ENTRY = 100


@dataclass(frozen=True, eq=False)
class Instance:
    """``f(x) = sum_i (A_i - B_i(x))^2``, ``B_i(x) = sum_j (a_ij sin x_j + b_ij cos x_j)``.

    ``A_i = B_i(alpha)``, so the global minimum is 0, at alpha.  f is 2π-periodic in each
    coordinate.

    Attributes
    ----------
    name : str
    a, b : (n, n) arrays
        Whole numbers from -100 to 100.
    alpha : (n,) array
        In [-π, π].
    """

    name: str
    a: Array = field(repr=False)
    b: Array = field(repr=False)
    alpha: Array = field(repr=False)

    def __post_init__(self) -> None:
        weights = np.ascontiguousarray(np.concatenate([self.a, self.b], axis=1).T)
        object.__setattr__(self, "_weights", weights)
        waves = np.concatenate([np.sin(self.alpha), np.cos(self.alpha)])
        object.__setattr__(self, "_target", waves[None] @ weights)

    @property
    def dimension(self) -> int:
        """Number of coordinates, n."""
        return len(self.alpha)

    @property
    def precision(self) -> float:
        """Value below which f is rounding error: eps² times the sum of all squared weights."""
        weights: Array = self._weights  # type: ignore[attr-defined]
        return float(np.finfo(float).eps ** 2 * np.sum(weights**2))

    def values(self, points: Array) -> Array:
        """f of each row of (M, n) points, (M,)."""
        return _squares(self._residuals(np.sin(points), np.cos(points)))

    def values_and_gradients(self, points: Array) -> tuple[Array, Array]:
        """f of each row, (M,), and its exact gradient, (M, n)."""
        sine, cosine = np.sin(points), np.cos(points)
        residuals = self._residuals(sine, cosine)
        gradients = 2.0 * ((residuals @ self.a) * cosine - (residuals @ self.b) * sine)
        return _squares(residuals), gradients

    def values_and_differences(self, points: Array) -> tuple[Array, Array]:
        """f of each row, and its gradient by forward differences: n further values a row.

        The step is ``sqrt(eps) max(1, |x_j|)``.
        """
        count, n = points.shape
        step = _difference_steps(points)
        moved = points + step
        # Only the coordinate that moved needs a new sine and cosine; every sum is computed again.
        diagonal = np.arange(n)
        sine, cosine = np.sin(points), np.cos(points)
        sines = np.repeat(sine[:, None, :], n, axis=1)
        cosines = np.repeat(cosine[:, None, :], n, axis=1)
        sines[:, diagonal, diagonal] = np.sin(moved)
        cosines[:, diagonal, diagonal] = np.cos(moved)
        values = _squares(self._residuals(sine, cosine))
        shifted = _squares(self._residuals(sines.reshape(-1, n), cosines.reshape(-1, n)))
        return values, (shifted.reshape(count, n) - values[:, None]) / step

    def residuals(self, point: Array) -> Array:
        """``B_i - A_i`` at a point, (n,): f is the sum of their squares."""
        return self._residuals(np.sin(point)[None], np.cos(point)[None])[0]

    def jacobian(self, point: Array) -> Array:
        """Exact derivatives of the residuals at a point, (n, n)."""
        derivatives: Array = self.a * np.cos(point) - self.b * np.sin(point)
        return derivatives

    def jacobian_by_differences(self, point: Array) -> Array:
        """The same by forward differences: the residuals of n further points."""
        step = _difference_steps(point)
        moved = point + np.diag(step)
        shifted = self._residuals(np.sin(moved), np.cos(moved))
        return (shifted - self.residuals(point)).T / step

    def _residuals(self, sine: Array, cosine: Array) -> Array:
        waves = np.concatenate([sine, cosine], axis=1)
        residuals: Array = waves @ self._weights - self._target  # type: ignore[attr-defined]
        return residuals


def _difference_steps(points: Array) -> Array:
    """Steps of forward differences, as they are once they have been added to the points."""
    steps = np.sqrt(np.finfo(float).eps) * np.maximum(1.0, np.abs(points))
    rounded: Array = (points + steps) - points
    return rounded


def _squares(residuals: Array) -> Array:
    return np.einsum("ij,ij->i", residuals, residuals)


def wrap(points: Array) -> Array:
    """Move points to their images in the box [-π, π], where f is the same."""
    return points - 2.0 * np.pi * np.round(points / (2.0 * np.pi))


def instance(name: str, dimension: int) -> Instance:
    """Make an instance of the function.

    Parameters
    ----------
    name : str
        ``seed-<whole number>``: integer weights drawn uniformly from [-100, 100] and alpha drawn
        uniformly from [-π, π]; or ``cec2005-f12``: the leading rows and columns of function 12 of
        the CEC 2005 test suite (Schwefel's problem 2.13), without the suite's bias of -460.
    dimension : int
        At most 100 for ``cec2005-f12``.

    Raises
    ------
    InputError
        When the package optproblems, which holds the data of ``cec2005-f12``, is missing.
    ValueError
        For an unknown name or a dimension that is too large.
    """
    if name == CEC_2005:
        F12 = import_package("optproblems.cec2005").F12
        if dimension > len(F12.alpha):
            raise ValueError(f"{name} has at most {len(F12.alpha)} dimensions")
        leading = slice(dimension)
        return Instance(
            name,
            np.array(F12.a, dtype=float)[leading, leading],
            np.array(F12.b, dtype=float)[leading, leading],
            np.array(F12.alpha, dtype=float)[leading],
        )
    if not name.startswith(SEEDED):
        raise ValueError(f"unknown instance {name}")
    sequence = np.random.SeedSequence(int(name.removeprefix(SEEDED)), spawn_key=(dimension,))
    generator = np.random.default_rng(sequence)
    a, b = generator.integers(
        -LARGEST_ENTRY, LARGEST_ENTRY, size=(2, dimension, dimension), endpoint=True
    ).astype(float)
    return Instance(name, a, b, generator.uniform(-np.pi, np.pi, dimension))
