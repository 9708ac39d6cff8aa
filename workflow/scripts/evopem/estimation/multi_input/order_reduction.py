"""Smaller orders of lower BIC, each input its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from numpy.typing import ArrayLike

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.estimation.multi_input.descent import descend
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.multi_input.order_limits import OrderLimits
from evopem.estimation.multi_input.problem import TOLERANCE, adapted_point
from evopem.estimation.multi_input.records import record_for, records_of
from evopem.estimation.multi_input.search import FINAL_WIDTH, SETTINGS, descents, in_scaled_units
from evopem.models.structures import Orders

Log = Callable[[str], None]

# Steps of a descent after which a model of smaller orders is scored.
REDUCTION_STEPS = 20


@dataclass(frozen=True)
class TriedOrders:
    """Smaller orders that were tried.

    Attributes
    ----------
    orders : Orders
    bic, bic_before : float
        Theirs, and that of the orders which they would replace.
    """

    orders: Orders
    bic: float
    bic_before: float

    @property
    def taken(self) -> bool:
        """Whether BIC fell."""
        return self.bic < self.bic_before


@dataclass(frozen=True)
class ReducedOrders:
    """The orders of lowest BIC, and all that were tried on the way."""

    orders: Orders
    tried: tuple[TriedOrders, ...]


def reduced_orders(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: Orders,
    settings: SearchSettings | None = None,
    limits: OrderLimits | None = None,
    log: Log | None = None,
) -> ReducedOrders:
    """Smaller orders of lower BIC, each input its own, and its delay.

    One coefficient of B_i at either end, one of another polynomial, a pole with a zero, or a factor
    of A and all B_i is left out at a time, as long as BIC falls.  All are scored on the same
    samples.

    Parameters
    ----------
    inputs, output
        As of :func:`.estimate_multi_input`.
    orders : Orders
    settings : SearchSettings, optional
    limits : OrderLimits, optional
        Orders beyond them are not tried.
    log : callable, optional
    """
    settings = settings or SETTINGS
    us, ys = records_of(inputs, output)
    tried: list[TriedOrders] = []
    with one_blas_thread():
        record = record_for(us, ys, orders)
        errors = MultiInputErrors(record, orders, settings.max_root_radius, settings.objective)
        found = descents(errors, [], settings, FINAL_WIDTH)
        if not found:
            return ReducedOrders(orders, ())
        best = errors.bic(found[0].value)
        model = in_scaled_units(errors, found[0].point)
        falls = True
        while falls:
            falls = False
            for smaller in _smaller(orders):
                if limits is not None and not limits.allow(smaller):
                    continue
                own = errors.of_orders(smaller)
                optimum = descend(own, adapted_point(own, model), REDUCTION_STEPS, TOLERANCE)
                bic = own.bic(optimum.value)
                tried.append(TriedOrders(smaller, bic, best))
                if bic < best:
                    best, orders, falls = bic, smaller, True
                    model = in_scaled_units(own, optimum.point)
                    break
    if log is not None:
        log(f"orders of lowest BIC: {orders}")
    return ReducedOrders(orders, tuple(tried))


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
