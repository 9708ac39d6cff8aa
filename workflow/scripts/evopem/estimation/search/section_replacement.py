"""Order extension and section replacement: more orders than needed have an optimum for
nearly every choice of places of spare sections.  A search adds sections where they may explain most
(:mod:`.section_gains`), then removes one of an optimum and adds one at another place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import BasinHopping, converged_values, same_optimum
from evopem.estimation.search.root_sections import each_without, random_sections, without_nearest_of
from evopem.estimation.search.section_gains import gains, grid
from evopem.models.orders import Orders

# Random points that the smallest orders are descended from, and optima that are kept.
FIRST, KEPT = 8, 4
# Share of all places of a section that are looked at for an optimum, drawn anew each time: a search
# that always took the best of all would find the same again.
DRAWN = 0.15
# The best of these, and further random ones, that are judged by a step; those of each optimum that
# may be descended from, and those of all optima together.
JUDGED, FURTHER, OF_EACH, DESCENDED = 16, 12, 6, 16
SPECTRA = 100  # what the spectra of an optimum cost, in evaluations
PATIENCE = 3  # replacements without a gain after which none is expected
# Descents that begin anew, further from the edge of the stability region and then along it, until
# they gain no more than this.
POLISHES, LAST_GAIN = 5, 1e-7
# Share of places with two real roots, and largest and least distance of these from the circle.
REAL_SHARE, FARTHEST_REAL, NEAREST_REAL = 0.2, 0.9, 0.003
# By how many times the penalty of BIC an optimum without one of its sections has to be worse: a
# spare one gained up to 1.8 times in 160 searches of orders twice too large.
SUPPORTED = 2.0
# Polynomials that share a section, by letter and input; the poles of the first are those of it.
Shared = tuple[tuple[str, int], ...]
# The same and a stretch, None of the polynomials themselves; where these stand in a point.
Pieces = dict[tuple[tuple[str, int], int | None], slice]


class Optimum(NamedTuple):
    """Value and point, (n,), of an optimum."""

    value: float
    point: Array


class SectionReplacement:
    """Independent searches of a problem by order extension and section replacement."""

    def __init__(self, problem: PolynomialProblem) -> None:
        self.problem = problem
        self._steps = order_extension(problem.errors.orders)
        self._shared = tuple(dict.fromkeys(shared for _, shared in self._steps[1:]))

    @property
    def possible(self) -> bool:
        """Whether the problem has sections to replace."""
        return len(self._steps) > 1

    def search(self, max_evaluations: float, generator: np.random.Generator) -> BasinHopping:
        """An independent search: orders extended from the smallest, then sections replaced."""
        record = _Found(self.problem, generator)
        # A problem is made when it is needed, and not kept: its tables are as long as the record.
        smaller = self._of(self._steps[0][0])
        optima = record.descents(smaller, smaller.random(FIRST, generator))
        for orders, shared in self._steps[1:]:
            larger = self._of(orders)
            optima = record.with_sections(optima, smaller, larger, shared)
            smaller = larger
        return self._replaced(optima, record, max_evaluations)

    def search_from(
        self, point: Array, value: float, max_evaluations: float, generator: np.random.Generator
    ) -> BasinHopping:
        """Replace sections of an optimum, by other places than those that searches prefer."""
        record = _Found(self.problem, generator, by_gains=False)
        return self._replaced([Optimum(value, point)], record, max_evaluations)

    def _of(self, orders: Orders) -> PolynomialProblem:
        """The problem of some orders on the way."""
        if orders == self.problem.errors.orders:
            return self.problem
        return self.problem.of_orders(orders)

    def _replaced(
        self, optima: list[Optimum], record: _Found, max_evaluations: float
    ) -> BasinHopping:
        """Replace sections of the best optimum not tried, until that has failed for some time."""
        tried: list[float] = []
        failed = 0
        while optima and failed < PATIENCE and record.evaluations < max_evaluations:
            lowest = optima[0].value
            fresh = [local for local in optima if local.value not in tried]
            chosen = (fresh or optima)[0]
            tried.append(chosen.value)
            for shared in self._shared:
                optima = _lowest([*optima, *self._neighbours(chosen, shared, record)])
            failed = failed + 1 if same_optimum(lowest, optima[0].value) else 0
        if not optima:
            return BasinHopping(np.empty(0), np.inf, record.evaluations, [])
        best = record.polished(optima[0])
        return BasinHopping(best.point, best.value, record.evaluations, record.ended)

    def _neighbours(self, optimum: Optimum, shared: Shared, record: _Found) -> list[Optimum]:
        """Optima with one of the sections of an optimum elsewhere."""
        errors = self.problem.errors
        orders = with_fewer_sections(errors.orders, shared)
        assert orders is not None
        smaller = self._of(orders)
        starts = without_common_section(optimum.point, errors, smaller.errors, shared)
        left = record.descents(smaller, smaller.repair(starts))
        return record.with_sections(left, smaller, self.problem, shared)


class _Found:
    """What a search has found of a problem so far, and what it took.  Of the places of a section it
    prefers those of the largest gains, or random ones."""

    def __init__(
        self, problem: PolynomialProblem, generator: np.random.Generator, by_gains: bool = True
    ) -> None:
        self.problem, self.generator, self._by_gains = problem, generator, by_gains
        self.evaluations = 0
        self.ended: list[float] = []

    def with_sections(
        self,
        optima: list[Optimum],
        smaller: PolynomialProblem,
        larger: PolynomialProblem,
        shared: Shared,
    ) -> list[Optimum]:
        """Optima of larger orders from the most promising places of a further section."""
        starts, promised = [np.empty((0, larger.errors.dimension))], [np.empty(0)]
        for optimum in optima:
            grown, gained = self._most_promising(optimum, smaller, larger, shared)
            starts.append(grown)
            promised.append(gained)
        best = np.argsort(np.concatenate(promised), kind="stable")[:DESCENDED]
        return self.descents(larger, np.concatenate(starts)[best])

    def _most_promising(
        self,
        optimum: Optimum,
        smaller: PolynomialProblem,
        larger: PolynomialProblem,
        shared: Shared,
    ) -> tuple[Array, Array]:
        """An optimum with a further section at the best of random places, and what is promised.
        The gains of the places come first; one Gauss-Newton step from each of the best is nearer to
        the truth.  For the absolute value, whose slopes jump, it is not."""
        value, point = optimum
        drawn = np.flatnonzero(self.generator.random(len(grid())) < DRAWN)
        if self._by_gains:
            gained = gains(smaller.errors, point, shared, drawn)
            self.evaluations += SPECTRA
        else:
            self.generator.shuffle(drawn)
            gained = np.zeros(len(drawn))
        best = np.argsort(-gained, kind="stable")
        absolute = larger.errors.objective == "absolute"
        best = best[: OF_EACH if absolute else JUDGED]
        sections = grid()[drawn[best]]
        if not absolute:
            sections = np.concatenate([sections, places(FURTHER, self.generator)])
        grown = with_common_section(point, smaller.errors, larger.errors, shared, sections)
        grown = larger.repair(grown)
        if absolute:
            return grown, value * (1.0 - gained[best])
        promised = larger.promised(grown, value)
        self.evaluations += 9 * len(grown)
        best = np.argsort(promised, kind="stable")[:OF_EACH]
        return grown[best], promised[best]

    def descents(self, problem: PolynomialProblem, starts: Array) -> list[Optimum]:
        """The lowest optima that descents from some starts lead to."""
        if not len(starts):
            return []
        descents = problem.descend_from_neighbours(starts)
        self.evaluations += descents.evaluations
        if problem is self.problem:
            self.ended.extend(converged_values(descents))
        return _lowest(list(map(Optimum, descents.values.tolist(), descents.points)))

    def polished(self, optimum: Optimum) -> Optimum:
        """An optimum to the last digits, by descents that begin anew and along the edge."""
        ended = self.problem.polish(optimum.point[None, :])
        self.evaluations += ended.evaluations
        best = Optimum(float(ended.values[0]), ended.points[0])
        for _ in range(POLISHES):
            before = best.value
            begun = self.problem.descend(best.point[None, :])
            ended = self.problem.descend_in_sections(begun.points)
            self.evaluations += begun.evaluations + ended.evaluations
            if ended.values[0] < before:
                best = Optimum(float(ended.values[0]), ended.points[0])
            if same_optimum(before, best.value, LAST_GAIN):
                break
        return best


def _lowest(optima: list[Optimum]) -> list[Optimum]:
    """The lowest of some optima, none of them twice."""
    kept: list[Optimum] = []
    for local in sorted(optima, key=lambda local: local.value):
        if np.isfinite(local.value) and not (kept and same_optimum(local.value, kept[-1].value)):
            kept.append(local)
    return kept[:KEPT]


def order_extension(orders: Orders) -> list[tuple[Orders, Shared]]:
    """Orders in steps of one common section up to some orders, from the smallest, with what shares
    the section; those too small for smaller ones are alone."""
    steps, before = list[tuple[Orders, Shared]](), -1
    while len(steps) > before:
        before = len(steps)
        for shared in sharing(orders):
            smaller = with_fewer_sections(orders, shared)
            if smaller is not None:
                steps.append((orders, shared))
                orders = smaller
    return [(orders, ()), *reversed(steps)]


def sharing(orders: Orders) -> list[Shared]:
    """Polynomials that may share a section, the first of each the one whose poles it has."""
    inputs = range(orders.inputs)
    of_a = (("a", 0), *(("b", i) for i in inputs), ("c", 0))
    return [*((("f", i), ("b", i)) for i in inputs), of_a, (("d", 0), ("c", 0))]


def supports_sections(problem: PolynomialProblem, point: Array, value: float) -> tuple[bool, int]:
    """Whether the record supports all sections of an optimum, (n,), and the evaluations: without
    one, descents have to end higher by far more than BIC (Schwarz 1978) allows for, as a spare one
    stands at the best of many places."""
    errors, samples, used = problem.errors, sum(problem.errors.residual_counts()), 0
    power = 2.0 if errors.objective == "absolute" else 1.0
    for shared in sharing(errors.orders):
        long = tuple(piece for piece in shared if _length(errors.orders.part(*piece)) >= 3)
        orders = with_fewer_sections(errors.orders, long) if shared[0] in long else None
        if orders is None:
            continue
        smaller = problem.of_orders(orders)
        starts = without_common_section(point, errors, smaller.errors, long)
        if not len(starts):
            continue
        ended = smaller.descend_from_neighbours(smaller.repair(starts))
        used += ended.evaluations
        penalty = (errors.parameters - smaller.errors.parameters) * np.log(samples)
        if np.min(ended.values) <= value * np.exp(SUPPORTED * penalty / (power * samples)):
            return False, used
    return True, used


def with_fewer_sections(orders: Orders, shared: Shared) -> Orders | None:
    """Orders with a section less, or None where a polynomial would have no roots."""
    if min(_length(orders.part(*piece)) for piece in shared) < 3:
        return None

    def lower(letter: str, numbers: Sequence[int]) -> tuple[int, ...]:
        return tuple(n - 2 * ((letter, i) in shared) for i, n in enumerate(numbers))

    changed: dict[str, Any] = {f"n{x}": lower(x, [getattr(orders, f"n{x}")])[0] for x in "acd"}
    return replace(orders, nb=lower("b", orders.nb), nf=lower("f", orders.nf), **changed)


def places(count: int, generator: np.random.Generator) -> Array:
    """Monic sections, (count, 3), spread over all frequencies, damping, and real roots."""
    real = round(REAL_SHARE * count)
    distances = FARTHEST_REAL * (NEAREST_REAL / FARTHEST_REAL) ** generator.random((real, 2))
    roots = (1.0 - distances) * generator.choice([-1.0, 1.0], (real, 2))
    of_real = np.column_stack([np.ones(real), -roots.sum(axis=1), roots.prod(axis=1)])
    return np.concatenate([random_sections(count - real, generator), of_real])


def with_common_section(
    point: Array,
    smaller: PolynomialErrors,
    larger: PolynomialErrors,
    shared: Shared,
    sections: Array,
) -> Array:
    """A point of smaller orders times each of some sections, (M, n).  The residuals are those of
    the point but for what the states do to the first of them."""
    of_smaller, pieces, points = _pieces(smaller), _pieces(larger), []
    for section in sections:
        grown = np.zeros(larger.dimension)
        for (of, stretch), part in of_smaller.items():
            coefficients, into = point[part], pieces[of, stretch]
            if of in shared and len(coefficients):
                if stretch is None and of[0] != "b":
                    coefficients = np.convolve(np.append(1.0, coefficients), section)[1:]
                else:
                    coefficients = np.convolve(coefficients, section)[: _length(into)]
            grown[into] = coefficients
        points.append(grown)
    return np.array(points)


def without_common_section(
    point: Array, larger: PolynomialErrors, smaller: PolynomialErrors, shared: Shared
) -> Array:
    """A point without each section of the first of the polynomials that share, (M, n).  The others
    lose the section that lies nearest to it."""
    pieces, kept, points = _pieces(larger), _pieces(smaller), []
    lead, *others = shared
    base = np.zeros(smaller.dimension)
    for piece, part in kept.items():
        base[part] = point[pieces[piece]][: _length(part)]
    for section, rest in each_without(point[pieces[lead, None]]):
        shrunk = base.copy()
        shrunk[kept[lead, None]] = rest[1:]
        left = [without_nearest_of(of[0], point[pieces[of, None]], section) for of in others]
        for of, lower in zip(others, left, strict=True):
            if lower is not None:
                shrunk[kept[of, None]] = lower if of[0] == "b" else lower[1:]
        if all(lower is not None for lower in left):
            points.append(shrunk)
    return np.array(points).reshape(len(points), smaller.dimension)


def _pieces(errors: PolynomialErrors) -> Pieces:
    """Where each polynomial stands in a point, the levels, and the states of each stretch, of F_i
    and of the noise, which share the sections of C."""
    o, parts = errors.orders, errors.parts
    letters: list[tuple[str, int]] = [("a", 0), ("c", 0), ("d", 0)]
    letters += product("bf", range(o.inputs))
    pieces: Pieces = {(of, None): o.part(*of) for of in letters}
    level: tuple[str, int] = ("level", 0)
    pieces[(level, None)] = parts["level"]
    first = parts["plant"].start
    for stretch in range(len(errors.stretches)):
        for i, count in enumerate(o.nf):
            pieces[(("f", i), stretch)] = slice(first, first + count)
            first += count
    for stretch in range(len(errors.stretches)):
        pieces[(("c", 0), stretch)] = slice(first, first + o.noise_states)
        first += o.noise_states
    return pieces


def _length(part: slice) -> int:
    return int(part.stop - part.start)
