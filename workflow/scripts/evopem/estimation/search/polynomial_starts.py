"""Points that searches and descents of a polynomial model start from.  They are estimates of the
record (ARX, long ARX models reduced, Steiglitz-McBride, subspace, the ARMAX optimum, smaller orders
extended) and models of other orders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, reduce
from typing import Self

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.descent_problem import DescentProblem
from evopem.estimation.search.polynomials import (
    arx_denominator,
    long_arx_responses,
    noise_model,
    random_denominators,
    reduced_denominator,
    steiglitz_mcbride,
    subspace_denominator,
)
from evopem.estimation.search.staged_descent import (
    LINEAR_STEPS,
    Stage,
    solve_linear,
    staged_descent,
)
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import reflect_into_disc
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 4
# One stage is enough for the quadratic objective, whose corner needs no smoothing.
SWEEP_STAGES = (Stage(0.1, 1e-7, 1e-7),)


class PolynomialStarts(DescentProblem):
    """Starting points of one problem, and descents from them.  ``models``: models of other orders
    that :meth:`starts` begin from.  ``own_starts``: whether estimates by linear algebra are among
    the starts."""

    def __init__(
        self,
        errors: PolynomialErrors,
        models: Sequence[PolynomialModel] = (),
        own_starts: bool = True,
    ) -> None:
        self.errors = errors
        self._parts = errors.parts()
        self._models, self._own_starts = tuple(models), own_starts

    def of_orders(self, orders: Orders) -> Self:
        """The problem of other orders."""
        problem = type(self)(self.errors.of_orders(orders))
        problem._largest_value = self._largest_value
        return problem

    def sweep_descent(self, points: Array, stages: tuple[Stage, ...] = SWEEP_STAGES) -> Descent:
        """One BFGS from each point."""
        largest = float(np.min(self.values(points)))
        return staged_descent(self.errors, points, stages, largest)

    def completed(self, points: Array) -> tuple[Array, int]:
        """Points with B, level and states by least squares, given A, C, D and F; evaluations.  The
        roots of infeasible points are moved inside first."""
        errors = self.errors
        linear = errors.linear("b", "level", "plant", "noise")
        points = errors.repair(np.where(linear, 0.0, points))
        if not linear.any():
            return points, 0
        steps = LINEAR_STEPS[errors.objective]
        points = solve_linear(errors, points, linear, steps)
        return points, 4 * steps * len(points)

    def starts(self) -> Array:
        """Feasible points to descend from, (M, n), the lowest first."""
        found: list[Array] = []
        if self._own_starts:
            found.append(self._by_linear_algebra()[0])
        for model in self._models:
            found.append(self.completed(self.adapted(model))[0])
            found.append(self._with_further_poles(model))
        points = np.concatenate(found)
        values = self.values(points)
        finite = np.isfinite(values)
        points, values = points[finite], values[finite]
        return points[np.argsort(values, kind="stable")]

    def lowest_estimates(self, count: int) -> tuple[Array, int]:
        """Points of the lowest of the estimates by linear algebra, and their evaluations."""
        points, used = self._by_linear_algebra()
        values = self.values(points)
        lowest = np.argsort(values, kind="stable")[:count]
        return points[lowest[np.isfinite(values[lowest])]], used + len(points)

    @cached_property
    def _largest_value(self) -> float:
        """What the first estimate reaches: the scale of the objective, however bad a point is."""
        values = self.values(self._from_denominators(next(self._plants()))[0])
        return float(np.min(values)) if np.isfinite(values).any() else 100.0

    @cached_property
    def estimates(self) -> tuple[Array, int]:
        """Points from estimates of the record, and the evaluations that they took."""
        found = (self._by_linear_algebra(), self._armax_optimum(), self._extended())
        together = np.concatenate([points for points, _ in found])
        finite = np.isfinite(self.values(together))
        return together[finite] if finite.any() else together, sum(used for _, used in found)

    def _by_linear_algebra(self) -> tuple[Array, int]:
        """Points of all denominators by linear algebra, and the evaluations that they took."""
        points, used = [np.empty((0, self.errors.dimension))], 0
        for plant in self._plants():
            if all(np.isfinite(denominator).all() for denominator in plant):
                found, more = self._from_denominators(plant)
                points.append(found)
                used += more
        return np.concatenate(points), used

    def _plants(self) -> Iterator[list[Array]]:
        """Denominators from each input, by linear algebra on the longest stretch.  One for all
        inputs, (max(na, nf_i),), or one for each, (nf_i,)."""
        count = max(self.errors.orders.inputs, 1)
        try:
            for denominator in self._common_denominators():
                yield [denominator] * count
            if count > 1 and any(self.errors.orders.nf):
                yield from self._own_denominators()
        except (np.linalg.LinAlgError, ValueError):
            return

    def _common_denominators(self) -> Iterator[Array]:
        errors, o = self.errors, self.errors.orders
        u, y, order = errors.inputs, errors.output, max(o.na, *o.nf, 0)
        yield arx_denominator(u, y, order, o.nb, o.nk)
        if order == 0 or o.inputs == 0:
            return
        # A constant part of the signals is no part of the dynamics that these methods look for.
        u, y = u - np.mean(u, axis=0), y - np.mean(y)
        yield arx_denominator(u, y, order, o.nb, o.nk)
        for multiple in (2, 4):
            if (longer := multiple * order) <= len(y) // 10:
                responses = long_arx_responses(u, y, longer, o.nk)
                yield (
                    np.zeros(order) if responses is None else reduced_denominator(responses, order)
                )
        yield from list(steiglitz_mcbride(u, y, order, o.nb, o.nk, errors.plant_radius))[-1:]
        yield subspace_denominator(u, y, order)

    def _own_denominators(self) -> Iterator[list[Array]]:
        """F_i of each input alone, from the responses of long ARX models and step by step."""
        errors, o = self.errors, self.errors.orders
        u, y = errors.inputs, errors.output
        u, y = u - np.mean(u, axis=0), y - np.mean(y)
        for multiple in (2, 4, 8):
            longer = multiple * max(o.nf)
            if longer > len(y) // 10:
                continue
            responses = long_arx_responses(u, y, longer, o.nk)
            if responses is None:
                continue
            plant = [
                reduced_denominator(each[None], nf)
                for each, nf in zip(responses, o.nf, strict=True)
            ]
            yield plant
            yield self._one_by_one(u, y, plant)

    def _one_by_one(self, u: Array, y: Array, plant: list[Array]) -> list[Array]:
        """Each F_i by Steiglitz-McBride iterations on what the other inputs leave of the output."""
        from scipy.signal import lfilter

        o, found = self.errors.orders, []
        point = self._from_denominators(plant)[0][0]
        outputs = [
            lfilter(
                np.append(np.zeros(o.nk[i]), point[o.part("b", i)]),
                np.append(1.0, point[o.part("f", i)]),
                u[:, i],
            )
            for i in range(o.inputs)
        ]
        for i, denominator in enumerate(plant):
            rest = y - sum(outputs) + outputs[i]
            given = o.nf[i], o.nb[i : i + 1], o.nk[i : i + 1], self.errors.plant_radius
            steps = list(steiglitz_mcbride(u[:, i : i + 1], rest, *given)) if o.nf[i] else []
            found.append(steps[-1] if steps else denominator)
        return found

    def _from_denominators(self, plant: Sequence[Array]) -> tuple[Array, int]:
        """Points with denominators as F_i or as A, the noise white and by its own model."""
        o = self.errors.orders
        plant = [reflect_into_disc(each[None, :], self.errors.plant_radius)[0] for each in plant]
        points = []
        for name in "fa":
            point = np.zeros(self.errors.dimension)
            places = range(o.inputs) if name == "f" else range(1)
            for part, denominator in zip((o.part(name, i) for i in places), plant, strict=False):
                order = min(part.stop - part.start, len(denominator))
                point[part][:order] = denominator[:order]
            if any(o.nf) if name == "f" else o.na:
                points.append(point)
        points = points or [np.zeros(self.errors.dimension)]
        white, used = self.completed(np.array(points))
        if o.nc == 0 and o.nd == 0:
            return white, used
        coloured = white.copy()
        for point in coloured:
            residuals = self.errors.residuals(point)
            point[self._parts["c"]], point[self._parts["d"]] = noise_model(residuals, o.nc, o.nd)
        coloured, more = self.completed(coloured)
        return np.concatenate([white, coloured]), used + more + len(coloured)

    def _armax_optimum(self) -> tuple[Array, int]:
        """The optimum of the ARMAX model with the plant's poles, as points of these orders."""
        o = self.errors.orders
        if not any(o.nf):
            return np.empty((0, self.errors.dimension)), 0
        poles = max(o.nf)
        orders = Orders(na=poles, nb=o.nb, nc=max(o.nc, poles), nk=o.nk)
        problem = type(self)(self.errors.of_orders(orders))
        starts, used = problem._from_denominators(next(problem._plants()))
        descents = problem.descend(starts)
        best = descents.points[np.argmin(descents.values)]
        a, point = best[problem._parts["a"]], np.zeros(self.errors.dimension)
        for i, nf in enumerate(o.nf):
            point[o.part("f", i)] = a[:nf]
        # The noise model C/A, as far as it fits.
        point[self._parts["c"]] = best[problem._parts["c"]][: o.nc]
        point[self._parts["d"]][:poles] = a[: o.nd]
        same_noise, more = self.completed(point[None, :])
        own_noise, yet_more = self._from_denominators([a] * o.inputs)
        points = np.concatenate([same_noise, own_noise])
        return points, used + descents.evaluations + more + yet_more

    def _extended(self) -> tuple[Array, int]:
        """The optimum of orders smaller by a pair of poles, with the best of some random pairs."""
        o, nothing = self.errors.orders, np.empty((0, self.errors.dimension))
        of_f = any(o.nf)
        if min(o.nf if of_f else (o.na,)) <= 2 or o.inputs == 0:
            return nothing, 0
        orders = replace(o, nb=tuple(max(nb - 2, 1) for nb in o.nb))
        if of_f:
            orders = replace(orders, nf=tuple(nf - 2 for nf in o.nf))
        else:
            orders = replace(orders, na=o.na - 2)
        smaller = type(self)(self.errors.of_orders(orders))
        starts, used = smaller.estimates
        descents = smaller.descend(starts)
        best = descents.points[np.argmin(descents.values)]
        points = np.zeros((PAIRS, self.errors.dimension))
        of_inputs = [("f", i) for i in range(o.inputs)]
        for letter, i in (("a", 0), ("c", 0), ("d", 0), *of_inputs):
            into, coefficients = o.part(letter, i), best[orders.part(letter, i)]
            points[:, into.start : into.start + len(coefficients)] = coefficients
        grown = [
            (o.part(letter, i), np.append(1.0, best[orders.part(letter, i)]))
            for letter, i in (of_inputs if of_f else [("a", 0)])
        ]
        chosen, more = self._best_with_random_roots(points, grown)
        return chosen, used + descents.evaluations + more

    def _best_with_random_roots(
        self, points: Array, grown: Sequence[tuple[slice, Array]]
    ) -> tuple[Array, int]:
        """The lowest points with polynomials, (place, monic), times random ones; evaluations."""
        # The draws of these orders, the same in every search.
        o = self.errors.orders
        nb, nf, nk = (each or (0,) for each in (o.nb, o.nf, o.nk))
        generator = np.random.default_rng([o.na, *nb, o.nc, o.nd, *nf, *nk])
        for part, monic in grown:
            missing = part.stop - part.start - len(monic) + 1
            if missing <= 0:
                continue
            drawn = random_denominators(len(points), missing, generator)
            for point, further in zip(points, drawn, strict=True):
                point[part] = np.convolve(monic, np.append(1.0, further))[1:]
        points, used = self.completed(points)
        best = np.argsort(self.values(points), kind="stable")[:DESCENDED]
        return points[best], used + len(points)

    def adapted(self, model: PolynomialModel) -> Array:
        """A model as points of these orders: coefficients cut off or filled up with zeros."""
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
        return points

    def _with_further_poles(self, model: PolynomialModel) -> Array:
        """The best of a model with random further poles, where these orders have more of them."""
        o = self.errors.orders
        monic = {"a": [model.plant_denominator]}
        if any(o.nf):
            monic = {"f": [np.convolve(model.A, f) for f in model.F]}
        places = [
            (o.part(name, i), each) for name, own in monic.items() for i, each in enumerate(own)
        ]
        missing = [part.stop - part.start - len(each) + 1 for part, each in places]
        if max(missing) <= 0 or o.inputs == 0 or (o.na and any(o.nf)):
            return np.empty((0, self.errors.dimension))
        points = np.repeat(self.adapted(model)[:1], PAIRS, axis=0)
        return self._best_with_random_roots(points, places)[0]
