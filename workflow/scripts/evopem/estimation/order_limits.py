"""Limits of the orders of polynomial models with several inputs, and orders within them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from evopem.config.settings import OrderRanges, Range
from evopem.config.structures import STRUCTURES
from evopem.models.structures import PER_INPUT, Orders

SHARED = ("na", "nc", "nd")
"""Orders that all inputs have in common."""

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
                getattr(ranges, name).of_inputs(names, f"{group}.{name}")
                for name, group in groups.items()
            ),
        )

    def drawn_in(self, orders: Orders) -> Orders:
        """The nearest orders that are allowed, of those that the structure has; delays stay."""
        names = STRUCTURES[orders.structure]
        changed: dict[str, Any] = {
            name: _nearest(getattr(orders, name), getattr(self, name))
            for name in SHARED
            if name in names
        }
        for name in ("nb", "nf"):
            if name in names:
                pairs = zip(getattr(orders, name), getattr(self, name), strict=True)
                changed[name] = tuple(_nearest(*pair) for pair in pairs)
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
    >>> from evopem.config.settings import InputRanges
    >>> nb = InputRanges(by_name={"hot": (1, 2)})
    >>> limits = OrderLimits.of(OrderRanges(nb=nb, nc=(1, 1)), ("hot", "cold"))
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


def _nearest(order: int, limits: Range | None) -> int:
    return order if limits is None else min(max(order, limits[0]), limits[1])
