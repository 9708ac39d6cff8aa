"""The grids of candidate models: which orders each phase tries, and how a phase is cut into jobs.

The number of jobs and the samples on which all candidates are compared follow from the
configuration alone, so the whole graph is known before anything runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from evopem.errors import InputError

PHASES = ("delay", "common", "c", "b")
"""The phases of the search, in their order: each takes its predecessor's choice."""

AUTO_COMMON_UPPER = 14
"""Upper end of ``orders.common: auto``, the chapter's own."""

Candidate = tuple[int, int, int, int]


def previous_phase(phase: str) -> str:
    """Name the phase whose choice `phase` takes; the first one has none.

    Raises
    ------
    ValueError
        For the first phase.
    """
    position = PHASES.index(phase)
    if position == 0:
        raise ValueError(f"phase {phase} has no predecessor")
    return PHASES[position - 1]


def common_range(common: list[int] | str, peaks: int | None) -> tuple[int, int]:
    """Find the orders of phase one, both ends included.

    With ``auto`` each spectral peak asks for a pair of complex poles, so the lower end is twice
    the number of peaks; it stays within the range the graph was planned for.

    Parameters
    ----------
    common : [lower, upper] or "auto"
    peaks : int or None
        Number of spectral peaks; None stands for "not known yet" and gives the widest range.
    """
    if common != "auto":
        return (int(common[0]), int(common[1]))
    lower = 2 if peaks is None else max(2, 2 * peaks)
    return (min(lower, AUTO_COMMON_UPPER), AUTO_COMMON_UPPER)


def candidate_orders(
    phase: str,
    dataset: Mapping[str, Any],
    selected: Mapping[str, int] | None = None,
    peaks: int | None = None,
) -> list[Candidate]:
    """List the candidates (na, nb, nc, nk) of a phase.

    Parameters
    ----------
    phase : str
        One of ``PHASES``.
    dataset : mapping
        A completed data set; only its ``delay`` and ``orders`` are read.
    selected : mapping, optional
        na, nb, nc and nk chosen by the phase before; not needed for the first.
    peaks : int, optional
        Number of spectral peaks, for ``orders.common: auto``.
    """
    if phase == "delay":
        return [
            (order, order, order, delay)
            for order in _inclusive(dataset["delay"]["orders"])
            for delay in _inclusive(dataset["delay"]["delays"])
        ]
    if selected is None:
        raise ValueError(f"phase {phase} needs the choice of phase {previous_phase(phase)}")
    na, nc, nk = selected["na"], selected["nc"], selected["nk"]
    match phase:
        case "common":
            orders = _inclusive(common_range(dataset["orders"]["common"], peaks))
            return [(order, order, order, nk) for order in orders]
        case "c":
            return [(na, selected["nb"], order, nk) for order in _inclusive(dataset["orders"]["c"])]
        case "b":
            return [(na, order, nc, nk) for order in _inclusive(dataset["orders"]["b"])]
    raise ValueError(f"no phase is called {phase}")


def part_for(phase: str, dataset: Mapping[str, Any]) -> dict[str, Any]:
    """Take the part of a data set's configuration that says which candidates a phase has."""
    if phase == "delay":
        return {"delay": dataset["delay"]}
    return {"orders": {phase: dataset["orders"][phase]}}


def needs_peaks(part: Mapping[str, Any]) -> bool:
    """Whether the candidates of a phase depend on the number of spectral peaks.

    Parameters
    ----------
    part : mapping
        What :func:`part_for` returns.
    """
    return dict(part) == {"orders": {"common": "auto"}}


def widest_candidate_count(phase: str, dataset: Mapping[str, Any]) -> int:
    """Count the candidates of a phase, at most: the number the graph is planned for."""
    any_selected = {"na": 1, "nb": 1, "nc": 1, "nk": 0}
    return len(candidate_orders(phase, dataset, any_selected))


def part_count(phase: str, dataset: Mapping[str, Any], candidates_per_job: int | str) -> int:
    """Count the jobs of a phase. Job i fits ``candidates[i::parts]``, which evens out the costs.

    With ``auto`` there is one, which shares its candidates out among the cores it is given: the
    graph, and with it what is up to date, does not depend on their number.
    """
    if candidates_per_job == "auto":
        return 1
    return math.ceil(widest_candidate_count(phase, dataset) / int(candidates_per_job))


def sample_needs(dataset: Mapping[str, Any]) -> dict[str, int]:
    """Find what a record must be able to carry: numbers of samples and parameters.

    Returns
    -------
    dict
        ``start``: first scored residual; ``parameters``: the largest na + nb + nc that any phase
        may fit; ``settling``: samples in which the longest model settles, its memory and its nc
        noise states.
    """
    orders, common = dataset["orders"], common_range(dataset["orders"]["common"], None)[1]
    in_delay, any_b = dataset["delay"]["orders"][1], max(common, orders["b"][1])
    start = scoring_start(dataset)
    return {
        "start": start,
        "parameters": max(3 * in_delay, 3 * common, common + any_b + orders["c"][1]),
        "settling": start - dataset["search"]["burn_in"] + orders["c"][1],
    }


def check_samples(needs: Mapping[str, int], estimation: int, validation: int, place: str) -> None:
    """Refuse a record that is too short for some candidate, before any of them is fitted.

    Every candidate needs more scored residuals than parameters. The validation samples have to
    outnumber twice those in which the longest model settles: the state that a simulation starts
    from is fitted to them, and would explain fewer by itself.

    Parameters
    ----------
    needs : mapping
        As `sample_needs` finds them.
    estimation, validation : int
        Numbers of prepared samples.
    place : str
        What leads the keys in an error, such as ``datasets.arm``.

    Raises
    ------
    InputError
    """
    left = max(estimation - needs["start"], 0)
    if left <= needs["parameters"]:
        raise InputError(
            f"{place}.orders",
            f"the largest model has {needs['parameters']} parameters and {estimation} estimation"
            f" samples, without the first {needs['start']}, leave {left} to fit it to",
            "lower the upper ends of delay and orders, shorten split.discard, or record longer",
        )
    least = 2 * needs["settling"]
    if validation <= least:
        raise InputError(
            f"{place}.split",
            f"{validation} validation samples are left and more than {least} are needed, twice"
            " what the longest model takes to settle",
            "leave more samples to validation, lower the upper ends of delay and orders, or"
            " record longer",
        )


def candidates_in_part(
    phase: str, dataset: Mapping[str, Any], candidates_per_job: int | str
) -> int:
    """Count the candidates of a phase's largest job, at most."""
    parts = part_count(phase, dataset, candidates_per_job)
    return math.ceil(widest_candidate_count(phase, dataset) / parts)


def scoring_start(dataset: Mapping[str, Any]) -> int:
    """Find the first sample on which every candidate of every phase is compared.

    It lies behind the longest memory of any of them, max(na, nb + nk - 1, nc), and behind the
    burn-in, whose first residuals are fitted by the unknown initial noise (`search.burn_in`).
    """
    delay, orders = dataset["delay"], dataset["orders"]
    common = common_range(orders["common"], None)[1]
    longest_delay = delay["delays"][1]
    memory = max(
        delay["orders"][1],
        common,
        orders["c"][1],
        max(delay["orders"][1], common, orders["b"][1]) + longest_delay - 1,
    )
    return int(memory + dataset["search"]["burn_in"])


def _inclusive(limits: list[int] | tuple[int, int]) -> range:
    return range(limits[0], limits[1] + 1)
