"""The prediction-error problem of a general polynomial model as the memetic search sees it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.linear_completion import LINEAR_STEPS, solve_linear
from evopem.estimation.search.memetic import discrete_recombination
from evopem.estimation.search.root_recombination import (
    Sections,
    product_of,
    recombined_polynomials,
    sections_of,
)
from evopem.estimation.search.section_coordinates import descend_in_sections
from evopem.estimation.search.section_hopping import (
    COMMON_DAMPING,
    PLACES,
    PREDICTION_DAMPING,
    random_sections,
    section_roots,
    without_nearest_section,
)
from evopem.estimation.search.staged_descent import (
    DESCENT_STAGES,
    coarse_descent,
    polish,
    promised_values,
    staged_descent,
)
from evopem.estimation.search.starting_polynomials import (
    arx_denominator,
    noise_model,
    random_denominators,
    reduced_arx_denominator,
    steiglitz_mcbride,
    subspace_denominator,
)
from evopem.models.polynomials import reflect_into_disc
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Random points of a multistart check times samples, at least.
MIN_MULTISTART = 2**17
# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 4
# Share of the generations that recombine roots; the others recombine coefficients.
BY_ROOTS = 0.75


class PolynomialProblem:
    """Search problem of one record and orders; see :class:`.problem.Problem`.

    The first population holds one or more points of each kind of estimate: ARX, long ARX models
    reduced, Steiglitz-McBride, subspace, the ARMAX optimum, and smaller orders extended.  The rest
    of it, and all later populations, have random poles.

    Parameters
    ----------
    errors : PolynomialErrors
    """

    def __init__(self, errors: PolynomialErrors) -> None:
        self.errors = errors
        self._parts = errors.parts()
        self._drawn = False

    @cached_property
    def _states(self) -> NDArray[np.bool_]:
        """Which coordinates of a point are states."""
        states = np.zeros(self.errors.dimension, dtype=bool)
        for name in ("plant", "noise"):
            states[self._parts[name]] = True
        return states

    @property
    def min_multistart(self) -> int:
        """Points of a multistart check: shorter records have more optima and cheaper descents."""
        return MIN_MULTISTART // self.errors.samples

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._drawn:
            return self._drawn_at_random(count, generator)
        self._drawn = True
        estimates, used = self._estimates
        descents = self.descend(estimates)
        random, more = self._drawn_at_random(max(count - len(estimates), count // 3), generator)
        points = np.concatenate([descents.points, random])
        best = np.argsort(self.values(points), kind="stable")[:count]
        return points[best], used + descents.evaluations + more + len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random A, C, D and F; the rest follows by least squares."""
        return self._drawn_at_random(count, generator)[0]

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible points inside."""
        return self.errors.repair(points)

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        return staged_descent(self.errors, points, DESCENT_STAGES, self._largest_value)

    def descend_coarsely(self, points: Array) -> Descent:
        """BFGS from each point to near its end."""
        return coarse_descent(self.errors, points, self._largest_value)

    def descend_from_neighbours(self, points: Array) -> Descent:
        """BFGS from points whose Gauss-Newton matrix may be singular."""
        return staged_descent(
            self.errors, points, DESCENT_STAGES, self._largest_value, PREDICTION_DAMPING
        )

    def polish(self, points: Array) -> Descent:
        """BFGS with ever less smoothing; never worse than where it began.

        Each point ends where it would end alone.
        """
        return polish(self.errors, points, self._largest_value, wait=None)

    def descend_in_sections(self, points: Array) -> Descent:
        """Descents along the edge of the stability region; never worse than where they began."""
        return descend_in_sections(self.errors, points, self._largest_value)

    def estimates(self) -> Array:
        """Points from estimates of the record, (M, n): the first population before its descent."""
        return self._estimates[0]

    def lowest_estimates(self, count: int) -> tuple[Array, int]:
        """Points of the lowest of the estimates by linear algebra, and their evaluations."""
        points, used = self._by_linear_algebra()
        values = self.values(points)
        lowest = np.argsort(values, kind="stable")[:count]
        return points[lowest[np.isfinite(values[lowest])]], used + len(points)

    def _drawn_at_random(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        points = np.zeros((count, self.errors.dimension))
        for name in "acdf":
            part = self._parts[name]
            order = part.stop - part.start
            if name in "cd":
                points[1:, part] = generator.standard_normal((count - 1, order))
            else:
                points[:, part] = random_denominators(count, order, generator)
        return self.completed(points)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring whose polynomials have sections, or coefficients, from two parents each.

        One draw decides for a whole generation: the two kinds differ in their values, and the worst
        offspring are refined.
        """
        if generator.random() >= BY_ROOTS:
            return discrete_recombination(parents, count, generator)
        pairs = generator.integers(len(parents), size=(2, count))
        offspring = np.zeros((count, parents.shape[1]))
        for name in "acdf":
            part = self._parts[name]
            offspring[:, part] = recombined_polynomials(parents[:, part], pairs, generator)
        return self.completed(offspring)

    def neighbours(
        self,
        point: Array,
        value: float,  # noqa: ARG002 - as of other problems
        count: int,
        generator: np.random.Generator,
    ) -> tuple[Array, int]:
        """The lowest of the points with a section of one or two polynomials elsewhere.

        A section of A or D is moved together with the nearest one of C, or alone.
        """
        moved = []
        for name, beside in (("f", ""), ("a", ""), ("a", "c"), ("d", ""), ("d", "c"), ("c", "")):
            part, other = self._parts[name], self._parts[beside] if beside else None
            if other is not None and other.stop - other.start < 2:
                continue
            found = sections_of(point[part])
            for row, section in enumerate(found.quadratic):
                rest = Sections(np.delete(found.quadratic, row, axis=0), found.single)
                own = np.concatenate([[1.0], product_of(rest)])
                near = (
                    without_nearest_section(point[other], section_roots(section))
                    if other is not None
                    else None
                )
                for factor in random_sections(PLACES, generator):
                    neighbour = point.copy()
                    neighbour[part] = np.convolve(own, factor)[1:]
                    if other is not None and near is not None:
                        neighbour[other] = np.convolve(near, factor)[1:]
                    moved.append(neighbour)
        if not moved:
            return np.empty((0, len(point))), 0
        points, used = self.completed(np.array(moved))
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], used + len(values)

    def promised(self, points: Array, value: float) -> Array:
        """Objective that one Gauss-Newton step from each point predicts; inf where meaningless.

        The states are fitted first, in place.
        """
        solve_linear(self.errors, points, self._states, 1)
        promised = promised_values(self.errors, points, value, self._largest_value, COMMON_DAMPING)
        return np.where(promised > 0.0, promised, np.inf)

    def of_orders(self, orders: Orders) -> Self:
        """The problem of other orders."""
        problem = type(self)(self._errors_of(orders))
        problem._largest_value = self._largest_value
        return problem

    def completed(self, points: Array) -> tuple[Array, int]:
        """Points with B, level and states by least squares, given A, C, D and F; evaluations.

        The roots of infeasible points are moved inside first.
        """
        errors = self.errors
        linear = np.zeros(errors.dimension, dtype=bool)
        for name in ("b", "level", "plant", "noise"):
            linear[self._parts[name]] = True
        points = np.where(linear, 0.0, points)
        points = errors.repair(points)
        if not linear.any():
            return points, 0
        steps = LINEAR_STEPS[errors.objective]
        points = solve_linear(errors, points, linear, steps)
        return points, 4 * steps * len(points)

    @cached_property
    def _largest_value(self) -> float:
        """What the first estimate reaches: the scale of the objective, however bad a point is."""
        values = self.values(self._from_denominators(next(self._denominators()))[0])
        return float(np.min(values)) if np.isfinite(values).any() else 100.0

    @cached_property
    def _estimates(self) -> tuple[Array, int]:
        """Points from estimates of the record, and the evaluations that they took."""
        found = (self._by_linear_algebra(), self._armax_optimum(), self._extended())
        together = np.concatenate([points for points, _ in found])
        finite = np.isfinite(self.values(together))
        return together[finite] if finite.any() else together, sum(used for _, used in found)

    def _by_linear_algebra(self) -> tuple[Array, int]:
        """Points of all denominators by linear algebra, and the evaluations that they took."""
        points, used = [np.empty((0, self.errors.dimension))], 0
        for denominator in self._denominators():
            if np.isfinite(denominator).all():
                found, more = self._from_denominators(denominator)
                points.append(found)
                used += more
        return np.concatenate(points), used

    def _denominators(self) -> Iterator[Array]:
        """Denominators of the plant by linear algebra, (max(na, nf),) each."""
        errors, o = self.errors, self.errors.orders
        u, y, order = errors.input, errors.output, max(o.na, o.single.nf)
        yield arx_denominator(u, y, order, o.single.nb, o.single.nk)
        if order == 0 or o.single.nb == 0:
            return
        # A constant part of the signals is no part of the dynamics that these methods look for.
        u, y = u - np.mean(u), y - np.mean(y)
        yield arx_denominator(u, y, order, o.single.nb, o.single.nk)
        for multiple in (2, 4):
            if (longer := multiple * order) <= len(y) // 10:
                yield reduced_arx_denominator(u, y, order, longer, o.single.nk)
        iterates = list(
            steiglitz_mcbride(u, y, order, o.single.nb, o.single.nk, errors.plant_radius)
        )
        yield from iterates[-1:]
        yield subspace_denominator(u, y, order)

    def _from_denominators(self, denominator: Array) -> tuple[Array, int]:
        """Points with a denominator as F or as A, the noise white and by its own model."""
        o = self.errors.orders
        denominator = reflect_into_disc(denominator[None, :], self.errors.plant_radius)[0]
        plants = []
        for name in "fa":
            part = self._parts[name]
            if part.stop > part.start:
                point = np.zeros(self.errors.dimension)
                order = min(part.stop - part.start, len(denominator))
                point[part][:order] = denominator[:order]
                plants.append(point)
        plants = plants or [np.zeros(self.errors.dimension)]
        white, used = self.completed(np.array(plants))
        if o.nc == 0 and o.nd == 0:
            return white, used
        coloured = white.copy()
        for point in coloured:
            residuals = self.errors.residuals(point)[self.errors.loss_start :]
            point[self._parts["c"]], point[self._parts["d"]] = noise_model(residuals, o.nc, o.nd)
        coloured, more = self.completed(coloured)
        return np.concatenate([white, coloured]), used + more + len(coloured)

    def _armax_optimum(self) -> tuple[Array, int]:
        """The optimum of the ARMAX model with the plant's poles, as a point of these orders."""
        o = self.errors.orders
        if o.single.nf == 0:
            return np.empty((0, self.errors.dimension)), 0
        orders = Orders(na=o.single.nf, nb=o.single.nb, nc=max(o.nc, o.single.nf), nk=o.single.nk)
        problem = type(self)(self._errors_of(orders))
        starts, used = problem._from_denominators(next(problem._denominators()))
        descents = problem.descend(starts)
        best = descents.points[np.argmin(descents.values)]
        point = np.zeros(self.errors.dimension)
        point[self._parts["f"]] = best[problem._parts["a"]]
        # The noise model C/A, as far as it fits.
        c = self._parts["c"]
        point[c] = best[problem._parts["c"]][: c.stop - c.start]
        point[self._parts["d"]][: o.single.nf] = best[problem._parts["a"]][: o.nd]
        same_noise, more = self.completed(point[None, :])
        own_noise, yet_more = self._from_denominators(best[problem._parts["a"]])
        points = np.concatenate([same_noise, own_noise])
        return points, used + descents.evaluations + more + yet_more

    def _extended(self) -> tuple[Array, int]:
        """The optimum of orders smaller by a pair of poles, with the best of some random pairs."""
        nothing = np.empty((0, self.errors.dimension))
        o = self.errors.orders
        name, order = ("f", o.single.nf) if o.single.nf else ("a", o.na)
        if order <= 2 or o.single.nb == 0:
            return nothing, 0
        orders = replace(o, nb=(max(o.single.nb - 2, 1),))
        orders = replace(orders, nf=(order - 2,)) if name == "f" else replace(orders, na=order - 2)
        smaller = type(self)(self._errors_of(orders))
        starts, used = smaller._estimates
        descents = smaller.descend(starts)
        best = descents.points[np.argmin(descents.values)]
        generator = np.random.default_rng([o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk])
        points = np.zeros((PAIRS, self.errors.dimension))
        for part in "acdf":
            into = self._parts[part]
            coefficients = best[smaller._parts[part]]
            points[:, into.start : into.start + len(coefficients)] = coefficients
        monic = np.concatenate([[1.0], best[smaller._parts[name]]])
        for point, pair in zip(points, random_denominators(PAIRS, 2, generator), strict=True):
            point[self._parts[name]] = np.convolve(monic, np.concatenate([[1.0], pair]))[1:]
        points, more = self.completed(points)
        values = self.values(points)
        chosen = points[np.argsort(values, kind="stable")[:DESCENDED]]
        return chosen, used + descents.evaluations + more + PAIRS

    def _errors_of(self, orders: Orders) -> PolynomialErrors:
        """The problem of other orders, whose residuals may have to start later."""
        errors = self.errors
        return PolynomialErrors(
            errors.input,
            errors.output,
            orders,
            errors.objective,
            max(errors.residual_start, orders.first_residual),
            max(errors.loss_start, orders.first_residual),
            errors.plant_radius,
            errors.noise_radius,
            errors.level,
        )
