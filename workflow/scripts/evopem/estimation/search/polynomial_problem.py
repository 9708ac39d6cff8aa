"""The search problem of a polynomial model: where searches and descents of it start from (estimates
of the recording by linear algebra, models of other orders, random poles), and its descents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, reduce
from itertools import islice, product

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search import root_sections
from evopem.estimation.search.linear_estimates import (
    common_denominators,
    noise_model,
    own_denominators,
    slow_denominators,
    steiglitz_mcbride,
)
from evopem.estimation.search.memetic import discrete_recombination
from evopem.estimation.search.problem import SAME_DESCENT, BasinHopping, BasinHoppingProblem
from evopem.estimation.search.staged_descent import (
    DESCENT_STAGES,
    LINEAR_STEPS,
    coarse_descent,
    damped_inverses,
    nearly_dependent,
    polish,
    promised_values,
    sharpened,
    solve_linear,
    staged_descent,
)
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import reflect_into_disc

# Damping of descents from neighbours of an optimum, relative to the scaled diagonal of the
# Gauss-Newton matrix, which is singular where a section is common to all polynomials.
NEIGHBOUR_DAMPING = 1e-3
# Damping of the step from a point with a section that polynomials share exactly: the matrix is
# singular in the directions of the section, where there is no slope either.
COMMON_DAMPING = 1e-6
# How far inside the edge descents begin, and how far above the optimum the lowest of these points
# may be: at most 0.64 in four problems with a lower optimum there, 0.07 to 2.7 in eight without.
# How many descents, how far above it they may end to go on along the edge, and how many of these.
INSIDE, WITHIN, FROM_EDGE, NEAR, CONTINUED = 1e-3, 1.0, 8, 0.01, 2
BY_ROOTS = 0.75  # share of the generations that recombine roots; the others recombine coefficients
# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 4


class PolynomialProblem(BasinHoppingProblem):
    """Search problem of one recording and orders.  ``models``: models of other orders that
    :meth:`starts` begin from; ``own_starts``: whether from estimates by linear algebra too.  The
    first population holds those, descended from; the rest of it, and later ones, random poles."""

    def __init__(
        self,
        errors: PolynomialErrors,
        models: Sequence[PolynomialModel] = (),
        own_starts: bool = True,
    ) -> None:
        self.errors = errors
        self._parts = errors.parts
        self._models, self._own_starts = tuple(models), own_starts
        self._drawn = False

    def of_orders(self, orders: Orders) -> PolynomialProblem:
        """The problem of other orders."""
        problem = PolynomialProblem(self.errors.of_orders(orders))
        problem._largest_value = self._largest_value
        return problem

    @cached_property
    def _largest_value(self) -> float:
        """What the first estimate reaches: the scale of the objective, however bad a point is."""
        values = self.values(self._with_white_noise([next(self._plants())])[0])
        return float(np.min(values)) if np.isfinite(values).any() else 100.0

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible points inside."""
        return self.errors.repair(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        ended = staged_descent(self.errors, points, DESCENT_STAGES, self._largest_value)
        return sharpened(self.errors, ended, self._largest_value)

    def descend_coarsely(self, points: Array) -> Descent:
        """BFGS from each point to near its end."""
        return coarse_descent(self.errors, points, self._largest_value)

    def descend_from_neighbours(self, points: Array) -> Descent:
        """BFGS from points whose Gauss-Newton matrix may be singular."""
        given = points, DESCENT_STAGES, self._largest_value, NEIGHBOUR_DAMPING
        return sharpened(self.errors, staged_descent(self.errors, *given), self._largest_value)

    def polish(self, points: Array) -> Descent:
        """BFGS with ever less smoothing, each point to its own end; never worse than before."""
        return polish(self.errors, points, self._largest_value, wait=None)

    def descend_in_sections(self, points: Array) -> Descent:
        """Descents along the edge of the stability region; never worse than where they began."""
        return root_sections.descend_in_sections(self.errors, points, self._largest_value)

    def from_edge(self, point: Array, value: float, generator: np.random.Generator) -> BasinHopping:
        """The lowest end of descents from an optimum, (n,), with a section of C at the edge, where
        the lowest may lie and descents from random points do not lead (Sargan & Bhargava 1983)."""
        part, radius = self._parts["c"], self.errors.noise_radius * (1.0 - INSIDE)
        polynomials = np.array(list(root_sections.at_radius(radius, point[part], generator)))
        starts = np.repeat(point[None, :], len(polynomials), axis=0)
        starts[:, part] = polynomials
        starts, used = self.completed(starts)
        values = self.values(starts)
        lowest = np.argsort(values, kind="stable")[:FROM_EDGE]
        if not values[lowest[0]] <= (1.0 + WITHIN) * value:
            return BasinHopping(point, value, used + len(starts), [])
        ended = self.descend_from_neighbours(starts[lowest])
        used += len(starts) + ended.evaluations
        order = np.argsort(ended.values, kind="stable")
        above = ended.values[order] / value - 1.0
        near = order[(np.abs(above) > SAME_DESCENT) & (above <= NEAR)][:CONTINUED]
        if not len(near):
            return BasinHopping(point, value, used, [])
        along = self.descend_in_sections(ended.points[near])
        best, used = int(np.argmin(along.values)), used + along.evaluations
        return BasinHopping(along.points[best], float(along.values[best]), used, [])

    def with_exchanged_poles(self, point: Array) -> tuple[Array, int]:
        """Points with sections of A, D and F exchanged, and evaluations: random points may all lead
        to where poles of the noise stand in the plant."""
        parts = [part for name, part in self.errors.polynomials if name != "c"]
        starts = list(root_sections.with_exchanged_sections(point, parts))
        return self.completed(np.array(starts)) if starts else (np.empty((0, len(point))), 0)

    def promised(self, points: Array, value: float) -> Array:
        """Objective that one Gauss-Newton step from each point predicts; inf where meaningless.
        The states are fitted first, in place."""
        solve_linear(self.errors, points, self.errors.linear("plant", "noise"), 1)
        promised = promised_values(self.errors, points, value, self._largest_value, COMMON_DAMPING)
        return np.where(promised > 0.0, promised, np.inf)

    def completed(self, points: Array, alone: bool = False) -> tuple[Array, int]:
        """Points with B, level and states by least squares, given A, C, D and F; evaluations.  The
        roots of infeasible points are moved inside first; ``alone`` as of :func:`solve_linear`."""
        errors = self.errors
        linear = errors.linear("b", "level", "plant", "noise")
        points = errors.repair(np.where(linear, 0.0, points))
        if not linear.any():
            return points, 0
        steps = LINEAR_STEPS[errors.objective]
        points = solve_linear(errors, points, linear, steps, alone)
        return points, 4 * steps * len(points)

    def starts(self) -> Array:
        """Feasible points to descend from, (M, n), the lowest first; one where none ends lower."""
        fresh, lone = self._own_starts, self._own_starts and self._plants_of_one_optimum()
        begins = [self._of_plants(lone)[0] if lone else self.estimates[0]] if fresh else []
        for model in () if lone else self._models:
            adapted = self.adapted(model)
            begins.append(self.completed(adapted)[0])
            nested = self.errors.orders.contains(model.orders)
            if nested and self._is_lost_in_products(begins[-1]):
                begins.append(self.errors.repair(self.errors.completed_by_states(adapted[0])[None]))
            begins.append(self._with_further_poles(model))
        points = np.concatenate(begins)
        values = self.values(points)
        order = np.argsort(values, kind="stable")
        return points[order[np.isfinite(values[order])]]

    def _plants_of_one_optimum(self) -> list[list[Array]]:
        """The ARX denominator, where least squares give the only optimum; or nothing."""
        o, radius = self.errors.orders, self.errors.plant_radius
        quadratic = self.errors.objective == "quadratic" and not (o.nc or o.nd or any(o.nf))
        plants = list(islice(self._plants(), int(quadratic)))
        return [p for p in plants if np.abs(np.roots([1.0, *p[0]])).max(initial=0.0) < radius]

    def _is_lost_in_products(self, points: Array) -> bool:
        """Whether B and states of a point may be: columns of finely sampled poles hardly differ."""
        states = self.errors.linear("b", "plant")
        if not any(self.errors.orders.nf) or not states.any():
            return False
        matrices = self.errors.curvatures_of(points, np.ones(len(points)), states)
        return bool(nearly_dependent(matrices, damped_inverses(matrices)).any())

    def lowest_estimates(self, count: int, slow: bool = False) -> tuple[Array, int]:
        """Points of the lowest of the estimates, or those of slow poles, and their evaluations."""
        points, used = self.estimates
        if slow:
            inputs = max(self.errors.orders.inputs, 1)
            points, used = self._of_plants([p] * inputs for p in slow_denominators(self.errors))
        values = self.values(points)
        lowest = np.argsort(values, kind="stable")[:count]
        return points[lowest[np.isfinite(values[lowest])]], used + len(points)

    @cached_property
    def estimates(self) -> tuple[Array, int]:
        """Points of all denominators by linear algebra, and the evaluations that they took."""
        return self._of_plants(self._plants())

    def _of_plants(self, plants: Iterable[list[Array]]) -> tuple[Array, int]:
        finite = [plant for plant in plants if np.isfinite(np.concatenate(plant)).all()]
        none = np.empty((0, self.errors.dimension)), 0
        return self._from_denominators(finite) if finite else none

    def _plants(self) -> Iterator[list[Array]]:
        """Denominators from each input, by linear algebra on the longest stretch.  One for all
        inputs, (max(na, nf_i),), or one for each, (nf_i,)."""
        count = max(self.errors.orders.inputs, 1)
        try:
            for denominator in common_denominators(self.errors):
                yield [denominator] * count
            if count > 1 and any(self.errors.orders.nf):
                for plant in own_denominators(self.errors):
                    yield plant
                    yield self._one_by_one(plant)
        except (np.linalg.LinAlgError, ValueError):
            return

    def _one_by_one(self, plant: list[Array]) -> list[Array]:
        """Each F_i by Steiglitz-McBride iterations on what the other inputs leave of the output."""
        o, points = self.errors.orders, []
        u, y = self.errors.inputs, self.errors.output
        u, y = u - np.mean(u, axis=0), y - np.mean(y)
        point = self._from_denominators([plant])[0][0]
        outputs = []
        for i in range(o.inputs):
            b, f = point[o.part("b", i)], point[o.part("f", i)]
            delayed = np.append(np.zeros(o.nk[i]), b)
            outputs.append(scipy.signal.lfilter(delayed, np.append(1.0, f), u[:, i]))
        for i, denominator in enumerate(plant):
            rest = y - sum(outputs) + outputs[i]
            given = o.nf[i], o.nb[i : i + 1], o.nk[i : i + 1], self.errors.plant_radius
            steps = list(steiglitz_mcbride(u[:, i : i + 1], rest, *given)) if o.nf[i] else []
            points.append(steps[-1] if steps else denominator)
        return points

    def _from_denominators(self, plants: Sequence[list[Array]]) -> tuple[Array, int]:
        """Points with denominators as F_i or as A, the noise white and by its own model."""
        o = self.errors.orders
        white, used = self._with_white_noise(plants)
        if o.nc == 0 and o.nd == 0:
            return white, used
        coloured = white.copy()
        for point in coloured:
            residuals = self.errors.residuals(point)
            point[self._parts["c"]], point[self._parts["d"]] = noise_model(residuals, o.nc, o.nd)
        coloured, more = self.completed(coloured, alone=True)
        of_plants = [part.reshape(len(plants), -1, part.shape[1]) for part in (white, coloured)]
        points = np.concatenate(of_plants, axis=1).reshape(-1, white.shape[1])
        return points, used + more + len(coloured)

    def _with_white_noise(self, plants: Sequence[list[Array]]) -> tuple[Array, int]:
        """Points with denominators as F_i or as A, as many of each plant."""
        o, radius = self.errors.orders, self.errors.plant_radius
        letters = [letter for letter, n in (("f", o.nf), ("a", (o.na,))) if any(n)] or ["a"]
        points = np.zeros((len(plants) * len(letters), self.errors.dimension))
        for point, (plant, letter) in zip(points, product(plants, letters), strict=True):
            for i, denominator in enumerate(plant if letter == "f" else plant[:1]):
                part = o.part(letter, i)
                kept = reflect_into_disc(denominator[None], radius)[0, : part.stop - part.start]
                point[part.start : part.start + len(kept)] = kept
        return self.completed(points, alone=True)

    def adapted(self, model: PolynomialModel) -> Array:
        """A model as points of these orders: coefficients cut off or filled up with zeros, B only
        where its orders are contained in these."""
        o, of_inputs = self.errors.orders, range(self.errors.orders.inputs)
        plants = [np.convolve(model.A, f) for f in model.F]
        kinds: list[dict[str, list[Array]]]
        if model.orders == o or (o.na and any(o.nf)):
            kinds = [{"a": [model.A], "f": list(model.F), "c": [model.C], "d": [model.D]}]
        elif any(o.nf):
            kinds = [{"f": plants, "c": [model.C], "d": [model.noise_denominator]}, {"f": plants}]
        else:
            a, by_f = [model.plant_denominator], reduce(np.convolve, model.F, model.C)
            kinds = [{"a": a, "c": [by_f], "d": [model.D]}, {"a": a, "c": [model.C]}]
        points = np.zeros((len(kinds), self.errors.dimension))
        for point, polynomials in zip(points, kinds, strict=True):
            for name, monic in polynomials.items():
                for i in of_inputs if name == "f" else range(1):
                    part = o.part(name, i)
                    kept = monic[i][1 : part.stop - part.start + 1]
                    point[part.start : part.start + len(kept)] = kept
            for i, b in enumerate(model.B if o.contains(model.orders) else ()):
                first = o.part("b", i).start + model.nk[i] - o.nk[i]
                point[first : first + len(b)] = b
        return points

    def _with_further_poles(self, model: PolynomialModel) -> Array:
        """The best of a model with random further poles, where these orders have more of them."""
        o = self.errors.orders
        monic = {"a": [model.plant_denominator]}
        if any(o.nf):
            monic = {"f": [np.convolve(model.A, f) for f in model.F]}
        grown = [(o.part(name, i), c) for name, known in monic.items() for i, c in enumerate(known)]
        missing = [part.stop - part.start - len(coefficients) + 1 for part, coefficients in grown]
        if max(missing) <= 0 or o.inputs == 0 or (o.na and any(o.nf)):
            return np.empty((0, self.errors.dimension))
        points = np.repeat(self.adapted(model)[:1], PAIRS, axis=0)
        # The draws of these orders, the same in every search.
        nb, nf, nk = (orders or (0,) for orders in (o.nb, o.nf, o.nk))
        generator = np.random.default_rng([o.na, *nb, o.nc, o.nd, *nf, *nk])
        for (part, known), more in zip(grown, missing, strict=True):
            drawn = root_sections.random_denominators(PAIRS, max(more, 0), generator)
            for point, further in zip(points, drawn, strict=True):
                if more > 0:
                    point[part] = np.convolve(known, np.append(1.0, further))[1:]
        points, _ = self.completed(points)
        return points[np.argsort(self.values(points), kind="stable")[:DESCENDED]]

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._drawn:
            return self.spread(count, generator)
        self._drawn = True
        estimates, used = self.estimates
        descents = self.descend(estimates)
        random, more = self.spread(max(count - len(estimates), count // 3), generator)
        points = np.concatenate([descents.points, random])
        best = np.argsort(self.values(points), kind="stable")[:count]
        return points[best], used + descents.evaluations + more + len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random A, C, D and F; the rest follows by least squares.  A of
        ARMAX models is that of the ARX model, from where descents are short (chapter section 4)."""
        of_armax = self.errors.orders.structure == "armax"
        a = next(common_denominators(self.errors)) if of_armax else None
        return self.spread(count, generator, a)[0]

    def spread(
        self, count: int, generator: np.random.Generator, a: Array | None = None
    ) -> tuple[Array, int]:
        """Such points with one A or random ones, and the evaluations that they took."""
        points = np.zeros((count, self.errors.dimension))
        for name, part in self.errors.polynomials:
            order = part.stop - part.start
            if name in "cd":
                points[1:, part] = generator.standard_normal((count - 1, order))
            elif name == "a" and a is not None:
                points[:, part] = a
            else:
                points[:, part] = root_sections.random_denominators(count, order, generator)
        return self.completed(points)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring whose polynomials have sections, or coefficients, from two parents each.  One
        draw decides for a whole generation: the two kinds differ in their values, and the worst
        offspring are refined."""
        if generator.random() >= BY_ROOTS:
            return discrete_recombination(parents, count, generator)
        pairs = generator.integers(len(parents), size=(2, count))
        offspring = np.zeros((count, parents.shape[1]))
        for _, part in self.errors.polynomials:
            offspring[:, part] = root_sections.recombined_polynomials(
                parents[:, part], pairs, generator
            )
        return self.completed(offspring)

    def neighbours(
        self, point: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The lowest of the points with a section of one or two polynomials elsewhere.  A section
        of A or D is moved together with the nearest one of C, or alone."""
        a, c, d = (self._parts[name] for name in "acd")
        places: list[tuple[slice, list[tuple[str, slice]]]] = [
            (part, []) for name, part in self.errors.polynomials if name == "f"
        ]
        for part in (a, d):
            places += [(part, []), (part, [("c", c)])] if c.stop - c.start >= 2 else [(part, [])]
        moved = []
        for part, others in [*places, (c, [])]:
            moved += root_sections.with_moved_section(point, part, others, generator)
        if not moved:
            return np.empty((0, len(point))), 0
        points, used = self.completed(np.array(moved))
        values = self.values(points)
        return points[np.argsort(values, kind="stable")[:count]], used + len(values)
