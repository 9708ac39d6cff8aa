"""Orders of the polynomial model ``A y = sum_i (B_i/F_i) u_i q^-nk_i + (C/D) e + level``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any, NamedTuple, Self

from evopem.config.structures import ORDER_NAMES, STRUCTURES, structure_name

PER_INPUT = ("nb", "nf", "nk")  # orders that each input has its own of

Numbers = int | Sequence[int]


class SingleOrders(NamedTuple):
    """Orders of a model with one input, as plain numbers; nb, nf and nk are 0 without an input."""

    na: int
    nb: int
    nc: int
    nd: int
    nf: int
    nk: int


@dataclass(frozen=True, order=True, init=False, kw_only=True)
class Orders:
    """Orders of a polynomial model with any number of inputs, named as by Ljung (1999).

    Attributes
    ----------
    na, nc, nd : int
        Degrees of A, C and D.
    nb, nf, nk : tuple of int
        One entry for each input: coefficients of B_i, the first of which stands at lag nk_i, and
        the degree of F_i.  A number stands for one input; ``nb = 0`` for none.
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`, by default the smallest one that has
        these orders.  It is not compared: an output-error model is also a Box-Jenkins model.

    Examples
    --------
    >>> print(Orders(na=7, nb=6, nc=7, nk=3))
    ARMAX(7,6,7,3)
    >>> print(Orders("bj", nb=4, nf=4, nk=1))
    BJ(4,0,0,4,1)
    >>> print(Orders(na=2, nb=(2, 1), nc=2, nk=(1, 3)))
    ARMAX(2,[2 1],2,[1 3])
    """

    na: int = 0
    nb: tuple[int, ...] = ()
    nc: int = 0
    nd: int = 0
    nf: tuple[int, ...] = ()
    nk: tuple[int, ...] = ()
    structure: str = field(default="", compare=False)

    def __init__(
        self,
        structure: str = "",
        *,
        na: int = 0,
        nb: Numbers = (),
        nc: int = 0,
        nd: int = 0,
        nf: Numbers = 0,
        nk: Numbers = 0,
    ) -> None:
        counts = () if nb == 0 else _entries(nb, 1)
        of_inputs = {name: _entries(n, len(counts)) for name, n in (("nf", nf), ("nk", nk))}
        if not counts and any((*_entries(nf, 1), *_entries(nk, 1))):
            raise ValueError("without an input, nb = 0, nf and nk must be 0")
        if not counts:
            of_inputs = dict.fromkeys(of_inputs, ())
        values = {"na": na, "nb": counts, "nc": nc, "nd": nd} | of_inputs
        for name, value in values.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "structure", structure or self._smallest_structure())
        if len({len(self.nb), len(self.nf), len(self.nk)}) > 1:
            raise ValueError(f"{self}: nb, nf and nk need one entry for each input")
        if min(self.na, self.nc, self.nd, *self.nb, *self.nf, *self.nk) < 0:
            raise ValueError(f"{self} has a negative order")
        if self.nb and min(self.nb) < 1:
            raise ValueError(f"{self}: nb must be at least 1 for each input")
        if self.parameters == 0:
            raise ValueError(f"{self} has no parameter")

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.nb)

    @property
    def single(self) -> SingleOrders:
        """The orders as numbers, of a model with at most one input; ValueError for several."""
        if len(self.nb) > 1:
            raise ValueError(f"{self} has {len(self.nb)} inputs, not one")
        nb, nf, nk = (sum(orders) for orders in (self.nb, self.nf, self.nk))
        return SingleOrders(self.na, nb, self.nc, self.nd, nf, nk)

    def of_input(self, place: int) -> Self:
        """The orders of the path from one input."""
        orders = {name: getattr(self, name)[place : place + 1] for name in PER_INPUT}
        return replace(self, structure="", **orders) if self.inputs else self

    @property
    def parameters(self) -> int:
        """Number of coefficients of all polynomials."""
        return self.na + sum(self.nb) + self.nc + self.nd + sum(self.nf)

    @property
    def noise_states(self) -> int:
        """Length of the noise state, the larger of nc and nd."""
        return max(self.nc, self.nd)

    @property
    def first_residual(self) -> int:
        """Index of the first residual whose past inputs and outputs are measured."""
        return max(self.na, *(nk + nb - 1 for nk, nb in zip(self.nk, self.nb, strict=True)), 0)

    @property
    def plant(self) -> int:
        """The number of poles; without them the largest number of B's coefficients."""
        return self.poles or max(self.nb)

    @property
    def poles(self) -> int:
        """The largest degree of A and F_i."""
        return max((self.na, *self.nf))

    def part(self, letter: str, place: int = 0) -> slice:
        """Where the coefficients of a, c, d, or of b or f of an input, stand in the parameters.

        They are ``[a, b_1 ... b_m, c, d, f_1 ... f_m]``; of an input that is not there it is empty.
        """
        lengths = [self.na, *self.nb, self.nc, self.nd, *self.nf]
        m = self.inputs
        at = {"a": 0, "b": 1 + place, "c": 1 + m, "d": 2 + m, "f": 3 + m + place}[letter]
        first = sum(lengths[:at])
        exists = letter in "acd" or place < m
        return slice(first, first + (lengths[at] if exists else 0))

    def contains(self, smaller: Self) -> bool:
        """Whether every model of other orders is one of these, with zeros added."""
        pairs = zip(self.nb, self.nf, self.nk, smaller.nb, smaller.nf, smaller.nk, strict=False)
        return (
            all(getattr(smaller, name) <= getattr(self, name) for name in ("na", "nc", "nd"))
            and smaller.inputs in (0, self.inputs)
            and all(f <= nf and k >= nk and k + b <= nk + nb for nb, nf, nk, b, f, k in pairs)
        )

    def _smallest_structure(self) -> str:
        used = {name for name in ORDER_NAMES if any(_entries(getattr(self, name), 1))}
        return next(structure for structure, names in STRUCTURES.items() if used <= set(names))

    def __str__(self) -> str:
        texts = []
        for name in STRUCTURES[self.structure]:
            value = getattr(self, name)
            if name in PER_INPUT:
                value = sum(value) if len(value) < 2 else f"[{' '.join(map(str, value))}]"
            texts.append(str(value))
        return f"{structure_name(self.structure)}({','.join(texts)})"


def _entries(numbers: Numbers, count: int) -> tuple[int, ...]:
    return tuple(numbers) if isinstance(numbers, Sequence) else (numbers,) * count


def armax_orders(na: int, nb: int, nc: int, nk: int) -> Orders:
    """Orders of an ARMAX model with one input, as MATLAB's ``armax`` has them."""
    return Orders("armax", na=na, nb=nb, nc=nc, nk=nk)


def orders_of(
    structure: str, orders: Orders | Mapping[str, Any] | Sequence[Any], inputs: int = 1
) -> Orders:
    """Orders of a structure from a mapping of names, or from MATLAB's tuple for that structure.

    Of nb, nf and nk one number for all inputs, or one for each; a mapping may leave out orders that
    are 0.  ValueError when structure and orders do not fit.
    """
    if structure not in STRUCTURES:
        raise ValueError(f"structure must be one of {', '.join(STRUCTURES)}, not {structure!r}")
    if inputs > 1 and "nb" not in STRUCTURES[structure]:
        known = ", ".join(name for name in STRUCTURES if "nb" in STRUCTURES[name])
        raise ValueError(f"with inputs, structure must be one of {known}, not {structure!r}")
    if isinstance(orders, Orders):
        if orders.structure == structure:
            return orders
        inputs = orders.inputs or inputs
        orders = {
            name: order
            for name in ORDER_NAMES
            if (order := getattr(orders, name))
            and (name in STRUCTURES[structure] or name not in PER_INPUT or any(order))
        }
    given: dict[str, Any] = {}
    for name, value in named_orders(structure, orders).items():
        several = isinstance(value, Sequence) and not isinstance(value, str)
        numbers = tuple(value) if several else (value,)
        if any(isinstance(number, bool) or not isinstance(number, Integral) for number in numbers):
            raise ValueError(f"order {name} must be a whole number, not {value!r}")
        if several and name not in PER_INPUT:
            raise ValueError(f"order {name} is one number for all inputs, not {value!r}")
        if several and len(numbers) != inputs:
            raise ValueError(f"{inputs} inputs need {inputs} orders {name}, not {value!r}")
        numbers = tuple(map(int, numbers))
        if name in PER_INPUT:
            given[name] = numbers if several else numbers * inputs
        else:
            given[name] = numbers[0]
    return Orders(structure, **given)


def named_orders(structure: str, orders: Mapping[str, Any] | Sequence[Any]) -> dict[str, Any]:
    """Orders by name, from a mapping or from a sequence in the order of the structure.

    ``structure``: one of ``STRUCTURES``.  ValueError when there are too few or too many, or names
    that the structure does not have.
    """
    names = STRUCTURES[structure]
    if not isinstance(orders, Mapping):
        if not hasattr(orders, "__len__") or len(orders) != len(names):
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


def orders_in_state_space(structure: str, orders: Any) -> dict[str, Any]:
    """The states n, and delays nk where they are given, from a number, a tuple or a mapping."""
    if isinstance(orders, Integral):
        orders = {"n": orders}
    elif isinstance(orders, Sequence) and 0 < len(orders) < 3:
        orders = dict(zip(("n", "nk"), orders, strict=False))
    known = isinstance(orders, Mapping) and not set(orders) - {"n", "nk"}
    if not (known and isinstance(orders.get("n"), Integral)):
        raise ValueError(
            f"structure {structure!r} takes the number of states, or (n, nk) with delays nk of its"
            f" inputs, and not {orders!r}"
        )
    return dict(orders)


def neighbours(o: Orders) -> list[Orders]:
    """Orders of which one, or B and the delay of one input, are a little larger or smaller."""
    near = []
    for place, (nb, nk) in enumerate(zip(o.nb, o.nk, strict=True)):
        changes = [{"nb": 1}, {"nb": 3}, {"nk": 1}]
        changes += [{"nb": -1}, {"nk": 1, "nb": -1}] if nb > 1 else []
        changes += [{"nk": -1, "nb": 1}, {"nk": -1}] if nk > 0 else []
        # Inputs that begin with the same orders may need fewer poles and zeros, each its own.
        surplus = o.inputs > 1 and min(nb, o.nf[place]) > 1
        changes += [{"nf": -1, "nb": -1}] if surplus else []
        near += [changed(o, place, **change) for change in changes]
    for place, name in [(0, "na"), (0, "nc"), (0, "nd"), *((i, "nf") for i in range(o.inputs))]:
        order = o.nf[place] if name == "nf" else getattr(o, name)
        near += [changed(o, place, **{name: 1})] if order else []
        near += [changed(o, place, **{name: -1})] if order > 1 else []
    return near


def changed(orders: Orders, place: int | None = None, **differences: int) -> Orders:
    """Larger or smaller orders, of one input or of all, of the smallest structure that has them."""
    given: dict[str, Any] = {name: getattr(orders, name) for name in ORDER_NAMES}
    for name, difference in differences.items():
        given[name] = (
            tuple(n + difference * (place in (None, i)) for i, n in enumerate(given[name]))
            if name in PER_INPUT
            else given[name] + difference
        )
    return Orders(**given)
