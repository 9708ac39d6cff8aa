"""Orders within limits: estimates of ascending ones, smaller ones of lower BIC, fits of a model.

All have a level for each recording, and descend without the generations of a search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.channels import of_each
from evopem.config.settings import OrderRanges, Range, ScoringWindow, SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.errors import NoModelError
from evopem.estimation.criteria import autoregression_of, limited, log_loss
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import checked_errors, in_scaled_units, scaled_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.polynomials import roots
from evopem.models.structures import PER_INPUT, Orders
from evopem.signals.recording import Recording

Array = NDArray[np.float64]
Log = Callable[[str], None]

# Starts that are descended from on the way to a larger order, and those of a last one.
WIDTH, FINAL_WIDTH = 3, 8
# Orders that all inputs have in common.
SHARED = ("na", "nc", "nd")
# Largest order of the noise that follows the joint order where D stands beside C or A.
MOST_NOISE = 4
# Orders of A of the general structure, whose F_i have the joint order.
SHARED_POLES = 1


@dataclass(frozen=True)
class OrderLimits:
    """Smallest and largest orders, None where free; nb, nf and nk one for each input."""

    na: Range | None
    nc: Range | None
    nd: Range | None
    nb: tuple[Range | None, ...]
    nf: tuple[Range | None, ...]
    nk: tuple[Range | None, ...]

    @classmethod
    def of(cls, ranges: OrderRanges, names: Sequence[str]) -> OrderLimits:
        """The limits that a configuration gives; InputError when it names other inputs."""
        groups = {"nb": "orders", "nf": "orders", "nk": "delay"}
        return cls(
            *(getattr(ranges, name) for name in SHARED),
            *(
                of_each(getattr(ranges, name), names, f"{group}.{name}")
                for name, group in groups.items()
            ),
        )

    def drawn_in(self, orders: Orders) -> Orders:
        """The nearest orders that are allowed, of those that the structure has; delays stay."""
        names = STRUCTURES[orders.structure]
        changed: dict[str, Any] = {
            name: nearest(getattr(orders, name), getattr(self, name))
            for name in SHARED
            if name in names
        }
        for name in ("nb", "nf"):
            if name in names:
                pairs = zip(getattr(orders, name), getattr(self, name), strict=True)
                changed[name] = tuple(nearest(*pair) for pair in pairs)
        return replace(orders, **changed)

    def allow(self, orders: Orders) -> bool:
        """Whether all orders and delays are allowed."""
        return all(
            limits is None or limits[0] <= order <= limits[1]
            for *_, order, limits in self._each(orders)
        )

    def at_upper_ends(self, orders: Orders, inputs: Sequence[str]) -> tuple[str, ...]:
        """The orders that lie at the upper end of a range of several, such as "nb of hot"."""
        return tuple(
            name if place is None else f"{name} of {inputs[place]}"
            for name, place, order, limits in self._each(orders)
            if name != "nk" and limits is not None and limits[0] < limits[1] == order
        )

    @property
    def largest(self) -> int:
        """The largest upper end of the orders that follow the joint order; 0 without any."""
        ends = [self.na, self.nc, self.nd, *self.nb, *self.nf]
        return max((limits[1] for limits in ends if limits), default=0)

    def _each(self, orders: Orders) -> Iterator[tuple[str, int | None, int, Range | None]]:
        """Name, place of the input, order and limits of all orders that the structure has."""
        for name in STRUCTURES[orders.structure]:
            value, limits = getattr(orders, name), getattr(self, name)
            if name not in PER_INPUT:
                yield name, None, value, limits
                continue
            for place, own in enumerate(zip(value, limits, strict=True)):
                yield name, place, *own


def joint_orders(
    structure: str, order: int, delays: Sequence[int], limits: OrderLimits | None = None
) -> Orders:
    """Orders of a structure that one number k determines.

    na = nb = nc = k; of structures with F_i, nb = nf = k.  Where D stands beside C or A, their
    orders are at most :data:`MOST_NOISE`.  What has limits follows k within them.

    Examples
    --------
    >>> print(joint_orders("armax", 3, (1, 2)), joint_orders("bj", 6, (1, 2)))
    ARMAX(3,[3 3],3,[1 2]) BJ([6 6],4,4,[6 6],[1 2])
    >>> limits = OrderLimits.of(OrderRanges(nb={"hot": (1, 2)}, nc=(1, 1)), ("hot", "cold"))
    >>> print(joint_orders("armax", 3, (1, 2), limits))
    ARMAX(3,[2 3],1,[1 2])
    """
    names, nu = STRUCTURES[structure], len(delays)
    noise = min(order, MOST_NOISE) if "nd" in names else order
    shared = SHARED_POLES if structure == "general" else order
    orders = Orders(
        structure,
        nb=(order,) * nu,
        nf=(order if "nf" in names else 0,) * nu,
        nk=tuple(delays),
        na=shared if "na" in names else 0,
        nc=noise if "nc" in names else 0,
        nd=noise if "nd" in names else 0,
    )
    return orders if limits is None else limits.drawn_in(orders)


def nearest(order: int, limits: Range | None) -> int:
    """The order inside limits that is nearest to one."""
    return order if limits is None else min(max(order, limits[0]), limits[1])


def scanned_orders(
    recording: Recording,
    orders: Mapping[int, Orders],
    settings: SearchSettings,
    log: Log | None = None,
) -> Iterator[tuple[int, PolynomialEstimate]]:
    """Estimates of ascending orders, each from linear estimates and from smaller models.

    Scored on the same samples, by the BIC of Laplace's distribution for absolute errors.
    """
    start = orders[max(orders)].first_residual
    smaller: list[PolynomialModel] = []
    for order, wanted in orders.items():
        with one_blas_thread():
            errors = _errors_of(recording, wanted, settings, start)
            scaled, units = scaled_errors(errors)
            found = _descended(scaled, smaller[-2:], WIDTH)
            if found is None:
                continue
            smaller.append(model_of(wanted, found.point))
            result = replace(found, point=units.restored(found.point))
            estimate = _with_bic(describe(errors, result, recording.sampling_rate), errors)
        if log is not None:
            log(f"{wanted}: {estimate.objective:.9g} %")
        yield order, estimate


def refitted(
    model: PolynomialModel, recording: Recording, settings: SearchSettings
) -> PolynomialModel:
    """The optimum of another recording that a descent from a model ends at, or NoModelError."""
    with one_blas_thread():
        errors, found = _refitted(model, recording, settings)
        residuals = errors.residuals(found.point)
        level = found.point[errors.parts()["level"]]
        return model_of(
            model.orders,
            found.point,
            sampling_rate=model.sampling_rate,
            level=float(level[0]),
            noise_variance=float(np.mean(residuals**2)),
        )


def refitted_estimate(
    model: PolynomialModel, recording: Recording, settings: SearchSettings
) -> PolynomialEstimate:
    """The same with criteria, residuals and covariance."""
    with one_blas_thread():
        errors, found = _refitted(model, recording, settings)
        return describe(errors, found, recording.sampling_rate, shortest=True)


def _refitted(
    model: PolynomialModel, recording: Recording, settings: SearchSettings
) -> tuple[PolynomialErrors, SearchResult]:
    errors = _errors_of(recording, model.orders, settings, model.orders.first_residual)
    scaled, units = scaled_errors(errors)
    models = [in_scaled_units(model, units)]
    starts = PolynomialProblem(scaled, models, own_starts=False).starts()[:1]
    if not len(starts):
        raise NoModelError("the descent found no finite errors")
    descents = PolynomialProblem(scaled).descend(starts)
    value = float(descents.values[0])
    diagnostics = SearchDiagnostics.of_descents(value, descents.evaluations, 1)
    return errors, SearchResult(units.restored(descents.points[0]), value, diagnostics)


def reduced_orders(
    recording: Recording,
    orders: Orders,
    settings: SearchSettings,
    limits: OrderLimits | None = None,
    log: Log | None = None,
) -> Orders:
    """Smaller orders of lower BIC within limits, each input its own, and its delay.

    One coefficient of B_i at either end, one of another polynomial, a pole with a zero, or a factor
    of A and all B_i is left out at a time, as long as BIC falls.
    """
    with one_blas_thread():
        errors, _ = scaled_errors(_errors_of(recording, orders, settings, orders.first_residual))
        found = _descended(errors, (), FINAL_WIDTH)
        if found is None:
            return orders
        point, best, falls = found.point, _bic(errors, found.point), True
        while falls:
            falls = False
            for smaller in _smaller(orders):
                if limits is not None and not limits.allow(smaller):
                    continue
                own = errors.of_orders(smaller)
                optimum = _nearest_optimum(own, point, orders)
                bic = np.inf if optimum is None else _bic(own, optimum)
                if optimum is not None and bic < best:
                    best, orders, point, falls = bic, smaller, optimum, True
                    break
    if log is not None:
        log(f"orders of lowest BIC: {orders}")
    return orders


def _errors_of(
    recording: Recording, orders: Orders, settings: SearchSettings, start: int
) -> PolynomialErrors:
    return checked_errors(recording, orders, settings, ScoringWindow(start, start), level=True)


def _descended(
    errors: PolynomialErrors, models: Sequence[PolynomialModel], width: int
) -> SearchResult | None:
    """The lowest optimum from the best estimates and the best starts by models, if any."""
    problem = PolynomialProblem(errors)
    starts = [problem.starts()[:width]]
    if models:
        starts.append(PolynomialProblem(errors, models, own_starts=False).starts()[:width])
    points = np.concatenate(starts)
    if not len(points):
        return None
    descents = problem.descend(points)
    best = int(np.argmin(descents.values))
    value = float(descents.values[best])
    diagnostics = SearchDiagnostics.of_descents(value, descents.evaluations, len(points))
    return SearchResult(descents.points[best], value, diagnostics)


def _bic(errors: PolynomialErrors, point: Array) -> float:
    residuals = errors.residuals(point)
    return log_loss(residuals[:, None], errors.objective) + _penalty(errors)


def _penalty(errors: PolynomialErrors) -> float:
    samples = sum(errors.residual_counts())
    return float(errors.parameters * np.log(samples) / samples)


def _with_bic(estimate: PolynomialEstimate, errors: PolynomialErrors) -> PolynomialEstimate:
    """The estimate with the BIC of its errors, as they are and whitened."""
    residuals = estimate.residuals[np.isfinite(estimate.residuals)]
    bounds = np.concatenate([[0], np.cumsum(errors.residual_counts())]).astype(np.int64)
    columns = residuals[:, None]
    whitened = autoregression_of(
        limited(columns) if errors.objective == "absolute" else columns, bounds
    )
    penalty = _penalty(errors)
    bic = log_loss(residuals[:, None], errors.objective) + penalty
    return replace(
        estimate,
        criteria=replace(estimate.criteria, bic=bic),
        coloured_bic=float(whitened.bic + penalty),
    )


def _nearest_optimum(errors: PolynomialErrors, point: Array, orders: Orders) -> Array | None:
    """The optimum next to a point of neighbouring orders, less a coefficient or a real root."""
    o, base = errors.orders, np.zeros(errors.dimension)
    shorter = []
    for letter, place in [("a", 0), ("c", 0), ("d", 0), *(("f", i) for i in range(o.inputs))]:
        part, coefficients = o.part(letter, place), point[orders.part(letter, place)]
        base[part] = coefficients[: part.stop - part.start]
        if part.stop - part.start == len(coefficients) - 1:
            found = roots(coefficients)
            real = [k for k in range(len(found)) if found[k].imag == 0.0]
            without = [np.atleast_1d(np.real(np.poly(np.delete(found, k))))[1:] for k in real]
            shorter.append([(part, each) for each in (coefficients[:-1], *without)])
    starts = []
    for choice in product(*shorter):
        start = base.copy()
        for part, coefficients in choice:
            start[part] = coefficients
        starts.append(start)
    problem = PolynomialProblem(errors)
    points, _ = problem.completed(np.array(starts))
    values = problem.values(points)
    best = int(np.argmin(values))
    return problem.sweep_descent(points[[best]]).points[0] if np.isfinite(values[best]) else None


def _smaller(orders: Orders) -> Iterator[Orders]:
    """Orders with one coefficient less, or with one pole and one zero less."""
    names = STRUCTURES[orders.structure]
    noise = [name for name in ("nc", "nd") if getattr(orders, name) > 0]
    if orders.na > 0 and min(orders.nb) > 1:
        # A factor of A and all B_i, which C has as well, or 1/D in its place.
        factored = replace(orders, na=orders.na - 1, nb=tuple(nb - 1 for nb in orders.nb))
        if orders.nc > 0:
            yield replace(factored, nc=orders.nc - 1)
        if "nd" in names:
            yield factored
    # A pole that a zero cancels goes with it.
    if len(noise) > 1:
        yield replace(orders, nc=orders.nc - 1, nd=orders.nd - 1)
    for name in noise:
        yield replace(orders, **{name: getattr(orders, name) - 1})
    for i in range(orders.inputs):
        nb, nf, nk = orders.nb[i], orders.nf[i], orders.nk[i]
        fewer_b = _with(orders.nb, i, nb - 1)
        if nf > 0:
            fewer_f = _with(orders.nf, i, nf - 1)
            if nb > 1:
                yield replace(orders, nf=fewer_f, nb=fewer_b)
            yield replace(orders, nf=fewer_f)
        if nb > 1:
            yield replace(orders, nb=fewer_b)
            yield replace(orders, nb=fewer_b, nk=_with(orders.nk, i, nk + 1))
    if "na" in names and orders.na > 0:
        yield replace(orders, na=orders.na - 1)


def _with(values: tuple[int, ...], place: int, value: int) -> tuple[int, ...]:
    return (*values[:place], value, *values[place + 1 :])
