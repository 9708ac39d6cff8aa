"""Descents of one problem of prediction errors, all on one scale of its objective."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.problem import HoppingProblem
from evopem.estimation.search.section_coordinates import descend_in_sections
from evopem.estimation.search.staged_descent import (
    DESCENT_STAGES,
    coarse_descent,
    polish,
    promised_values,
    solve_linear,
    staged_descent,
)
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Random points of a multistart check times samples, at least: shorter records have more optima and
# cheaper descents.
MIN_MULTISTART = 2**17
# Damping of steps and descents from neighbours of an optimum, relative to the scaled diagonal of
# the Gauss-Newton matrix, which is singular where a section is common to all polynomials.
NEIGHBOUR_DAMPING = 1e-3
# Damping of the step from a point with a section that polynomials share exactly: the matrix is
# singular in the directions of the section, where there is no slope either.
COMMON_DAMPING = 1e-6


class DescentProblem(HoppingProblem):
    """What the search problems of ARMAX models and of all others have in common."""

    errors: PolynomialErrors

    @property
    @abstractmethod
    def _largest_value(self) -> float:
        """The scale of the objective, however bad a point is."""

    @cached_property
    def _states(self) -> NDArray[np.bool_]:
        """Which coordinates of a point are states."""
        return self.errors.linear("plant", "noise")

    @property
    def min_multistart(self) -> int:
        """Points of a multistart check."""
        return MIN_MULTISTART // self.errors.samples

    @abstractmethod
    def of_orders(self, orders: Orders) -> Self:
        """The problem of other orders."""

    def lowest_estimates(self, count: int) -> tuple[Array, int]:  # noqa: ARG002
        """The lowest of estimates by linear algebra, (count, n), and their evaluations."""
        return np.empty((0, self.errors.dimension)), 0

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible points inside."""
        return self.errors.repair(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        return staged_descent(self.errors, points, DESCENT_STAGES, self._largest_value)

    def descend_coarsely(self, points: Array) -> Descent:
        """BFGS from each point to near its end."""
        return coarse_descent(self.errors, points, self._largest_value)

    def descend_from_neighbours(self, points: Array) -> Descent:
        """BFGS from points whose Gauss-Newton matrix may be singular."""
        given = points, DESCENT_STAGES, self._largest_value, NEIGHBOUR_DAMPING
        return staged_descent(self.errors, *given)

    def polish(self, points: Array) -> Descent:
        """BFGS with ever less smoothing, each point to its own end; never worse than before."""
        return polish(self.errors, points, self._largest_value, wait=None)

    def descend_in_sections(self, points: Array) -> Descent:
        """Descents along the edge of the stability region; never worse than where they began."""
        return descend_in_sections(self.errors, points, self._largest_value)

    def promised(self, points: Array, value: float) -> Array:
        """Objective that one Gauss-Newton step from each point predicts; inf where meaningless.
        The states are fitted first, in place."""
        solve_linear(self.errors, points, self._states, 1)
        promised = promised_values(self.errors, points, value, self._largest_value, COMMON_DAMPING)
        return np.where(promised > 0.0, promised, np.inf)
