"""What is tried for the failed checks of a model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from evopem.automatic.candidates import Candidate, Scorer
from evopem.automatic.noise_beside_plant import NOISE_ORDERS
from evopem.automatic.orders import refine_orders
from evopem.automatic.state_space import fits_in_state_space, fits_of_several_inputs
from evopem.automatic.structures import score_of
from evopem.config.structures import OF_SIMULATION, ORDER_NAMES
from evopem.models.structures import Orders
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import DISTINCT, INSIDE_BOUND

# Poles and zeros that are left out where some cancel, most poles without zeros, and most roots that
# become those of D.
FEWER_ROOTS, MOST_POLES_ALONE, MOST_MOVED = (1, 2, 3, 4, 6, 8), 2, 2
# Larger orders of the same structure that are tried for several channels.
LARGER_ORDERS = 2
# Remedies that are tried in all, of one channel and of several.
MOST_TRIALS, MOST_OF_SEVERAL = 12, 6
# A remedy is taken only if the error for the purpose grows by no more than this share.
TOLERATED = 0.02
DELAY = "Delay"
"""The check that a model has the delays which its residuals ask for."""
LENGTH = "Length of B"
"""The check that the last coefficients of B are significant."""

OrdersOfRemedy = tuple[str, str, Orders]
"""What a remedy is called, and the structure and orders that it tries."""
Remedy = tuple[str, Callable[[Candidate], Candidate | None]]
"""What a remedy is called, and the candidate that it gives beside the best one so far."""


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
OF_ONE_CHANNEL = (
    ((DISTINCT, INSIDE_BOUND, EXCITATION_ADEQUATE), _fewer_roots),
    ((DELAY,), _later),
    ((LENGTH,), _shorter),
    ((WHITE,), _further_noise),
    ((INDEPENDENT_OF_INPUT,), _longer_b),
)


class Remedies:
    """The remedies of failed checks for a record, as many as may be tried.

    ``searched`` are the candidates of the searches over orders, which several channels choose from.
    """

    def __init__(self, scorer: Scorer, searched: Sequence[Candidate], first: Candidate) -> None:
        self.scorer, self.searched = scorer, searched
        self._by_orders = scorer.is_single and first.polynomials is not None
        self._left = MOST_TRIALS if self._by_orders else MOST_OF_SEVERAL

    @property
    def checks(self) -> list[tuple[str, ...]]:
        """Groups of checks that have remedies in common, in the order of trying."""
        if self._by_orders:
            return [checks for checks, _ in OF_ONE_CHANNEL]
        return [(DELAY,), (INSIDE_BOUND,), (WHITE, INDEPENDENT_OF_INPUT)]

    def of(self, checks: tuple[str, ...], current: Candidate) -> Iterator[Remedy]:
        """As many remedies as are left; each one is spent as it is given."""
        for remedy in self._listed(checks, current):
            if self._left == 0:
                return
            self._left -= 1
            yield remedy

    def _listed(self, checks: tuple[str, ...], current: Candidate) -> Iterator[Remedy]:
        if self._by_orders:
            remedies = next(each for group, each in OF_ONE_CHANNEL if set(checks) <= set(group))
            for name, structure, orders in remedies(current):
                yield name, partial(self._of_orders, structure, orders, current)
            return
        if DELAY in checks:
            yield "earlier delays", lambda _: self._with_earlier_delays(current)
        same = [each for each in self.searched if each.structure == current.structure]
        if INSIDE_BOUND in checks:
            for each in [c for c in same if c.order < current.order][-1:]:
                yield "smaller order", partial(self._refined, each)
        if {WHITE, INDEPENDENT_OF_INPUT}.intersection(checks):
            for each in [c for c in same if c.order > current.order][:LARGER_ORDERS]:
                yield "larger order", partial(self._refined, each)
            for each in self._of_other_structures(current):
                yield "other structure", partial(self._refined, each)

    def _of_orders(
        self, structure: str, orders: Orders, current: Candidate, best: Candidate
    ) -> Candidate | None:
        models = [each.polynomials for each in (best, current) if each.polynomials is not None]
        return self.scorer.candidate(structure, orders, models)

    def _refined(self, candidate: Candidate, _: Candidate) -> Candidate:
        scored = candidate if candidate.is_scored else self.scorer.scored(candidate)
        return refine_orders(self.scorer, scored, score_of("prediction"))[-1]

    def _of_other_structures(self, current: Candidate) -> list[Candidate]:
        """The likeliest candidate of each other structure with a noise model."""
        best: dict[str, Candidate] = {}
        for each in sorted(self.searched, key=lambda c: c.bic):
            if each.structure not in (current.structure, *OF_SIMULATION):
                best.setdefault(each.structure, each)
        return list(best.values())

    def _with_earlier_delays(self, current: Candidate) -> Candidate | None:
        scorer = self.scorer
        delays = earlier_delays(scorer, current)
        if current.polynomials is None:
            fits = fits_in_state_space(
                *(scorer.stretches, current.structure, (current.order,), delays, scorer.settings)
            )
        else:
            orders = replace(current.orders, nk=delays)
            fits = fits_of_several_inputs(
                scorer.stretches, {current.order: orders}, scorer.settings
            )
        found = [scorer.described(current.structure, each, current.order) for _, each in fits]
        return replace(scorer.scored(found[0]), delays=delays) if found else None


def earlier_delays(scorer: Scorer, candidate: Candidate) -> tuple[int, ...]:
    """The delays that residuals ask for, within the limits of the configuration."""
    delays = scorer.checks(candidate).earlier_delays
    given = scorer.limits.ranges.nk.of_inputs(scorer.limits.names) if delays else ()
    least = [each[0] if each else 0 for each in given]
    return tuple(map(max, delays, least))
