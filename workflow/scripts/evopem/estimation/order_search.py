"""The search for delay and orders (chapter sections 5.3 and 5.4): candidates and selection.

Candidates are plain JSON-able dicts, so that the parts of a sweep can travel between jobs.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from evopem.errors import InputError
from evopem.estimation.estimate import Estimate, describe, estimate
from evopem.estimation.hybrid_search import SearchResult, SearchSettings
from evopem.estimation.kernels import MIN_NC
from evopem.estimation.prediction_error import PredictionErrorProblem
from evopem.models.armax import Orders
from evopem.models.polynomials import max_root_radius
from evopem.signals.recording import Recording

Candidate = dict[str, Any]


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
        began = time.process_time()
        found = estimate(
            data.input,
            data.output,
            order,
            data.sampling_rate,
            objective=search["objective"],
            seed=search["seed"],
            recursion_start=scoring_start - search["burn_in"],
            scoring_start=scoring_start,
            max_root_radius=search["max_root_radius"],
            search=search_settings(search),
            log=log,
        )
        candidates.append(_record(found, phase, time.process_time() - began))
        if log is not None:
            log(f"{phase}: {order} objective {found.objective_value:.9g}, BIC {found.bic:.6f}")
    return candidates


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
    orders = Orders(candidate["na"], candidate["nb"], candidate["nc"], candidate["nk"])
    point = np.array(
        candidate["a"][1:] + candidate["b"] + candidate["c"][1:] + candidate["noise_state"]
    )
    result = SearchResult(
        point=point,
        value=candidate["objective"],
        convergence=tuple((count, value) for count, value in candidate["convergence"]),
        **{key: candidate[key] for key in _SEARCH_COUNTS},
    )
    with threadpool_limits(limits=1, user_api="blas"):
        errors = PredictionErrorProblem(
            data.input,
            data.output,
            orders,
            search["objective"],
            max(scoring_start - search["burn_in"], MIN_NC),
            scoring_start,
            search["max_root_radius"],
        )
        return describe(errors, result, data.sampling_rate)


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
            "found": {key: getattr(estimate.search, key) for key in _SEARCH_COUNTS}
            | {"at_margin": estimate.at_margin},
        },
        "seed": search["seed"],
    }


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


_SEARCH_COUNTS = ("evaluations", "generations", "populations", "agreement", "basins")


def _record(found: Estimate, phase: str, seconds: float) -> Candidate:
    model = found.model
    return {
        "phase": phase,
        **asdict(model.orders),
        "rss": found.rss,
        "bic": found.bic,
        "objective": found.objective_value,
        "seconds": round(seconds, 4),
        "max_pole_radius": max_root_radius(model.a[1:]),
        "max_zero_radius": max_root_radius(model.c[1:]),
        "at_margin": found.at_margin,
        **{key: getattr(found.search, key) for key in _SEARCH_COUNTS},
        "a": model.a.tolist(),
        "b": model.b.tolist(),
        "c": model.c.tolist(),
        "noise_state": found.noise_state.tolist(),
        "convergence": [list(entry) for entry in found.search.convergence],
    }


def _criterion(candidate: Mapping[str, Any]) -> tuple[float, int, int, int, int]:
    """BIC, and the smaller model where it ties."""
    orders = (candidate["na"], candidate["nb"], candidate["nc"], candidate["nk"])
    return (candidate["bic"], *orders)


def _orders_of(candidate: Mapping[str, Any]) -> dict[str, int]:
    return {name: int(candidate[name]) for name in ("na", "nb", "nc", "nk")}
