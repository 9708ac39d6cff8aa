"""The prediction-error problem of polynomial models with several inputs.

A *point* is ``[a, b_1 ... b_m, c, d, f_1 ... f_m]``, then for each record its level, the states of
all B_i / F_i (nf_i entries each) and the noise state (``max(nc, nd)`` entries), which are what the
unknown past adds to the first equations of

    F_i x_i = -B_i u_i + g_i,    v = A y + sum_i x_i - level,    C e = D v + s.

The residuals are linear in B_i, level and states.  Signals are scaled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.absolute_descent import Places, Weighing, linear_coefficients
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.polynomials import max_root_radius, reflect_into_disc
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Singular values of the linear regressors, their columns scaled to unit length, below this share
# of the largest one are rounding.
RANK = 1e-10


@dataclass(frozen=True, eq=False)
class MultiInputRecord:
    """Scaled signals of one or more records.

    Attributes
    ----------
    inputs : tuple of (N, nu) arrays
        Divided by ``input_scales``.
    outputs : tuple of (N,) arrays
        ``(y - offset) / output_scale``: of unit mean square.
    input_scales : (nu,) array
    output_scale, offset : float
    start : int
        First residual of each record.
    """

    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    input_scales: Array
    output_scale: float
    offset: float
    start: int

    @property
    def samples(self) -> int:
        """Residuals of all records."""
        return sum(len(y) - self.start for y in self.outputs)

    @property
    def bounds(self) -> NDArray[np.int64]:
        """First residual of each record among those of all, and their number, (records + 1,)."""
        lengths = [len(y) - self.start for y in self.outputs]
        return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)


def multi_input_record(
    inputs: Sequence[Array], outputs: Sequence[Array], start: int
) -> MultiInputRecord:
    """Scale records, of (N, nu) inputs and (N,) outputs, whose residuals begin at ``start``."""
    kept = np.concatenate([y[start:] for y in outputs])
    offset = float(kept.mean())
    size = float(np.sqrt(np.mean((kept - offset) ** 2))) or 1.0
    scales = np.sqrt(np.mean(np.concatenate(list(inputs)) ** 2, axis=0))
    scales[scales == 0.0] = 1.0
    return MultiInputRecord(
        tuple(np.asarray(u / scales) for u in inputs),
        tuple((y - offset) / size for y in outputs),
        *(scales, size, offset, start),
    )


class MultiInputErrors:
    """Residuals, their Jacobian, and feasibility of models of some orders on a record.

    Parameters
    ----------
    record : MultiInputRecord
        Whose residuals begin no earlier than those of the orders.
    orders : Orders
    radius : float
        Largest radius of roots of A, C, D and F_i.
    objective : {"quadratic", "absolute"}
    """

    weighing: Weighing = "noise"
    """Of one output there is nothing to weigh."""

    def __init__(
        self,
        record: MultiInputRecord,
        orders: Orders,
        radius: float,
        objective: str = "quadratic",
    ) -> None:
        if orders.first_residual > record.start:
            raise ValueError(f"{orders} has no residuals before sample {orders.first_residual}")
        self.record, self.orders, self.radius = record, orders, radius
        self.objective = objective
        self._own = 1 + sum(orders.nf) + orders.noise_states

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.orders.parameters + self._own * len(self.record.outputs)

    @property
    def parameters(self) -> int:
        """Coefficients and level: what the model has, without states."""
        return self.orders.parameters + 1

    def of_orders(self, orders: Orders) -> MultiInputErrors:
        """The problem of other orders on the same samples."""
        return MultiInputErrors(self.record, orders, self.radius, self.objective)

    @property
    def linear(self) -> NDArray[np.bool_]:
        """Entries of a point that the residuals are linear in: B_i, levels and states."""
        linear = np.zeros(self.dimension, dtype=bool)
        linear[self.orders.parameters :] = True
        for i in range(self.orders.inputs):
            linear[self.orders.part("b", i)] = True
        return linear

    def residuals(self, point: Array) -> Array:
        """Residuals of all records, one after the other, (samples,)."""
        with np.errstate(all="ignore"):
            return np.concatenate(
                [
                    errors.residuals(point[self._places(place)])[self.record.start :]
                    for place, errors in enumerate(self._of_records)
                ]
            )

    def value(self, point: Array) -> float:
        """The objective in percent; infinite where the point is not feasible."""
        if not self.feasible(point):
            return float("inf")
        return self.percent(self.residuals(point))

    def percent(self, residuals: Array) -> float:
        """``100 sum e^2 / sum y^2``, or ``100 sum |e| / sum |y|``, y less its mean."""
        if self.objective == "absolute":
            total = float(np.sum(np.abs(residuals))) / self.mean_absolute
        else:
            total = float(residuals @ residuals)  # the scaled output has unit mean square
        return 100.0 * total / self.record.samples if np.isfinite(total) else float("inf")

    def log_loss(self, value: float) -> float:
        """Minus twice the log-likelihood of a residual, but for a constant, from the objective.

        Of normal residuals, or of Laplace's distribution for the absolute objective.
        """
        scale = self.record.output_scale
        if self.objective == "absolute":
            variance = (value / 100.0 * self.mean_absolute * scale) ** 2
        else:
            variance = value / 100.0 * scale**2
        return float(np.log(variance)) if variance > 0.0 else -np.inf

    def bic(self, value: float) -> float:
        """BIC of a residual from the objective; the level is one of the parameters."""
        samples = self.record.samples
        return float(self.log_loss(value) + self.parameters * np.log(samples) / samples)

    @cached_property
    def mean_absolute(self) -> float:
        """Mean absolute value of the scaled output."""
        start = self.record.start
        return float(np.mean(np.abs(np.concatenate([y[start:] for y in self.record.outputs]))))

    def errors(self, point: Array) -> Array:
        """The residuals of an absolute descent, (samples, 1), over the mean absolute output."""
        return self.residuals(point)[:, None] / self.mean_absolute

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of these errors, by all entries of a point."""
        yield self.jacobian(point) / self.mean_absolute, slice(None)

    def moved(self, point: Array, step: Array) -> Array:
        """The point after a step, with roots beyond the radius drawn in."""
        return self.repaired(point + step)

    def is_stable(self, point: Array) -> bool:  # noqa: ARG002
        """Whether a descent may end at a point: at any that :meth:`moved` gives."""
        return True

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals by a point, (samples, dimension)."""
        jacobian, first = np.zeros((self.record.samples, self.dimension)), 0
        with np.errstate(all="ignore"):
            for place, errors in enumerate(self._of_records):
                at = self._places(place)
                for block in errors.jacobian_blocks(point[at]):
                    jacobian[first : first + len(block), at] = block
                    first += len(block)
        return jacobian

    def feasible(self, point: Array) -> bool:
        """Whether all is finite and all roots lie within the radius."""
        if not np.isfinite(point).all():
            return False
        return self.largest_radius(point) <= self.radius

    def largest_radius(self, point: Array) -> float:
        """Largest radius of the roots of A, C, D and F_i."""
        return max((max_root_radius(point[part]) for part in self._monic), default=0.0)

    def repaired(self, point: Array) -> Array:
        """The point with roots beyond the radius reflected at the unit circle, or drawn in."""
        moved = np.where(np.isfinite(point), point, 0.0)
        for part in self._monic:
            if max_root_radius(moved[part]) > self.radius:
                inside = self.radius * (1.0 - 1e-9)
                moved[part] = reflect_into_disc(moved[None, part], inside)[0]
        return moved

    def completed(self, point: Array) -> Array:
        """A feasible point with the best B_i, levels and states, given A, C, D and F_i.

        Nearly the best ones of the absolute objective.
        """
        linear = self.linear
        found = self.repaired(np.where(linear, 0.0, point))
        columns = self.jacobian(found)[:, linear]
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        remainder = self.residuals(found)
        if np.isfinite(columns).all() and np.isfinite(remainder).all():
            found[linear] = self._linear(columns / size, -remainder) / size
        return found

    def _linear(self, columns: Array, target: Array) -> Array:
        if self.objective == "quadratic":
            return np.asarray(np.linalg.lstsq(columns, target, rcond=RANK)[0])
        left, singular, right = np.linalg.svd(columns, full_matrices=False)
        kept = singular > RANK * singular[0]
        along = linear_coefficients(left[:, kept], target[:, None])[:, 0]
        return np.asarray(right[kept].T @ (along / singular[kept]))

    def model(self, point: Array, sampling_rate: float, noise_variance: float) -> PolynomialModel:
        """The model of a point in the units of the records; its level is their mean."""
        o, record = self.orders, self.record
        weights = np.diff(record.bounds) / record.samples
        levels = point[o.parameters :].reshape(-1, self._own)[:, 0]
        a = point[o.part("a")]
        scaled = np.append(point[: o.parameters], float(weights @ levels))
        parameters = scaled * self.units
        return model_of(
            o,
            parameters[:-1],
            sampling_rate=sampling_rate,
            level=float(parameters[-1]) + record.offset * (1.0 + float(np.sum(a))),
            noise_variance=noise_variance * record.output_scale**2,
        )

    @property
    def units(self) -> Array:
        """Units of coefficients and level, by which scaled ones are multiplied, (parameters,)."""
        units = np.ones(self.parameters)
        for i, scale in enumerate(self.record.input_scales):
            units[self.orders.part("b", i)] = self.record.output_scale / scale
        units[-1] = self.record.output_scale
        return units

    def point_of(self, model: PolynomialModel) -> Array:
        """The feasible point next to a model of any orders, cut off or filled up with zeros."""
        o, other = self.orders, model.orders
        point, parameters = np.zeros(self.dimension), model.parameters
        for letter, places in (("a", 1), ("c", 1), ("d", 1), ("f", o.inputs)):
            for i in range(places):
                into, source = o.part(letter, i), parameters[other.part(letter, i)]
                kept = source[: into.stop - into.start]
                point[into.start : into.start + len(kept)] = kept
        return self.completed(point)

    @property
    def _monic(self) -> list[slice]:
        o = self.orders
        parts = [o.part("a"), o.part("c"), o.part("d"), *(o.part("f", i) for i in range(o.inputs))]
        return [part for part in parts if part.stop > part.start]

    def _own_parts(self, place: int) -> tuple[int, list[slice], slice]:
        """Where a record's level, states of the inputs and noise state stand in a point."""
        at = self.orders.parameters + place * self._own
        edges = at + 1 + np.cumsum([0, *self.orders.nf, self.orders.noise_states])
        parts = [slice(first, stop) for first, stop in pairwise(edges.tolist())]
        return at, parts[:-1], parts[-1]

    def own_parts(self, point: Array) -> tuple[tuple[float, ...], Array, Array]:
        """Level of each record, and the states of all plants and noise filters, in their units."""
        scale, parts = self.record.output_scale, range(len(self.record.outputs))
        own = [self._own_parts(place) for place in parts]
        a = float(np.sum(point[self.orders.part("a")]))
        levels = tuple(scale * point[at] + self.record.offset * (1.0 + a) for at, _, _ in own)
        plants = [point[part] for _, of_inputs, _ in own for part in of_inputs]
        noises = [point[of_noise] for _, _, of_noise in own]
        return levels, scale * np.concatenate(plants), scale * np.concatenate(noises)

    @cached_property
    def _of_records(self) -> list[PolynomialErrors]:
        """The problem of each record alone."""
        start = self.record.start
        return [
            PolynomialErrors(u, y, self.orders, self.objective, start, start, 1.0, 1.0, True)
            for u, y in zip(self.record.inputs, self.record.outputs, strict=True)
        ]

    def _places(self, place: int) -> NDArray[np.intp]:
        """Where the point of a record alone stands in a point."""
        first = self.orders.parameters + place * self._own
        return np.r_[: self.orders.parameters, first : first + self._own]
