"""Order search: estimates of a phase, on one core or several, and the selection of one of them."""

import logging
import math
import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np

from evopem.arrays import one_blas_thread
from evopem.config.settings import FitSettings, ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.order_candidate import (
    Candidate,
    PhaseSelection,
    race,
    select_delay,
    select_order,
)
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import prediction_errors
from evopem.estimation.prediction_estimate import optimum_next_to
from evopem.estimation.search.certificate import Target, has_agreed
from evopem.estimation.search.problem import Log, pooled, same_optimum
from evopem.files.job import end_with_parent
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording

REPEAT_FACTOR = 5  # evaluations of a repeated search, as a multiple of the first one's
# BIC removes a coefficient whose squared t ratio is about below ln N; up to so many times is tried.
SCREENING = 3.0


@dataclass(frozen=True)
class OrderSearch:
    """The samples of all candidates, and how each of them is estimated."""

    data: Recording
    settings: SearchSettings
    window: ScoringWindow
    level: bool = False  # whether a constant is estimated along
    log: Log | None = None

    @property
    def samples(self) -> int:
        """Residuals that count, over all stretches."""
        return sum(max(part.samples - self.window.loss_start, 0) for part in self.data.segments)

    def repeated(self) -> Self:
        """The same for repeated searches, which are longer."""
        evaluations = REPEAT_FACTOR * self.settings.evaluations
        return replace(self, settings=replace(self.settings, evaluations=evaluations))

    def estimate(self, orders: Orders, **given: Any) -> PolynomialEstimate:
        """The estimate of orders; ``given`` as of :func:`.estimate_polynomial`."""
        return estimate_polynomial(
            self.data,
            orders,
            settings=self.settings,
            window=self.window,
            level=self.level,
            log=self.log,
            **given,
        )


def estimate_candidates(
    search: OrderSearch, orders: Sequence[Orders], phase: str
) -> list[Candidate]:
    """Estimate every order of a phase, or of a part of it, on the same samples.

    InputError when the record is too short for an order.
    """
    candidates = []
    for position, order in enumerate(orders):
        estimated = order.parameters + order.single.nf + int(search.level)
        if search.samples <= estimated:
            raise InputError(
                "orders",
                f"{order} has {estimated} parameters, but the {len(search.data.output)} "
                f"estimation samples leave {search.samples} residuals after the first "
                f"{search.window.loss_start}",
                "lower the ranges of the orders, shorten search.n_initial_discard or "
                "split.discard, or record longer",
            )
        if search.log is not None:
            search.log(f"{phase}: {order}, candidate {position + 1} of {len(orders)}")
        estimate = search.estimate(order)
        candidates.append(Candidate.of(estimate, phase))
        if search.log is not None:
            reached = f"{estimate.criteria.objective:.9g}, BIC {estimate.criteria.bic:.6f}"
            search.log(f"{phase}: {order} objective {reached}")
    return candidates


def continue_search(
    search: OrderSearch, candidate: Candidate, target: Target | None = None
) -> Candidate:
    """Search on, independently of what was found so far, and keep the better."""
    estimate = search.estimate(candidate.orders, earlier=candidate.search, target=target)
    return Candidate.of(estimate, candidate.phase)


def reoptimize_from(search: OrderSearch, nested: Candidate, candidate: Candidate) -> Candidate:
    """Re-optimise a candidate from the parameters of a nested smaller one."""
    data, earlier = search.data, candidate.search
    with one_blas_thread():
        errors = prediction_errors(
            data, candidate.orders, search.settings, search.window, search.level
        )
        ended = optimum_next_to(nested.model, errors)
        earlier = earlier if ended is None else pooled(earlier, ended)
        estimate = describe(errors, earlier, data.sampling_rate, shortest=True)
    return Candidate.of(estimate, candidate.phase)


def complete_estimate(
    candidate: Candidate,
    data: Recording,
    settings: SearchSettings,
    window: ScoringWindow,
    fit: FitSettings | None = None,
) -> PolynomialEstimate:
    """The full estimate of a candidate, with residuals and covariance, without a search.

    With a focus or constraints, descents for these start from the candidate; InputError when no
    model of its orders meets the constraints.
    """
    orders, level = candidate.orders, bool(candidate.levels)
    if fit is not None and fit.changes_model:
        return OrderSearch(data, settings, window, level).estimate(
            orders, focus=fit.focus, constraints=fit.constraints, optimum=candidate.search
        )
    with one_blas_thread():
        errors = prediction_errors(data, orders, settings, window, level)
        return describe(errors, candidate.search, data.sampling_rate, shortest=True)


def select_candidate(
    search: OrderSearch, candidates: Sequence[Candidate], phase: str, min_delay: int | None = None
) -> PhaseSelection:
    """Select a phase's delay or order, after repeating the searches that leave it in doubt.

    ``candidates``: all of the phase.  ``min_delay``: given in the last phase, whose selection is
    compared with models of other lags of B, down to this delay.
    """
    repeat = partial(continue_search, search.repeated())
    reoptimize = partial(reoptimize_from, search)
    ordered = sorted(candidates, key=lambda candidate: candidate.orders)
    if search.settings.prune:
        ordered = race(
            *(ordered, phase, search.samples, search.settings),
            partial(continue_search, search),
            lambda candidate: _no_worse_than_nested(candidate, reoptimize),
        )
    selection = settle(ordered, phase, repeat, reoptimize, last=min_delay is not None)
    return selection if min_delay is None else _with_refined_delay(search, selection, min_delay)


def _with_refined_delay(
    search: OrderSearch, selection: PhaseSelection, min_delay: int
) -> PhaseSelection:
    """Compare the selected model with others of neighbouring lags of B."""
    candidates: dict[Orders, Candidate] = {}

    def fit(orders: Orders) -> Fit:
        (candidate,) = estimate_candidates(search, [orders], selection.phase)
        if _is_doubtful(candidate, last=True):
            candidate = continue_search(search.repeated(), candidate)
        candidates[orders] = candidate
        return with_covariance(candidate)

    def with_covariance(candidate: Candidate) -> Fit:
        complete = complete_estimate(candidate, search.data, search.settings, search.window)
        return Fit(complete.model, candidate.criteria.bic)

    refined = refine_delay(with_covariance(selection.selected), search.samples, min_delay, fit)
    known = {candidate.orders for candidate in selection.candidates}
    added = [candidate for orders, candidate in candidates.items() if orders not in known]
    orders = refined.model.orders
    reason = selection.reason
    if orders != selection.orders:
        reason += (
            f" {orders}, with other lags of B, has a BIC {refined.bic:.4f} below its"
            f" {selection.selected.criteria.bic:.4f}."
        )
    return PhaseSelection(selection.phase, orders, reason, (*selection.candidates, *added))


class Fit(NamedTuple):
    """An estimated model and its BIC on the samples that all models are compared on."""

    model: PolynomialModel
    bic: float


def refine_delay(
    start: Fit, samples: int, shortest_delay: int, estimate: Callable[[Orders], Fit]
) -> Fit:
    """Follow the smallest BIC from a model to its neighbours, with other lags of B, while it falls.
    With one coefficient of B too many, delays nk and nk + 1 both contain the true model.
    ``estimate``: makes a model of some orders on the same scored samples."""
    best = start
    tried = {start.model.orders}
    while True:
        fits = []
        for orders in delay_alternatives(best.model, samples, shortest_delay):
            if orders not in tried:
                fits.append(estimate(orders))
                tried.add(orders)
        better = min(fits, key=lambda fit: (fit.bic, fit.model.orders), default=best)
        if not better.bic < best.bic:
            return best
        best = better


def delay_alternatives(model: PolynomialModel, samples: int, shortest_delay: int) -> list[Orders]:
    """Orders of B without its first or its last lag, unless clearly significant, or one earlier."""
    orders, nb, nk = model.orders, model.orders.single.nb, model.orders.single.nk
    limit = math.sqrt(SCREENING * math.log(samples))
    # A t ratio that is not known (NaN) is no reason to keep a coefficient.
    keeps_first, keeps_last = (t > limit for t in t_ratios_of_ends(model))
    alternatives = []
    if nb > 1 and not keeps_first:
        alternatives.append(replace(orders, nb=(nb - 1,), nk=(nk + 1,)))
    if nb > 1 and not keeps_last:
        alternatives.append(replace(orders, nb=(nb - 1,)))
    if nk > shortest_delay:
        alternatives.append(replace(orders, nb=(nb + 1,), nk=(nk - 1,)))
    return alternatives


def t_ratios_of_ends(model: PolynomialModel) -> tuple[float, float]:
    """Absolute t ratios of the first and the last coefficient of B; NaN without a covariance."""
    if model.covariance is None:
        return math.nan, math.nan
    of_b = model.orders.part("b")
    ends = np.eye(model.orders.parameters)[[of_b.start, of_b.stop - 1]]
    errors = model.covariance.standard_errors(ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        leading, trailing = np.abs(model.B[0][[0, -1]]) / errors
    return float(leading), float(trailing)


def settle(
    candidates: Sequence[Candidate],
    phase: str,
    repeat: Callable[[Candidate], Candidate],
    reoptimize: Callable[[Candidate, Candidate], Candidate],
    last: bool = False,
) -> PhaseSelection:
    """Select a candidate, given how a search is repeated and how one is re-optimised.

    A candidate that a nested smaller one beats is re-optimised from it.  One that would be selected
    although no restart confirmed its optimum is searched once more; in the ``last`` phase, one that
    is not certified.
    """
    select = select_delay if phase == "delay" else select_order
    settled = list(candidates)
    repeated: set[int] = set()
    while True:
        settled = _no_worse_than_nested(settled, reoptimize)
        orders, reason = select(settled)
        # The selection of a delay rests on all orders with it.
        deciding = [
            c.orders.nk == orders.nk if phase == "delay" else c.orders == orders for c in settled
        ]
        doubtful = {
            row
            for row, candidate in enumerate(settled)
            if deciding[row] and not candidate.pruned and _is_doubtful(candidate, last)
        }
        if doubtful <= repeated:
            return PhaseSelection(phase, orders, reason, tuple(settled))
        for row in sorted(doubtful - repeated):
            settled[row] = repeat(settled[row])
        repeated |= doubtful


def _no_worse_than_nested(
    candidates: Sequence[Candidate], reoptimize: Callable[[Candidate, Candidate], Candidate]
) -> list[Candidate]:
    """Re-optimise each candidate that a nested one beats, from the smallest up."""
    settled = list(candidates)
    for row in sorted(range(len(settled)), key=lambda row: settled[row].orders.parameters):
        larger = settled[row]
        nested = [
            smaller
            for smaller in settled
            if larger.orders.contains(smaller.orders)
            and not same_optimum(larger.minimum, smaller.minimum)
        ]
        if nested:
            settled[row] = reoptimize(min(nested, key=lambda c: c.minimum), larger)
    return settled


def _is_doubtful(candidate: Candidate, last: bool) -> bool:
    """Whether a selection that rests on a candidate has its search repeated."""
    diagnostics = candidate.diagnostics
    return not has_agreed(diagnostics) if last else diagnostics.n_confirming == 0


def estimate_in_parallel(
    search: OrderSearch, orders: Sequence[Orders], phase: str, cores: int = 1
) -> list[Candidate]:
    """As :func:`estimate_candidates`, on several cores, whose log is the package's logger.

    An estimate depends on its order and the data alone, so sharing the work changes no bit.
    InputError also when a process was killed.
    """
    if cores <= 1 or len(orders) <= 2:
        return estimate_candidates(search, orders, phase)
    # The largest go first, so that no core is left with one of them at the end. The smallest is
    # estimated here: it loads the compiled kernels, which forked processes then share.
    smallest, *others = sorted(range(len(orders)), key=lambda index: orders[index].parameters)
    estimates = {smallest: estimate_candidates(search, [orders[smallest]], phase)}
    # Elsewhere than on Linux forking is unsafe.
    start = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    logged = replace(search, log=logging.getLogger("evopem").info)
    try:
        with ProcessPoolExecutor(min(cores, len(others)), start, end_with_parent) as pool:
            running = {
                index: pool.submit(estimate_candidates, logged, [orders[index]], phase)
                for index in reversed(others)
            }
            estimates |= {index: estimate.result() for index, estimate in running.items()}
    except BrokenProcessPool:
        problem = "a process that estimates them was killed, as a system without memory does"
        remedy = "run again with fewer cores or jobs, or with more memory"
        raise InputError(f"the candidates of phase {phase}", problem, remedy) from None
    return [candidate for index in range(len(orders)) for candidate in estimates[index]]
