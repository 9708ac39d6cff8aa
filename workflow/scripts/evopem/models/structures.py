"""Orders of the general polynomial model ``A y = (B/F) u q^-nk + (C/D) e``, and its structures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any

from evopem.config.structures import ORDER_NAMES, STRUCTURES, structure_name


@dataclass(frozen=True, order=True)
class PolynomialOrders:
    """Orders of a general polynomial model, named as by Ljung (1999).

    ``na``, ``nc``, ``nd`` and ``nf`` are the degrees of A, C, D and F; ``nb`` is the number of
    coefficients of B, the first of which stands at lag ``nk``.  A model without input has
    ``nb = 0``.

    ``structure`` is a key of :data:`evopem.config.structures.STRUCTURES`, by default the smallest
    one that has these orders.  It has no part in comparisons: an output-error model is also a
    Box-Jenkins model.

    Examples
    --------
    >>> print(PolynomialOrders(na=7, nb=6, nc=7, nk=3))
    ARMAX(7,6,7,3)
    >>> print(PolynomialOrders(nb=4, nf=4, nk=1))
    OE(4,4,1)
    >>> print(PolynomialOrders(nb=4, nf=4, nk=1, structure="bj"))
    BJ(4,0,0,4,1)
    """

    na: int = 0
    nb: int = 0
    nc: int = 0
    nd: int = 0
    nf: int = 0
    nk: int = 0
    structure: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "structure", self.structure or self._smallest_structure())
        if min(self.na, self.nb, self.nc, self.nd, self.nf, self.nk) < 0:
            raise ValueError(f"{self} has a negative order")
        if self.nb == 0 and (self.nf or self.nk):
            raise ValueError(f"{self} has nb = 0: without an input nf and nk must be 0")
        if self.parameters == 0:
            raise ValueError(f"{self} has no parameter")

    @property
    def parameters(self) -> int:
        """Number of coefficients, na + nb + nc + nd + nf."""
        return self.na + self.nb + self.nc + self.nd + self.nf

    @property
    def noise_states(self) -> int:
        """Length of the noise state, the larger of nc and nd."""
        return max(self.nc, self.nd)

    @property
    def first_residual(self) -> int:
        """Index of the first residual whose past inputs and outputs are measured."""
        return max(self.na, self.nk + self.nb - 1, 0)

    def contains(self, other: PolynomialOrders) -> bool:
        """Whether every model of other orders is one of these, with zeros added."""
        return (
            all(getattr(other, name) <= getattr(self, name) for name in ("na", "nc", "nd", "nf"))
            and (other.nb == 0 or other.nk >= self.nk)
            and (other.nb == 0 or other.nk + other.nb <= self.nk + self.nb)
        )

    def _smallest_structure(self) -> str:
        return next(
            name
            for name, names in STRUCTURES.items()
            if all(getattr(self, order) == 0 for order in ORDER_NAMES if order not in names)
        )

    def __str__(self) -> str:
        orders = ",".join(str(getattr(self, name)) for name in STRUCTURES[self.structure])
        return f"{structure_name(self.structure)}({orders})"


def armax_orders(na: int, nb: int, nc: int, nk: int) -> PolynomialOrders:
    """Orders of an ARMAX model, as MATLAB's ``armax`` has them."""
    return PolynomialOrders(na=na, nb=nb, nc=nc, nk=nk, structure="armax")


def orders_of(
    structure: str, orders: PolynomialOrders | Mapping[str, int] | Sequence[int]
) -> PolynomialOrders:
    """Orders of a structure from a mapping of names, or from MATLAB's tuple for that structure.

    Parameters
    ----------
    structure : str
        A key of :data:`STRUCTURES`.
    orders : PolynomialOrders, mapping or sequence of int
        A mapping may leave out orders that are 0.

    Raises
    ------
    ValueError
        When the structure is not known, or does not have an order that is given.

    Examples
    --------
    >>> orders_of("oe", (4, 3, 1)) == orders_of("oe", {"nb": 4, "nf": 3, "nk": 1})
    True
    >>> orders_of("bj", {"nb": 2, "nf": 2, "nd": 1}).structure
    'bj'
    """
    if structure not in STRUCTURES:
        raise ValueError(f"structure must be one of {', '.join(STRUCTURES)}, not {structure!r}")
    if isinstance(orders, PolynomialOrders):
        orders = {name: getattr(orders, name) for name in ORDER_NAMES if getattr(orders, name)}
    given = named_orders(structure, orders)
    for name, order in given.items():
        if isinstance(order, bool) or not isinstance(order, Integral):
            raise ValueError(f"order {name} must be a whole number, not {order!r}")
    return PolynomialOrders(
        **{name: int(order) for name, order in given.items()}, structure=structure
    )


def named_orders(structure: str, orders: Mapping[str, Any] | Sequence[Any]) -> dict[str, Any]:
    """Orders by name, from a mapping or from a sequence in the order of the structure.

    Parameters
    ----------
    structure : str
        One of ``STRUCTURES``.
    orders : mapping or sequence

    Raises
    ------
    ValueError
        When there are too few or too many, or names that the structure does not have.
    """
    names = STRUCTURES[structure]
    if not isinstance(orders, Mapping):
        if len(orders) != len(names):
            raise ValueError(
                f"structure {structure!r} takes the orders ({', '.join(names)}), not {orders!r}"
            )
        return dict(zip(names, orders, strict=True))
    unknown = sorted(set(orders) - set(names))
    if unknown:
        raise ValueError(
            f"structure {structure!r} has the orders {', '.join(names)}, not {', '.join(unknown)}"
        )
    return dict(orders)
