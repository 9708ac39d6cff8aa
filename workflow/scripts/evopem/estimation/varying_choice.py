"""Choice of basis, dimension, orders and terms of a moving model by BIC."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array, Flags, Indices
from evopem.estimation.continuous import gram_triangle
from evopem.estimation.varying import Scheduled, VaryingEstimate, VaryingProblem, fit_varying
from evopem.models.orders import Orders
from evopem.models.varying import KINDS, Basis, BasisKind, VaryingModel, all_free, rows_of

DIMENSIONS = (2, 3, 4, 5, 6, 8, 10)
FEWEST_PER_WEIGHT = 8  # samples for each weight below which there is no such model
FINALISTS = 3  # models of a race that compete again without the samples that judge the choice
PATIENCE = 2  # orders in a row above the best one that end the ladder of a structure
# Samples above which autoregressions alone are tried: the searches would take minutes.
MOST_SEARCHED = 20_000


class Chosen(NamedTuple):
    """An autoregression of moving coefficients, and its criterion."""

    bic: float
    orders: Orders
    basis: Basis


def orders_of(structure: str, order: int, nk: Sequence[int]) -> Orders:
    """ARX, ARMAX or output error, or AR and ARMA without an input, of polynomials of one length."""
    name = structure if nk else {"arx": "", "armax": "arma"}[structure]
    poles = ("nf",) if structure == "oe" else ("na", "nc")[: 1 + (structure == "armax")]
    return Orders(name, nb=(order,) * len(nk), nk=tuple(nk), **dict.fromkeys(poles, order))


def autoregressions(
    scheduled: Scheduled,
    most: int,
    nk: Sequence[int],
    kinds: Sequence[BasisKind] = KINDS,
    dimensions: Sequence[int] = DIMENSIONS,
) -> list[Chosen]:
    """ARX models of orders 1 to ``most``, bases and their dimensions, that of smallest BIC first.

    One triangle of each basis serves all orders, and where functions are nested all dimensions.
    """
    every: list[Chosen] = []
    for kind in kinds:
        # Splines of fewer functions than a cubic one are polynomials.
        apart = [n for n in dimensions if n > 4] if kind == "spline" else [max(dimensions)]
        for basis in (scheduled.basis(kind, n) for n in apart):
            every += _of_basis(scheduled, most, nk, basis, dimensions)
    return sorted(every, key=lambda chosen: chosen.bic)


def _of_basis(
    scheduled: Scheduled, most: int, nk: Sequence[int], basis: Basis, dimensions: Sequence[int]
) -> Iterator[Chosen]:
    orders = orders_of("arx", most, nk)
    free = all_free(orders, basis)
    samples, triangle = VaryingProblem(scheduled, orders, basis, free).triangle()
    rows, terms = np.nonzero(free)
    smaller = [basis.dimension] if basis.kind == "spline" else dimensions
    for order, dimension in product(range(1, most + 1), smaller):
        of_polynomial = rows % most if most else rows
        kept = np.flatnonzero(((of_polynomial < order) | (rows == rows[-1])) & (terms < dimension))
        if samples < FEWEST_PER_WEIGHT * len(kept):
            continue
        smallest, _ = gram_triangle(triangle[:, [*kept, -1]])
        left = float(smallest[-1, -1] ** 2)
        likelihood = samples * (np.log(max(left / samples, 1e-300)) + 1.0)
        bic = likelihood + (len(kept) + 1) * np.log(samples)
        yield Chosen(float(bic), orders_of("arx", order, nk), replace(basis, dimension=dimension))


def race(
    scheduled: Scheduled,
    orders: Orders | int,
    nk: Sequence[int] = (),
    kinds: Sequence[BasisKind] = KINDS,
    dimensions: Sequence[int] = DIMENSIONS,
) -> list[VaryingEstimate]:
    """The models of smallest BIC by short descents, with all terms but those of C.

    ``orders``: known ones; or the highest of all structures, autoregressions and others apart.
    None where the record is too short.
    """
    if isinstance(orders, Orders):
        bases = [scheduled.basis(kind, n) for kind, n in product(kinds, dimensions)]
        return _lowest(_descended(scheduled, orders, basis) for basis in bases)
    linear, most = autoregressions(scheduled, orders, nk, kinds, dimensions)[:FINALISTS], orders
    lowest: list[VaryingEstimate] = []
    # What changes the poles of a noisy simulation is seen with more functions than its errors.
    tried = dimensions if linear and scheduled.data.samples <= MOST_SEARCHED else ()
    for dimension in [n for n in tried if n >= linear[0].basis.dimension]:
        basis = replace(linear[0].basis, dimension=dimension)
        climbed = _lowest(_climbed(scheduled, most, nk, basis))
        if not climbed or (lowest and lowest[0].bic <= climbed[0].bic):
            break
        lowest, most = climbed, climbed[0].model.orders.poles
    return [*_lowest(_descended(scheduled, *chosen[1:]) for chosen in linear), *lowest]


def choose_varying(
    scheduled: Scheduled, raced: Sequence[VaryingEstimate], searched: bool = True
) -> VaryingEstimate | None:
    """The model of smallest BIC of a race, without the terms that BIC does not need.

    With a function more in each coefficient that moves: see :func:`undersmoothed`.  By descents
    alone unless ``searched``.  None of an empty race.
    """
    best: VaryingEstimate | None = None
    for is_searched in (False, True):
        group = _lowest(estimate for estimate in raced if estimate.is_searched == is_searched)
        if group and (best is None or group[0].bic < best.bic):
            ends = _lowest(_ends(scheduled, group[0], searched))
            best = _lowest([pruned(scheduled, ends[0]), best])[0]
    return undersmoothed(scheduled, best) if best else None


def choose_again(scheduled: Scheduled, raced: Sequence[VaryingEstimate]) -> VaryingEstimate | None:
    """The choice among the models of a race for other samples, by descents from where they are."""
    again = [_from(scheduled, estimate.model, estimate.free) for estimate in raced]
    return choose_varying(scheduled, again, searched=False)


def _lowest(estimates: Iterable[VaryingEstimate | None]) -> list[VaryingEstimate]:
    """Those that compete, that of smallest BIC first."""
    return sorted(filter(None, estimates), key=lambda estimate: estimate.bic)[:FINALISTS]


def _climbed(
    scheduled: Scheduled, most: int, nk: Sequence[int], basis: Basis
) -> Iterator[VaryingEstimate]:
    """ARMA, or ARMAX and output error, of rising orders until BIC rises."""
    of_armax: dict[int, Array] = {}  # weights of A by order: near those of F
    for structure in ("armax", "oe") if nk else ("armax",):
        criteria: list[float] = []
        starts: list[Array] = []
        for order in range(1, most + 1):
            if structure == "oe" and order in of_armax:
                starts.insert(0, of_armax[order])
            estimate = _descended(scheduled, orders_of(structure, order, nk), basis, starts)
            if estimate is None:
                break
            yield estimate
            weights, rows = estimate.model.weights, estimate.model.rows
            starts = [weights[rows["searched"]]]
            of_armax.setdefault(order, weights[rows["a"]])
            criteria.append(estimate.bic)
            if int(np.argmin(criteria)) < order - PATIENCE:
                break


def _descended(
    scheduled: Scheduled, orders: Orders, basis: Basis, given: Sequence[Array] = ()
) -> VaryingEstimate | None:
    """Short descents from two stages and from given weights; C stays as it is."""
    free = all_free(orders, basis)
    if scheduled.data.samples < FEWEST_PER_WEIGHT * free.sum():
        return None
    free[rows_of(orders)["c"], 1:] = False
    problem = VaryingProblem(scheduled, orders, basis, free)
    if not np.any(free[problem.searched]):
        return problem.estimate(np.empty(0), False)
    starts, shape = [problem.start()], free[problem.searched].shape
    for weights in given:
        padded = np.zeros(shape)
        padded[: len(weights)] = weights
        starts.append(padded[free[problem.searched]])
    ended = problem.descend(np.array(starts))
    return problem.estimate(ended.points[np.argmin(ended.values)], False)


def _ends(scheduled: Scheduled, raced: VaryingEstimate, searched: bool) -> list[VaryingEstimate]:
    """What a model of a race becomes: by descent, by the search, and with a C that moves."""
    model, free = raced.model, raced.free
    ended = [_from(scheduled, model, free)]
    if searched and raced.is_searched:
        ended.append(fit_varying(scheduled, model.orders, model.basis, free))
    if not free.all():
        ended.append(_from(scheduled, ended[-1].model, np.ones_like(free)))
    return ended


def pruned(scheduled: Scheduled, estimate: VaryingEstimate) -> VaryingEstimate:
    """The model without terms that BIC does not need: as many as seems right, else the least."""
    order = _dropped(estimate)
    for count in sorted({len(order), min(len(order), 1)} - {0}, reverse=True):
        free = estimate.free.copy()
        free.flat[order[:count]] = False
        smaller = _from(scheduled, estimate.model, free)
        if smaller.bic < estimate.bic:
            return pruned(scheduled, smaller)
    return estimate


def _dropped(estimate: VaryingEstimate) -> Indices:
    """Terms that BIC seems not to need, one after the other, as the covariance lets others go on.
    (The increase by a term that is left out is its squared t-statistic: Wald.)"""
    known, droppable, dropped = estimate.model.covariance, estimate.free.copy(), list[int]()
    if known is None:
        return np.arange(0)
    covariance, single = known.factor @ known.factor.T, np.eye(droppable.size)
    weights = np.where(known.identifiable(single), estimate.model.weights.ravel(), 0.0)
    droppable[:, 0] = False
    while True:
        variances = np.maximum(np.diag(covariance), 1e-300)
        increases = np.where(droppable.ravel(), weights**2 / variances, np.inf)
        least = int(np.argmin(increases))
        if not increases[least] < np.log(len(estimate.errors)):
            return np.array(dropped, dtype=np.intp)
        along = covariance[:, least] / variances[least]
        weights = weights - along * weights[least]
        covariance = covariance - np.outer(along, covariance[least])
        droppable.flat[least] = False
        dropped.append(least)


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
    weights = np.linalg.pinv(basis.at(basis.moments)) @ model.coefficients(basis.moments)
    return _from(scheduled, replace(model, basis=basis, weights=weights.T), free)


def _from(scheduled: Scheduled, model: VaryingModel, free: Flags) -> VaryingEstimate:
    """The model of some of the weights, from where another one ended."""
    rows = model.rows["searched"]
    start: Array = model.weights[rows][free[rows]]
    return fit_varying(scheduled, model.orders, model.basis, free, starts=[start])
