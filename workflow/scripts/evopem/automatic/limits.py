"""Limits that a configuration sets to the orders that are searched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from evopem.config.settings import OrderRanges, Range
from evopem.config.structures import STRUCTURES, varied_order
from evopem.models.structures import PER_INPUT, Orders


@dataclass(frozen=True)
class OrderLimits:
    """Lowest and highest orders of a search; a structure without an order has no limit of it."""

    structure: str | None = None  # the only structure that may be chosen
    ranges: OrderRanges = field(default_factory=OrderRanges)
    names: tuple[str, ...] = ("input",)  # of the inputs

    def allow(self, structure: str, orders: Orders | None) -> bool:
        """Whether a structure, with orders if it is a polynomial one, may be chosen."""
        if self.structure not in (None, structure):
            return False
        return orders is None or self._clamped(structure, orders) == orders

    def within(self, structure: str, path: Iterable[list[Orders]]) -> Iterator[list[Orders]]:
        """A path of orders moved inside the limits, without repetitions."""
        known: set[Orders] = set()
        for step in path:
            moved = dict.fromkeys(self._clamped(structure, orders) for orders in step)
            new = [orders for orders in moved if orders not in known]
            known.update(new)
            if new:
                yield new

    def _clamped(self, structure: str, orders: Orders) -> Orders:
        given = {name: getattr(orders, name) for name in STRUCTURES["general"]}
        for name in STRUCTURES[structure]:
            if name in PER_INPUT:
                limits = self._of_inputs(structure, name, orders.inputs)
                pairs = zip(given[name], limits, strict=True)
                given[name] = tuple(_nearest(*pair) for pair in pairs)
            else:
                given[name] = _nearest(given[name], self._of_degree(structure, name))
        return Orders(**given)

    def _of_inputs(self, structure: str, name: str, inputs: int) -> tuple[Range | None, ...]:
        names = self.names if len(self.names) == inputs else tuple(map(str, range(inputs)))
        own = getattr(self.ranges, name).of_inputs(names)
        joint = self._of_degree(structure, name) if name == "nf" else None
        return tuple(each or joint for each in own)

    def _of_degree(self, structure: str, name: str) -> Range | None:
        """The limit of a degree; that of the plant follows the joint one."""
        varied = structure != "fir" and name == varied_order("joint", structure)
        own = None if name == "nf" else getattr(self.ranges, name)
        return own or (self.ranges.joint if varied else None)


def _nearest(order: int, limits: Range | None) -> int:
    return order if limits is None else min(max(order, limits[0]), limits[1])
