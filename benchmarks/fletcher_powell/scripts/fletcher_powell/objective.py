"""The objective function with a count of every evaluation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fletcher_powell.function import Instance

Array = NDArray[np.float64]

DIFFERENCES = "differences"
ANALYTIC = "analytic"
GRADIENTS = (DIFFERENCES, ANALYTIC)

# A run is successful once it has evaluated a value below this.
TARGET = 1e-6


class RunOver(Exception):  # noqa: N818
    """Raised by the objective to end an algorithm; not an error."""


@dataclass(frozen=True)
class Success:
    """Evaluations until the first value below the target.

    Attributes
    ----------
    evaluations : int
        As the run counts them.
    values, gradients : int
        Values and gradients separately; the count for another cost of a gradient follows from them.
    """

    evaluations: int
    values: int
    gradients: int


class Objective:
    """f with a count of its evaluations, its lowest value, and a budget.

    A value counts one.  A gradient counts n by finite differences and one if it is analytic.  The
    rows of a batch are counted in their order.

    Parameters
    ----------
    instance : Instance
    gradient : {"differences", "analytic"}
    budget : int
        Evaluations after which the run is over.
    until : float
        Value at or below which the run is over earlier.

    Attributes
    ----------
    differences : bool
        Whether gradients are computed by finite differences.
    evaluations, value_count, gradient_count : int
    best : float
        Lowest value within the budget.
    success : Success or None
    improvements : list of (evaluations, best value)
    """

    def __init__(self, instance: Instance, gradient: str, budget: int, until: float = 0.0) -> None:
        if gradient not in GRADIENTS:
            raise ValueError(f"gradient must be one of {GRADIENTS}, not {gradient!r}")
        self.instance = instance
        self.differences = gradient == DIFFERENCES
        self.gradient_cost = instance.dimension if self.differences else 1
        self._with_gradients = (
            instance.values_and_differences if self.differences else instance.values_and_gradients
        )
        self.budget = budget
        self.until = until
        self.evaluations = self.value_count = self.gradient_count = 0
        self.best = np.inf
        self.success: Success | None = None
        self.improvements: list[tuple[int, float]] = []

    @property
    def dimension(self) -> int:
        """Number of coordinates, n."""
        return self.instance.dimension

    def values(self, points: Array) -> Array:
        """f of each row of (M, n) points.

        Raises
        ------
        RunOver
            When the budget is spent or a value has reached ``until``.
        """
        values = self.instance.values(points[: self.budget - self.evaluations])
        self.record(values, gradients=False)
        if len(values) < len(points):
            raise RunOver
        return values

    def values_and_gradients(self, points: Array) -> tuple[Array, Array]:
        """f and its gradient of each row of (M, n) points; raises as :meth:`values` does."""
        values, gradients = self._with_gradients(points)
        self.record(values, gradients=True)
        return values, gradients

    def residuals(self, point: Array) -> Array:
        """The residuals at a point, (n,), whose squares add up to f; count as one value."""
        found = self.instance.residuals(point)
        self.record(np.array([found @ found]), gradients=False)
        return found

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals at a point, (n, n); count as one gradient.

        Raises
        ------
        RunOver
            When the budget is spent.
        """
        self.gradient_count += 1
        self._spend(self.gradient_cost)
        instance = self.instance
        return (instance.jacobian_by_differences if self.differences else instance.jacobian)(point)

    def uncounted(self, points: Array) -> tuple[Array, Array]:
        """f and its gradient of each row, for a caller that counts them by :meth:`record`."""
        return self._with_gradients(points)

    def value(self, point: Array) -> float:
        """f of one point."""
        return float(self.values(np.asarray(point, dtype=float)[None])[0])

    def value_and_gradient(self, point: Array) -> tuple[float, Array]:
        """f and its gradient of one point."""
        values, gradients = self.values_and_gradients(np.asarray(point, dtype=float)[None])
        return float(values[0]), gradients[0]

    def record(self, values: Array, gradients: bool) -> None:
        """Count values in their order, each followed by its gradient if there is one.

        Raises
        ------
        RunOver
            When the budget is spent or a value has reached ``until``.
        """
        cost = 1 + self.gradient_cost if gradients else 1
        affordable = min(len(values), -(-(self.budget - self.evaluations) // cost))
        seen = values[:affordable]
        for row in np.flatnonzero(seen < np.minimum.accumulate(np.append(self.best, seen))[:-1]):
            self._improve(int(row), float(seen[row]), cost)
        self.value_count += affordable
        self.gradient_count += affordable if gradients else 0
        self._spend(affordable * cost)

    def _spend(self, evaluations: int) -> None:
        """Count evaluations; the run is over at its wanted value or its budget."""
        spent = self.evaluations + evaluations
        self.evaluations = min(spent, self.budget)
        if self.best <= self.until or spent >= self.budget:
            raise RunOver

    def _improve(self, row: int, value: float, cost: int) -> None:
        self.best = value
        evaluations = self.evaluations + row * cost + 1
        self.improvements.append((evaluations, value))
        if self.success is None and value < TARGET:
            gradients = row if cost > 1 else 0
            self.success = Success(
                evaluations, self.value_count + row + 1, self.gradient_count + gradients
            )
