"""The orders and structures that remedies of failed checks try."""

from __future__ import annotations

from collections.abc import Iterator

from evopem.automatic.orders import Candidate
from evopem.automatic.trials import DELAY
from evopem.config.structures import ORDER_NAMES
from evopem.models.structures import Orders
from evopem.validation.checks.excitation import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import DISTINCT, INSIDE_BOUND

# Poles and zeros that are left out where some cancel, most poles without zeros, and most roots that
# become those of D.
FEWER_ROOTS, MOST_POLES_ALONE, MOST_MOVED = (1, 2, 3, 4, 6, 8), 2, 2
NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)
LENGTH = "Length of B"
"""The check that the last coefficients of B are significant."""

OrdersOfRemedy = tuple[str, str, Orders]
"""What a remedy is called, and the structure and orders that it tries."""


def _later(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for more in (1, 2, 3):
        if o.single.nb > more:
            changed = {"nk": o.single.nk + more, "nb": o.single.nb - more}
            yield f"delay of {o.single.nk + more}", candidate.structure, _changed(o, **changed)


def _shorter(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for fewer in (1, 2, 3):
        if o.single.nb > fewer:
            yield (
                *(f"{fewer} coefficients of B less", candidate.structure),
                _changed(o, nb=o.single.nb - fewer),
            )


def _fewer_roots(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    name = "nf" if o.single.nf else "na"
    for fewer in FEWER_ROOTS:
        if not (getattr(o.single, name) > fewer and o.single.nb > fewer):
            continue
        changed = {name: getattr(o.single, name) - fewer, "nb": o.single.nb - fewer}
        if name == "na" and fewer <= MOST_MOVED:
            # What A and B have in common belongs to D: A D y = B D u + C e.
            moved = changed | {"nd": o.nd + fewer}
            structure = "ararmax" if o.nc else "ararx"
            yield f"{fewer} common roots of A and B moved to D", structure, _changed(o, **moved)
        yield f"{fewer} pole and zero less", candidate.structure, _changed(o, **changed)
        if fewer <= MOST_POLES_ALONE:
            del changed["nb"]
            yield f"{fewer} pole less", candidate.structure, _changed(o, **changed)


def _further_noise(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for n in NOISE_ORDERS:
        if o.single.nf and n > min(o.nc, o.nd):
            yield f"noise model of order {n}", "bj", _changed(o, nc=n, nd=n)
        elif o.na and n > o.nc:
            structure = "ararmax" if o.nd else "armax"
            yield f"C of order {n}", structure, _changed(o, nc=n)
        elif not o.na and not o.single.nf:
            yield f"A and C of order {n}", "armax", _changed(o, na=n, nc=n)


def _longer_b(candidate: Candidate) -> Iterator[OrdersOfRemedy]:
    o = candidate.orders
    for more in (1, 2, 4, 8):
        yield (
            f"{more} coefficients of B more",
            candidate.structure,
            _changed(o, nb=o.single.nb + more),
        )


def _changed(orders: Orders, **changes: int) -> Orders:
    """Other orders, of the smallest structure that has them."""
    given = {name: getattr(orders.single, name) for name in ORDER_NAMES}
    return Orders(**(given | changes))


# Checks, and what is tried while some of them fail, in this order.
REMEDIES = (
    ((DISTINCT, INSIDE_BOUND, EXCITATION_ADEQUATE), _fewer_roots),
    ((DELAY,), _later),
    ((LENGTH,), _shorter),
    ((WHITE,), _further_noise),
    ((INDEPENDENT_OF_INPUT,), _longer_b),
)
