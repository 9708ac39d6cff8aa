"""Polynomial models with several inputs that meet hard constraints.

Coordinates are those of one input (:mod:`evopem.estimation.pem.constrained_parameters`), with a
numerator and a denominator for each: restricted poles are shares of their region, and a static gain
determines the mean of B_i.  Descents are those without constraints, in these coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.estimation.constrained_model import numerator_of, plant_polynomial
from evopem.estimation.multi_input.descent import TOLERANCE, descend
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.multi_input.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    MultiInputProblem,
    starting_points,
)
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters, GivenGain
from evopem.estimation.pem.constrained_polynomials import EXCESS, KIND, SHARE, Linear, Sections
from evopem.estimation.search.problem import SearchResult, count_confirming, count_distinct
from evopem.models.polynomials import max_root_radius, reflect_into_disc

Array = NDArray[np.float64]

# Random points that are descended from.
RANDOM_STARTS = 16
# Largest relative distance of a point from the nearest allowed one that is rounding.
MEETS = 1e-9


@dataclass(frozen=True, eq=False)
class ConstrainedOptimum:
    """The optimum under constraints.

    Attributes
    ----------
    result : SearchResult
        Its restarts are the descents; the point is that of :class:`.MultiInputErrors`.
    active : tuple of str
        Inequalities that are active.
    tangent : (n, k) array
        Directions of a point that the active constraints leave free.
    """

    result: SearchResult
    active: tuple[str, ...]
    tangent: Array


def constrained_inputs(
    constraints: Constraints,
    errors: MultiInputErrors,
    names: Sequence[str],
    sampling_rate: float,
) -> ConstrainedParameters:
    """Coordinates of the points that meet constraints, which were checked."""
    o, radius = errors.orders, errors.radius
    paths = [(constraints.of_input(name), o.of_input(k)) for k, name in enumerate(names)]
    units = errors.units
    polynomials: dict[str, Sections | Linear] = {}
    gains: dict[str, GivenGain] = {}
    polynomials["a"] = plant_polynomial("a", *paths[0], sampling_rate, radius)
    for k, (own, orders) in enumerate(paths):
        scale = float(units[o.part("b", k)][0])
        numerator, gain = numerator_of(own, orders, scale, f"f{k}")
        polynomials[f"b{k}"] = numerator
        if gain is not None:
            gains[f"b{k}"] = gain
    for name, order in (("c", o.nc), ("d", o.nd)):
        polynomials[name] = Linear(np.zeros(order), np.eye(order))
    for k, (own, orders) in enumerate(paths):
        polynomials[f"f{k}"] = plant_polynomial("f", own, orders, sampling_rate, radius)
    rest = errors.dimension - o.parameters
    polynomials["rest"] = Linear(np.zeros(rest), np.eye(rest))
    return ConstrainedParameters(polynomials, gains)


class ConstrainedMultiInputErrors(MultiInputErrors):
    """Residuals and Jacobian as functions of the bounded coordinates of :func:`constrained_inputs`.

    A step beyond a bound ends at it.  A coordinate at its bound has no derivative as long as the
    objective falls further outside, so that descents go on along the bound.

    Parameters
    ----------
    errors : MultiInputErrors
    parameters : ConstrainedParameters
    """

    def __init__(self, errors: MultiInputErrors, parameters: ConstrainedParameters) -> None:
        super().__init__(errors.record, errors.orders, errors.radius, errors.objective)
        self.points, self.map = errors, parameters
        codes = parameters.codes
        self._lower = np.where((codes == SHARE) | (codes == EXCESS), 0.0, -np.inf)
        self._upper = np.where(codes == SHARE, 1.0, np.inf)

    def point(self, bounded: Array) -> Array:
        """The point of coordinates."""
        return self.map.point(bounded)[0]

    def residuals(self, point: Array) -> Array:
        """Residuals of coordinates."""
        return self.points.residuals(self.point(point))

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals by the coordinates that are free."""
        found, derivatives = self.map.point(point)
        columns = np.asarray(self.points.jacobian(found) @ derivatives)
        residuals = self.points.residuals(found)
        scores = np.sign(residuals) if self.objective == "absolute" else residuals
        outwards = scores @ columns
        held = (point <= self._lower) & (outwards > 0.0) | (point >= self._upper) & (outwards < 0.0)
        columns[:, held | (self.map.codes == KIND)] = 0.0
        return columns

    def repaired(self, point: Array) -> Array:
        """Coordinates within their bounds, and roots beyond the radius inside."""
        moved = np.clip(np.where(np.isfinite(point), point, 0.0), self._lower, self._upper)
        for name, polynomial in self.map.polynomials.items():
            if not isinstance(polynomial, Linear) or name[0] not in "acdf":
                continue
            own = self.map.own[name]
            if max_root_radius(moved[own]) > self.radius:
                inside = self.radius * (1.0 - 1e-9)
                moved[own] = reflect_into_disc(moved[None, own], inside)[0]
        return moved

    def feasible(self, point: Array) -> bool:
        """Whether all is finite; the coordinates of :meth:`repaired` meet all else."""
        return bool(np.isfinite(point).all())

    @property
    def linear(self) -> NDArray[np.bool_]:
        """Coordinates that the residuals are linear in."""
        return self.map.linear


def constrained_optimum(
    errors: MultiInputErrors,
    parameters: ConstrainedParameters,
    free: SearchResult,
    generator: np.random.Generator,
) -> ConstrainedOptimum:
    """The lowest optimum that meets constraints, from that without them and from other points.

    Parameters
    ----------
    errors : MultiInputErrors
    parameters : ConstrainedParameters
    free : SearchResult
        Without constraints: the result, bit by bit, where it meets them.
    generator : numpy.random.Generator
    """
    bounded = parameters.coordinates(free.point)
    distance = float(np.max(np.abs(free.point - parameters.point(bounded)[0])))
    if distance <= MEETS * float(np.max(np.abs(free.point))):
        active, tangent = parameters.active(parameters.unbounded(bounded, 0.0))
        return ConstrainedOptimum(free, active, tangent)
    own = ConstrainedMultiInputErrors(errors, parameters)
    optima = [
        descend(own, own.completed(start), STEPS, TOLERANCE)
        for start in _starts(errors, parameters, free.point, generator)
    ]
    lowest = min(optima, key=lambda optimum: optimum.value)
    best = descend(own, lowest.point, POLISH_STEPS, POLISH_TOLERANCE)
    if not np.isfinite(best.value):
        raise ValueError("no model that meets the constraints has finite errors")
    values = tuple(optimum.value for optimum in optima if np.isfinite(optimum.value))
    spent = free.diagnostics.evaluations + sum(each.evaluations for each in (*optima, best))
    diagnostics = replace(
        free.diagnostics,
        evaluations=spent,
        restart_minima=(*values, best.value),
        n_confirming=count_confirming(values, best.value),
        n_local_optima=count_distinct(list(values)),
        n_multistart=RANDOM_STARTS,
        convergence=((spent, best.value),),
    )
    active, tangent = parameters.active(parameters.unbounded(best.point, 0.0))
    return ConstrainedOptimum(
        SearchResult(own.point(best.point), best.value, diagnostics), active, tangent
    )


def _starts(
    errors: MultiInputErrors,
    parameters: ConstrainedParameters,
    free: Array,
    generator: np.random.Generator,
) -> list[Array]:
    """Bounded coordinates of the optimum without constraints, of estimates, of random points."""
    points = [free, *starting_points(errors)]
    found = [parameters.unbounded(parameters.coordinates(point)) for point in points]
    random = MultiInputProblem(errors, np.empty((0, errors.dimension)))
    drawn = random.random(RANDOM_STARTS, generator)
    found += [parameters.random(parameters.coordinates(each), generator) for each in drawn]
    return [parameters.bounded(each)[0] for each in found]
