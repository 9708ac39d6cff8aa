"""The search problem of several stretches with one model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.search.polynomial_problem import DESCENDED, PAIRS, PolynomialProblem
from evopem.estimation.search.staged_descent import Stage, staged_descent
from evopem.estimation.search.starting_polynomials import random_denominators
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# One stage is enough for the quadratic objective, whose corner needs no smoothing.
SWEEP_STAGES = (Stage(0.1, 1e-7, 1e-7),)


class StretchProblem(PolynomialProblem):
    """The search problem of several stretches.

    Parameters
    ----------
    errors : StretchErrors
    models : sequence of PolynomialModel
        Models of other orders from which descents start.
    own_starts : bool
        Whether estimates by linear algebra are among the starts.
    """

    errors: StretchErrors  # type: ignore[assignment]

    def __init__(
        self, errors: StretchErrors, models: Sequence[PolynomialModel] = (), own_starts: bool = True
    ) -> None:
        super().__init__(errors)  # type: ignore[arg-type]
        self._models, self._own_starts = tuple(models), own_starts

    def starts(self) -> Array:
        """Feasible points to descend from, (M, n)."""
        found: list[Array] = []
        if self._own_starts:
            found.append(self._by_linear_algebra()[0])
        for model in self._models:
            found.append(self.completed(self._adapted(model))[0])
            found.append(self._with_further_poles(model))
        points = np.concatenate(found)
        values = self.values(points)
        finite = np.isfinite(values)
        points, values = points[finite], values[finite]
        return points[np.argsort(values, kind="stable")]

    def sweep_descent(self, points: Array, stages: tuple[Stage, ...] = SWEEP_STAGES) -> Descent:
        """One BFGS from each point."""
        largest = float(np.min(self.values(points)))
        return staged_descent(self.errors, points, stages, largest)

    def _adapted(self, model: PolynomialModel) -> Array:
        """A model as points of these orders: coefficients cut off or filled up with zeros."""
        o = self.errors.orders
        same = model.orders == o
        plant = model.plant_denominator[1:]
        noise = model.noise_denominator[1:]
        if same or (o.na and o.single.nf):
            kinds = [{"a": model.a[1:], "f": model.f[1:], "c": model.c[1:], "d": model.d[1:]}]
        elif o.single.nf:
            kinds = [{"f": plant, "c": model.c[1:], "d": noise}, {"f": plant}]
        else:
            by_f = np.convolve(model.c, model.f)[1:]
            kinds = [{"a": plant, "c": by_f, "d": model.d[1:]}, {"a": plant, "c": model.c[1:]}]
        points = np.zeros((len(kinds), self.errors.dimension))
        for point, polynomials in zip(points, kinds, strict=True):
            for name, coefficients in polynomials.items():
                part = self._parts[name]
                kept = coefficients[: part.stop - part.start]
                point[part.start : part.start + len(kept)] = kept
        return points

    def _with_further_poles(self, model: PolynomialModel) -> Array:
        """The best of a model with random further poles, where these orders have more of them."""
        o = self.errors.orders
        name = "f" if o.single.nf else "a"
        more = max(o.single.nf, o.na) - (len(model.plant_denominator) - 1)
        if more <= 0 or o.single.nb == 0 or (o.na and o.single.nf):
            return np.empty((0, self.errors.dimension))
        generator = np.random.default_rng([o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk])
        points = np.repeat(self._adapted(model)[:1], PAIRS, axis=0)
        drawn = random_denominators(PAIRS, more, generator)
        for point, further in zip(points, drawn, strict=True):
            monic = np.concatenate([[1.0], further])
            point[self._parts[name]] = np.convolve(model.plant_denominator, monic)[1:]
        points, _ = self.completed(points)
        best = np.argsort(self.values(points), kind="stable")[:DESCENDED]
        return points[best]

    def _denominators(self) -> Iterator[Array]:
        try:
            yield from super()._denominators()
        except (np.linalg.LinAlgError, ValueError):
            return

    def _errors_of(self, orders: Orders) -> StretchErrors:  # type: ignore[override]
        """The problem of other orders."""
        e = self.errors
        return StretchErrors(
            *(e.stretches, orders, e.objective, e.plant_radius, e.noise_radius, e.level),
            window=e.window.from_first(orders.first_residual),
        )
