"""The search for delay and orders (chapter sections 5.3 and 5.4): candidates and selection.

Candidates are plain JSON-able dicts, so that the parts of a sweep can travel between jobs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from evopem.errors import InputError
from evopem.estimation.estimate import Estimate, descend_from, describe, estimate
from evopem.estimation.pem.kernels import MIN_NC
from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.search.incremental_order import padded
from evopem.estimation.search.memetic import SearchResult, SearchSettings, same_optimum
from evopem.models.armax import Orders
from evopem.models.polynomials import max_root_radius
from evopem.signals.recording import Recording

Candidate = dict[str, Any]

# Evaluations of a search that is made again, as a multiple of the first one's.
MORE = 5


def estimate_candidates(
    data: Recording,
    orders: Sequence[Orders | tuple[int, int, int, int]],
    phase: str,
    search: Mapping[str, Any],
    scoring_start: int,
    log: Callable[[str], None] | None = None,
) -> list[Candidate]:
    """Estimate every order of a (part of a) sweep on the same scored samples.

    Parameters
    ----------
    data : Recording
        The prepared estimation samples.
    orders : sequence of Orders or (na, nb, nc, nk)
    phase : str
        Name of the sweep, carried into the records.
    search : mapping
        The ``search`` block of the configuration.
    scoring_start : int
        First residual that counts, one number for all sweeps of a data set.  The recursion starts
        ``search["burn_in"]`` samples earlier, for all orders alike.
    log : callable, optional
        Receives a line at the start and the end of each estimate and one a generation.

    Raises
    ------
    InputError
        When the record is too short for an order.
    """
    candidates = []
    for position, item in enumerate(orders):
        order = item if isinstance(item, Orders) else Orders(*item)
        scored = len(data.output) - scoring_start
        if scored <= order.parameters:
            raise InputError(
                "orders",
                f"{order} has {order.parameters} parameters, but the estimation set of "
                f"{len(data.output)} samples leaves {max(scored, 0)} to score after the first "
                f"{scoring_start}",
                "lower the ranges of the orders, shorten search.burn_in or split.discard, or "
                "record longer",
            )
        if log is not None:
            log(f"{phase}: {order}, candidate {position + 1} of {len(orders)}")
        found = _searched(data, order, search, scoring_start, search_settings(search), None, log)
        candidates.append(_record(found, phase))
        if log is not None:
            log(f"{phase}: {order} objective {found.objective_value:.9g}, BIC {found.bic:.6f}")
    return candidates


def search_again(
    candidate: Mapping[str, Any],
    data: Recording,
    search: Mapping[str, Any],
    scoring_start: int,
    log: Callable[[str], None] | None = None,
) -> Candidate:
    """The candidate after a further, independent search with :data:`MORE` times the evaluations."""
    settings = search_settings(search)
    settings = replace(settings, evaluations=MORE * settings.evaluations)
    order, earlier = Orders(**_orders_of(candidate)), _result_of(candidate)
    found = _searched(data, order, search, scoring_start, settings, earlier, log)
    return _record(found, candidate["phase"])


def continue_from(
    smaller: Mapping[str, Any],
    candidate: Mapping[str, Any],
    data: Recording,
    search: Mapping[str, Any],
    scoring_start: int,
) -> Candidate:
    """The candidate after a descent from a smaller model that is a special case of it."""
    orders = Orders(**_orders_of(candidate))
    point = padded(_result_of(smaller).point, Orders(**_orders_of(smaller)), orders)
    with threadpool_limits(limits=1, user_api="blas"):
        errors = _problem(data, orders, search, scoring_start)
        found = descend_from(point, errors, data.sampling_rate, _result_of(candidate))
    return _record(found, candidate["phase"])


def _searched(
    data: Recording,
    orders: Orders,
    search: Mapping[str, Any],
    scoring_start: int,
    settings: SearchSettings,
    earlier: SearchResult | None,
    log: Callable[[str], None] | None,
) -> Estimate:
    return estimate(
        data.input,
        data.output,
        orders,
        data.sampling_rate,
        objective=search["objective"],
        seed=search["seed"],
        recursion_start=scoring_start - search["burn_in"],
        scoring_start=scoring_start,
        max_root_radius=search["max_root_radius"],
        search=settings,
        start=search["start"],
        earlier=earlier,
        log=log,
    )


def search_settings(search: Mapping[str, Any]) -> SearchSettings:
    """The settings of the hybrid search in a configuration's ``search`` block."""
    return SearchSettings(
        mu=search["mu"],
        lambda_=search["lambda"],
        nu=search["nu"],
        mutate=search["mutate"],
        evaluations=search["evaluations"],
    )


def recall(
    candidate: Mapping[str, Any], data: Recording, search: Mapping[str, Any], scoring_start: int
) -> Estimate:
    """The full estimate of a candidate, recomputed at its parameters without a search."""
    orders, result = Orders(**_orders_of(candidate)), _result_of(candidate)
    with threadpool_limits(limits=1, user_api="blas"):
        errors = _problem(data, orders, search, scoring_start)
        return describe(errors, result, data.sampling_rate)


def _problem(
    data: Recording, orders: Orders, search: Mapping[str, Any], scoring_start: int
) -> PredictionErrorProblem:
    return PredictionErrorProblem(
        data.input,
        data.output,
        orders,
        search["objective"],
        max(scoring_start - search["burn_in"], MIN_NC),
        scoring_start,
        search["max_root_radius"],
    )


def _result_of(candidate: Mapping[str, Any]) -> SearchResult:
    """The result of the search as the candidate's record has it."""
    return SearchResult(
        point=np.array(
            candidate["a"][1:] + candidate["b"] + candidate["c"][1:] + candidate["noise_state"]
        ),
        value=_value(candidate),
        ends=tuple(candidate["ends"]),
        convergence=tuple((count, value) for count, value in candidate["convergence"]),
        **{key: candidate[key] for key in _COUNTED},
    )


def evidence_of(estimate: Estimate, search: Mapping[str, Any]) -> dict[str, Any]:
    """What speaks for an estimate, as it stands in model.json beside the model itself."""
    return {
        "objective": {"name": estimate.objective, "value": estimate.objective_value},
        "fit_percent": estimate.fit_percent,
        "rss": estimate.rss,
        "bic": estimate.bic,
        "recursion_start": estimate.recursion_start,
        "scoring_start": estimate.scoring_start,
        "noise_state": estimate.noise_state.tolist(),
        "search": {
            "settings": dict(search),
            "found": {key: getattr(estimate.search, key) for key in _CERTIFICATE}
            | {"at_margin": estimate.at_margin},
        },
        "seed": search["seed"],
    }


def select(
    candidates: Sequence[Candidate],
    phase: str,
    again: Callable[[Candidate], Candidate],
    continued: Callable[[Candidate, Candidate], Candidate],
) -> tuple[dict[str, int], str, list[Candidate]]:
    """Choose a phase's delay or order, once the searches that decide it can be relied on.

    A search is proven to have failed when a smaller model, which is a special case of its own,
    has the lower objective: it goes on from there.  A candidate that would be chosen although no
    second population ended at its best value is searched again, once, before the choice stands.

    Parameters
    ----------
    candidates : sequence of candidates
        Of the whole phase.
    phase : str
    again : callable
        Returns a candidate after a further search; see :func:`search_again`.
    continued : callable
        Takes a smaller candidate and one that contains it, and returns the latter after a descent
        from the former; see :func:`continue_from`.

    Returns
    -------
    chosen orders, the reason in a sentence, and the candidates as they now are
    """
    choose = select_delay if phase == "delay" else select_order
    settled = list(candidates)
    searched: set[int] = set()
    while True:
        settled = _no_worse_than_smaller_ones(settled, continued)
        chosen, reason = choose(settled)
        doubtful = {
            row
            for row, candidate in enumerate(settled)
            if _decides(candidate, chosen, phase) and candidate["agreement"] == 0.0
        }
        if doubtful <= searched:
            return chosen, reason, settled
        for row in sorted(doubtful - searched):
            settled[row] = again(settled[row])
        searched |= doubtful


def _no_worse_than_smaller_ones(
    candidates: Sequence[Candidate], continued: Callable[[Candidate, Candidate], Candidate]
) -> list[Candidate]:
    """The candidates, those that a special case of theirs beats continued from the best of these.

    From the smallest up, so that each is compared with what the smaller ones have become.
    """
    settled = list(candidates)
    orders = [Orders(**_orders_of(candidate)) for candidate in candidates]
    for row in sorted(range(len(settled)), key=lambda row: orders[row].parameters):
        value = _value(settled[row])
        contained = [
            settled[other]
            for other in range(len(settled))
            if orders[row].contains(orders[other])
            and not same_optimum(value, _value(settled[other]))
        ]
        if contained:
            settled[row] = continued(min(contained, key=_value), settled[row])
    return settled


def _decides(candidate: Mapping[str, Any], chosen: Mapping[str, int], phase: str) -> bool:
    """Whether the choice rests on a candidate: for the delay, on all orders with that delay."""
    names = ("nk",) if phase == "delay" else tuple(chosen)
    return all(candidate[name] == chosen[name] for name in names)


def select_delay(candidates: Sequence[Mapping[str, Any]]) -> tuple[dict[str, int], str]:
    """The delay with the smallest mean BIC over the orders (chapter section 5.3).

    The mean rewards both what the chapter looked for: better criteria, and small deviations
    between the orders.  The orders returned are those of the delay's best candidate.
    """
    by_delay: dict[int, list[Mapping[str, Any]]] = defaultdict(list)
    for candidate in candidates:
        by_delay[candidate["nk"]].append(candidate)
    means = {nk: float(np.mean([c["bic"] for c in group])) for nk, group in by_delay.items()}
    spreads = {nk: float(np.ptp([c["bic"] for c in group])) for nk, group in by_delay.items()}
    chosen = min(sorted(means), key=lambda nk: means[nk])
    best = min(by_delay[chosen], key=_criterion)
    others = [means[nk] for nk in means if nk != chosen]
    lead = f", {min(others) - means[chosen]:.4f} below the next" if others else ""
    reason = (
        f"A delay of {chosen} sample{'' if chosen == 1 else 's'} has the smallest mean BIC over "
        f"the orders ({means[chosen]:.4f}{lead}); over its orders BIC varies by "
        f"{spreads[chosen]:.4f}."
    )
    return _orders_of(best), reason


def select_order(candidates: Sequence[Mapping[str, Any]]) -> tuple[dict[str, int], str]:
    """The candidate of smallest BIC (chapter section 5.4)."""
    ranked = sorted(candidates, key=_criterion)
    best = ranked[0]
    name = str(Orders(**_orders_of(best)))
    reason = f"{name} has the smallest BIC ({best['bic']:.4f}) of {len(ranked)} candidates"
    if len(ranked) > 1:
        runner = ranked[1]
        reason += f", {runner['bic'] - best['bic']:.4f} below {Orders(**_orders_of(runner))}"
    return _orders_of(best), reason + "."


_COUNTED = ("evaluations", "generations", "basins", "checked", "unseen")
_CERTIFICATE = (*_COUNTED, "populations", "agreement")


def _record(found: Estimate, phase: str) -> Candidate:
    model = found.model
    return {
        "phase": phase,
        **asdict(model.orders),
        "rss": found.rss,
        "bic": found.bic,
        "objective": found.objective_value,
        "max_pole_radius": max_root_radius(model.a[1:]),
        "max_zero_radius": max_root_radius(model.c[1:]),
        "at_margin": found.at_margin,
        **{key: getattr(found.search, key) for key in _CERTIFICATE},
        "ends": list(found.search.ends),
        "a": model.a.tolist(),
        "b": model.b.tolist(),
        "c": model.c.tolist(),
        "noise_state": found.noise_state.tolist(),
        "convergence": [list(entry) for entry in found.search.convergence],
    }


def _value(candidate: Mapping[str, Any]) -> float:
    """What the candidate's search minimised, at its best point."""
    return float(min(candidate["ends"]))


def _criterion(candidate: Mapping[str, Any]) -> tuple[float, int, int, int, int]:
    """BIC, and the smaller model where it ties."""
    orders = (candidate["na"], candidate["nb"], candidate["nc"], candidate["nk"])
    return (candidate["bic"], *orders)


def _orders_of(candidate: Mapping[str, Any]) -> dict[str, int]:
    return {name: int(candidate[name]) for name in ("na", "nb", "nc", "nk")}
