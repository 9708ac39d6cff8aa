"""Choice of basis, dimension, orders and terms of a moving model by BIC."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array, Flags
from evopem.estimation.varying import (
    Scheduled,
    VaryingEstimate,
    VaryingProblem,
    fit_varying,
)
from evopem.models.orders import Orders
from evopem.models.varying import KINDS, Basis, BasisKind, all_free, denominator_order, rows_of

DIMENSIONS = (2, 3, 4, 5, 6, 8, 10)
# Samples for each weight below which there is no such model.
FEWEST_PER_WEIGHT = 8
# Terms whose t-statistics are below it are dropped together, where BIC agrees.
INSIGNIFICANT = 1.5
# Orders in a row above the best one that end the ladder of a structure.
PATIENCE = 2
# Samples above which autoregressions alone are tried: the searches would take minutes.
MOST_SEARCHED = 20_000


class Chosen(NamedTuple):
    """An autoregression of moving coefficients, and its criterion."""

    bic: float
    orders: Orders
    basis: Basis


def arx_of(order: int, nk: Sequence[int]) -> Orders:
    """ARX, or AR without an input, whose inputs have as many coefficients as A."""
    return Orders("arx" if nk else "", na=order, nb=(order,) * len(nk), nk=tuple(nk))


def choose_autoregression(
    scheduled: Scheduled,
    most: int,
    nk: Sequence[int],
    kinds: Sequence[BasisKind] = KINDS,
    dimensions: Sequence[int] = DIMENSIONS,
) -> Chosen | None:
    """The ARX model of smallest BIC over orders 1 to ``most``, bases and their dimensions.

    One triangle of each basis serves all orders, and where functions are nested all dimensions.
    """
    nested = [kind for kind in kinds if kind != "spline"]
    # Splines of fewer functions than a cubic one are polynomials.
    apart = [n for n in dimensions if n > 4 and "spline" in kinds]
    tried: list[tuple[BasisKind, int]] = [
        *product(nested, [max(dimensions)]),
        *(("spline", n) for n in apart),
    ]
    every = [
        chosen
        for kind, dimension in tried
        for chosen in _of_basis(scheduled, most, nk, scheduled.basis(kind, dimension), dimensions)
    ]
    return min(every, key=lambda chosen: chosen.bic, default=None)


def _of_basis(
    scheduled: Scheduled, most: int, nk: Sequence[int], basis: Basis, dimensions: Sequence[int]
) -> Iterator[Chosen]:
    free = all_free(arx_of(most, nk), basis)
    problem = VaryingProblem(scheduled, arx_of(most, nk), basis, free)
    samples, triangle = problem.triangle()
    rows, terms = np.nonzero(free)
    smaller = [basis.dimension] if basis.kind == "spline" else dimensions
    for order, dimension in product(range(1, most + 1), smaller):
        of_polynomial = rows % most if most else rows
        kept = np.flatnonzero(((of_polynomial < order) | (rows == rows[-1])) & (terms < dimension))
        if samples < FEWEST_PER_WEIGHT * len(kept):
            continue
        smallest = np.asarray(np.linalg.qr(triangle[:, [*kept, -1]], mode="r"))
        left = float(smallest[-1, -1] ** 2)
        likelihood = samples * (np.log(max(left / samples, 1e-300)) + 1.0)
        bic = likelihood + (len(kept) + 1) * np.log(samples)
        yield Chosen(float(bic), arx_of(order, nk), replace(basis, dimension=dimension))


def choose_basis(
    scheduled: Scheduled,
    orders: Orders,
    kinds: Sequence[BasisKind] = KINDS,
    dimensions: Sequence[int] = DIMENSIONS,
    searched: bool = True,
) -> VaryingEstimate | None:
    """The model of known orders along the basis of smallest BIC, otherwise as of all structures."""
    bases = [scheduled.basis(kind, n) for kind, n in product(kinds, dimensions)]
    tried = (_descended(scheduled, orders, basis, ()) for basis in bases)
    if (lowest := _lowest(filter(None, tried))) is None:
        return None
    ended = min(_ends(scheduled, lowest, searched), key=lambda estimate: estimate.bic)
    return undersmoothed(scheduled, pruned(scheduled, ended))


def choose_varying(
    scheduled: Scheduled,
    most: int,
    nk: Sequence[int],
    kinds: Sequence[BasisKind] = KINDS,
    dimensions: Sequence[int] = DIMENSIONS,
    searched: bool = True,
) -> VaryingEstimate | None:
    """The model of smallest BIC of all structures, terms that BIC does not need dropped.

    With a function more in each coefficient that moves: see :func:`undersmoothed`.  By descents
    alone unless ``searched``.
    """
    chosen = choose_autoregression(scheduled, most, nk, kinds, dimensions)
    if chosen is None:
        return None
    best = pruned(scheduled, fit_varying(scheduled, chosen.orders, chosen.basis))
    basis, lowest = chosen.basis, None
    # What changes the poles of a noisy simulation is seen with more functions than its errors.
    tried = dimensions if scheduled.data.samples <= MOST_SEARCHED else ()
    for dimension in [n for n in tried if n >= chosen.basis.dimension]:
        basis = replace(basis, dimension=dimension)
        climbed = _lowest(_climbed(scheduled, most, nk, basis))
        if climbed is None or (lowest is not None and lowest.bic <= climbed.bic):
            break
        lowest, most = climbed, denominator_order(climbed.model.orders)
    if lowest is not None and lowest.bic < best.bic:
        ended = min(_ends(scheduled, lowest, searched), key=lambda estimate: estimate.bic)
        best = min(best, pruned(scheduled, ended), key=lambda estimate: estimate.bic)
    return undersmoothed(scheduled, best)


def _lowest(estimates: Iterable[VaryingEstimate]) -> VaryingEstimate | None:
    return min(estimates, key=lambda estimate: estimate.bic, default=None)


def _climbed(
    scheduled: Scheduled, most: int, nk: Sequence[int], basis: Basis
) -> Iterator[VaryingEstimate]:
    """ARMA, or ARMAX and output error, of rising orders until BIC rises."""
    of_armax: dict[int, Array] = {}  # weights of A by order: near those of F
    for structure in ("armax", "oe") if nk else ("arma",):
        since, lowest = 0, np.inf
        starts: list[Array] = []
        for order in range(1, most + 1):
            starts = starts[-1:]
            if structure == "oe" and order in of_armax:
                starts = [of_armax[order], *starts]
            estimate = _descended(scheduled, _orders_of(structure, order, nk), basis, starts)
            if estimate is None:
                break
            yield estimate
            weights, rows = estimate.model.weights, estimate.model.rows
            starts = [weights[rows["a" if structure == "oe" else "c"]]]
            of_armax.setdefault(order, weights[rows["a"]])
            since = since + 1 if estimate.bic >= lowest else 0
            lowest = min(lowest, estimate.bic)
            if since >= PATIENCE:
                break


def _orders_of(structure: str, order: int, nk: Sequence[int]) -> Orders:
    plant = {"nb": (order,) * len(nk), "nk": tuple(nk)} if nk else {}
    poles = {"nf": order} if structure == "oe" else {"na": order, "nc": order}
    return Orders(structure, **plant, **poles)  # type: ignore[arg-type]


def _descended(
    scheduled: Scheduled, orders: Orders, basis: Basis, given: Sequence[Array]
) -> VaryingEstimate | None:
    """Short descents from two stages and from given weights; C stays as it is."""
    free = all_free(orders, basis)
    if scheduled.data.samples < FEWEST_PER_WEIGHT * free.sum():
        return None
    free[rows_of(orders)["c"], 1:] = False
    problem = VaryingProblem(scheduled, orders, basis, free)
    if not np.any(free[problem.searched]):
        return problem.estimate(np.empty(0))
    starts, shape = [problem.start()], free[problem.searched].shape
    for weights in given:
        padded = np.zeros(shape)
        padded[: len(weights)] = weights
        starts.append(padded[free[problem.searched]])
    ended = problem.descend(np.array(starts))
    return problem.estimate(ended.points[np.argmin(ended.values)])


def _ends(scheduled: Scheduled, raced: VaryingEstimate, searched: bool) -> list[VaryingEstimate]:
    """What a model of a race becomes: by descent, by the search, and with a C that moves."""
    model, free = raced.model, raced.free
    ended = [_from(scheduled, raced, free)]
    if searched:
        ended.append(fit_varying(scheduled, model.orders, model.basis, free))
    if not free.all():
        ended.append(_from(scheduled, ended[-1], np.ones_like(free)))
    return ended


def pruned(scheduled: Scheduled, estimate: VaryingEstimate) -> VaryingEstimate:
    """The model without terms that BIC does not need: all insignificant ones, else the least."""
    model = estimate.model
    while model.covariance is not None:
        errors = model.covariance.standard_errors(np.eye(estimate.free.size))
        droppable = estimate.free.copy()
        droppable[:, 0] = False
        errors = errors.reshape(droppable.shape)
        sizes = np.where(droppable, np.abs(model.weights) / np.maximum(errors, 1e-300), np.inf)
        least = np.arange(sizes.size).reshape(sizes.shape) == np.argmin(sizes)
        steps = [sizes < INSIGNIFICANT, least]
        for dropped in (step for step in steps if np.any(step & droppable)):
            smaller = _from(scheduled, estimate, estimate.free & ~dropped)
            if smaller.bic < estimate.bic:
                estimate, model = smaller, smaller.model
                break
        else:
            return estimate
    return estimate


def undersmoothed(scheduled: Scheduled, estimate: VaryingEstimate) -> VaryingEstimate:
    """The model with a function more in each coefficient that moves, or in all that give the poles.

    What BIC leaves out is about as large as the standard errors, which do not know of it.
    """
    model, moves = estimate.model, np.any(estimate.free[:, 1:], axis=1)
    moves[model.rows["a"]] |= np.any(moves[model.rows["a"]])
    basis = replace(model.basis, dimension=model.basis.dimension + 1)
    free = np.zeros((len(moves), basis.dimension), dtype=bool)
    free[:, 0] = True
    free[moves] = True
    is_long = len(estimate.errors) >= FEWEST_PER_WEIGHT * free.sum()
    if not is_long or len(np.unique(scheduled.schedule)) < basis.dimension or not np.any(moves):
        return estimate
    problem = VaryingProblem(scheduled, model.orders, basis, free)
    functions = basis.at(basis.moments)
    values = model.basis.at(basis.moments) @ model.weights.T
    padded: Array = np.asarray(np.linalg.pinv(functions) @ values).T[problem.searched]
    start = padded[free[problem.searched]]
    return fit_varying(scheduled, model.orders, basis, free, starts=[start])


def _from(scheduled: Scheduled, estimate: VaryingEstimate, free: Flags) -> VaryingEstimate:
    """The model of some of the weights, from where that of all of them ended."""
    model = estimate.model
    rows = VaryingProblem(scheduled, model.orders, model.basis, free).searched
    start: Array = model.weights[rows][free[rows]]
    return fit_varying(scheduled, model.orders, model.basis, free, starts=[start])
