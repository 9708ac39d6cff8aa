"""Covariance of estimated parameters in factored form, with the directions the data do not show.

A matrix alone can give negative variances where the parameters are almost linearly dependent, and
has no entry for a direction of infinite variance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from evopem.arrays import Array, Flags, Indices

NORMAL_95 = 1.959963984540054  # factor of a standard error for a 95 % interval
# A gradient depends on an unidentifiable direction where the terms of their scalar product cancel
# to no less than this share of their sum of magnitudes.  Directions of singular values below 1e-10
# are taken for unidentifiable; rounding, 2e-16, turns each by 2e-6 towards any of tens of others.
CANCELLATION = 1e-4
COMPLEX_STEP = 1e-30  # steps in the imaginary direction have no cancellation


def jacobian_of(function: Callable[[NDArray], Sequence[NDArray]], point: Array) -> Array:
    """Derivatives of all entries of analytic functions, (entries, n), exact to rounding."""
    steps = point + 1j * COMPLEX_STEP * np.eye(len(point))
    columns = [np.concatenate([part.ravel() for part in function(step)]).imag for step in steps]
    return np.array(columns).T / COMPLEX_STEP


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Covariance ``factor @ factor.T`` of parameters, infinite along unidentifiable directions.

    ``factor``, (n, r): a square root of it in the others.  ``null_space``, (n, k): their basis.
    NumPy functions see its :attr:`matrix`.  A Jacobian may have fewer columns: its functions do not
    depend on the last parameters.
    """

    factor: Array
    null_space: Array

    @property
    def matrix(self) -> Array:
        """The covariance matrix, (n, n), as :meth:`of` has it."""
        return self.of(np.eye(len(self.factor)))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray:
        return np.asarray(self.matrix, dtype=dtype)

    def __len__(self) -> int:
        return len(self.factor)

    def part(self, rows: slice | Indices) -> Self:
        """The covariance of some of the parameters."""
        return type(self)(self.factor[rows], self.null_space[rows])

    def through(self, jacobian: Array) -> Self:
        """The covariance of functions with gradients (m, n) to first order, in factored form."""
        n = jacobian.shape[1]
        return type(self)(jacobian @ self.factor[:n], jacobian @ self.null_space[:n])

    def identifiable(self, jacobian: ArrayLike) -> Flags:
        """Whether functions with gradients (m, n) are free of unidentifiable directions, (m,)."""
        gradients = np.asarray(jacobian, dtype=float)
        directions = self.null_space[: gradients.shape[1]]
        magnitude = np.abs(gradients) @ np.abs(directions)
        return np.all(np.abs(gradients @ directions) <= CANCELLATION * magnitude, axis=1)

    def standard_errors(self, jacobian: ArrayLike) -> Array:
        """Standard errors of functions with gradients (m, n) to first order, (m,).

        Infinite where functions depend on an unidentifiable direction, NaN without finite gradient.
        """
        gradients = np.asarray(jacobian, dtype=float)
        defined = np.isfinite(gradients).all(axis=1)
        errors = np.full(len(gradients), np.nan)
        factor = self.factor[: gradients.shape[1]]
        errors[defined] = np.linalg.norm(gradients[defined] @ factor, axis=1)
        errors[defined] = np.where(self.identifiable(gradients[defined]), errors[defined], np.inf)
        return errors

    def of(self, jacobian: ArrayLike) -> Array:
        """Covariance of functions with gradients (m, n) to first order, (m, m).

        Rows and columns of functions that depend on an unidentifiable direction are NaN, and
        infinite on the diagonal; those of functions without a finite gradient are NaN.
        """
        gradients = np.asarray(jacobian, dtype=float)
        defined = np.isfinite(gradients).all(axis=1)
        factor = self.factor[: gradients.shape[1]]
        half = np.where(defined[:, None], gradients, 0.0) @ factor
        covariance: Array = half @ half.T
        infinite = defined & ~self.identifiable(np.where(defined[:, None], gradients, 0.0))
        unknown = infinite | ~defined
        covariance[unknown] = np.nan
        covariance[:, unknown] = np.nan
        covariance[infinite, infinite] = np.inf
        return covariance
