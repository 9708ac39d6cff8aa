"""Limits that a configuration sets to the orders that are searched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from evopem.config.settings import AutomaticSettings, Range
from evopem.config.structures import ORDER_NAMES, STRUCTURES, varied_order
from evopem.models.structures import Orders


@dataclass(frozen=True)
class OrderLimits:
    """Lowest and highest orders of a search; None where there is no limit.

    ``joint`` is the degree of A or F.  A structure without an order has no limit of it.
    """

    structure: str | None = None  # the only structure that may be chosen
    nk: Range | None = None
    joint: Range | None = None
    nc: Range | None = None
    nd: Range | None = None
    nb: Range | None = None

    @classmethod
    def of_search(cls, settings: AutomaticSettings) -> OrderLimits:
        """The limits of the search of any structure."""
        own = settings.orders
        return cls(None, own.nk.all, own.joint, own.nc, own.nd, own.nb.all)

    @classmethod
    def of_choice(cls, settings: AutomaticSettings) -> OrderLimits:
        """The limits of the model that is chosen."""
        own = cls.of_search(settings)
        return cls(settings.structure, own.nk, own.joint, own.nc, own.nd, own.nb)

    def allow(self, structure: str, orders: Orders) -> bool:
        """Whether orders of a structure may be chosen."""
        if self.structure not in (None, structure):
            return False
        return self._clamped(structure, orders) == orders

    def within(self, structure: str, path: Iterable[list[Orders]]) -> Iterator[list[Orders]]:
        """A path of orders moved inside the limits, without repetitions."""
        known: set[Orders] = set()
        for step in path:
            moved = dict.fromkeys(self._clamped(structure, orders) for orders in step)
            own = [orders for orders in moved if orders not in known]
            known.update(own)
            if own:
                yield own

    def _clamped(self, structure: str, orders: Orders) -> Orders:
        given = {name: getattr(orders.single, name) for name in ORDER_NAMES}
        for name, limit in self._by_order(structure).items():
            if limit is not None and name in STRUCTURES[structure]:
                given[name] = min(max(given[name], limit[0]), limit[1])
        return Orders(**given)

    def _by_order(self, structure: str) -> dict[str, Range | None]:
        own = {"nk": self.nk, "nc": self.nc, "nd": self.nd, "nb": self.nb}
        return own if structure == "fir" else own | {varied_order("joint", structure): self.joint}
