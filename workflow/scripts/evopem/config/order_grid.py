"""The candidates of the order search: the orders that each phase tries, and their jobs.

The number of jobs and the samples on which all candidates are compared follow from the
configuration alone, so the whole graph is known before anything runs.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from evopem.config.settings import (
    CHAPTER_RANGES,
    DatasetSettings,
    OrderGrid,
    Range,
    SampleRequirements,
    ScoringWindow,
)
from evopem.config.structures import STRUCTURES, phases_of
from evopem.errors import InputError

AUTO_PLANT_UPPER = 14  # upper end of ``orders.plant: auto``, the chapter's own

CandidateOrders = dict[str, int]  # the orders of a candidate by their names

DELAY_REFINED_IN = "nb"  # the phase whose selection is compared with other lags of B


def phases_of_dataset(settings: DatasetSettings) -> tuple[str, ...]:
    """The phases of a data set, in their order; none of the automatic recipe."""
    return phases_of(settings.order_grid.structure) if settings.automatic is None else ()


def phase_of_orders_of(settings: DatasetSettings) -> str | None:
    """The phase of a data set with models of every plant order: the plant order, or nb for FIR."""
    phases = phases_of_dataset(settings)
    return next((phase for phase in ("plant", "nb") if phase in phases), None)


def previous_phase(phase: str, structure: str) -> str | None:
    """Name the phase whose selection `phase` takes; None for the first one."""
    phases = phases_of(structure)
    position = phases.index(phase)
    return phases[position - 1] if position else None


def plant_range(grid: OrderGrid, resonances: int | None = None) -> Range:
    """Find the plant orders of the first phase, both ends included.

    Where none are given, each resonance needs a pair of complex poles, so the lower end is twice
    their number. It stays within the range that the graph was planned for.
    """
    if grid.ranges.plant is not None:
        return grid.ranges.plant
    lower = 2 if resonances is None else max(2, 2 * resonances)
    return (min(lower, AUTO_PLANT_UPPER), AUTO_PLANT_UPPER)


def orders_of_plant(k: int, grid: OrderGrid, nk: int = 0) -> CandidateOrders:
    """The orders of the structure's model of plant order k.

    Where there is D beside C or A, their degrees are limited by the ends of their ranges: two
    polynomials of high order would cancel each other. A beside F begins at its lower end.
    """
    names = STRUCTURES[grid.structure]
    orders = dict.fromkeys(names, k)
    if "nk" in names:
        orders["nk"] = nk
    if "nd" in names:
        orders["nd"] = min(k, range_of(grid, "nd")[1])
        if "nc" in names:
            orders["nc"] = min(k, range_of(grid, "nc")[1])
    if grid.structure == "general":
        orders["na"] = range_of(grid, "na")[0]
    return orders


def candidate_orders(
    phase: str,
    grid: OrderGrid,
    selected: Mapping[str, int] | None = None,
    resonances: int | None = None,
) -> list[CandidateOrders]:
    """List the candidates of a phase."""
    if phase == "delay":
        return [
            orders_of_plant(order, grid, delay)
            for order in inclusive(range_of(grid, "delay"))
            for delay in inclusive(range_of(grid, "nk"))
        ]
    if selected is None and previous_phase(phase, grid.structure) is not None:
        raise ValueError(
            f"phase {phase} needs the selection of phase {previous_phase(phase, grid.structure)}"
        )
    selected = selected or {}
    if phase == "plant":
        orders = inclusive(plant_range(grid, resonances))
        return [orders_of_plant(order, grid, selected.get("nk", 0)) for order in orders]
    selected_orders = {name: selected[name] for name in STRUCTURES[grid.structure]}
    return [selected_orders | {phase: order} for order in inclusive(range_of(grid, phase))]


def needs_resonances(phase: str, grid: OrderGrid) -> bool:
    """Whether the candidates of a phase depend on the number of resonances in the spectrum."""
    return phase == "plant" and grid.ranges.plant is None


def grid_of_phase(phase: str, grid: OrderGrid) -> OrderGrid:
    """Keep the part of a grid that a phase uses; the rest takes its built-in values.

    A phase then does not rerun when the range of another one changes.
    """
    used = {phase, "nk"} if phase == "delay" else {phase}
    if phase in ("delay", "plant") and "nd" in STRUCTURES[grid.structure]:
        used |= {"nc", "nd", "na"}  # they follow the plant order up to the ends of their ranges
    return _with_ranges(grid, used)


def grid_of_selection(phase: str, grid: OrderGrid) -> OrderGrid:
    """The part of a grid that the selection of a phase uses: the delays, at its end."""
    return _with_ranges(grid, {"nk"} if phase == DELAY_REFINED_IN else ())


def _with_ranges(grid: OrderGrid, used: Iterable[str]) -> OrderGrid:
    ranges = {name: getattr(grid.ranges, name) for name in used}
    return replace(grid, ranges=replace(CHAPTER_RANGES, **ranges))


def max_candidate_count(phase: str, grid: OrderGrid) -> int:
    """Count the candidates of a phase, at most: the number that the graph is planned for."""
    return len(candidate_orders(phase, grid, dict.fromkeys(STRUCTURES[grid.structure], 1)))


def part_count(phase: str, grid: OrderGrid, candidates_per_job: int | str) -> int:
    """Count the jobs of a phase. Job i estimates ``candidates[i::parts]``, which balances them.

    With ``"auto"`` there is one job, which shares its candidates out among its cores: the graph
    does not depend on the number of cores.
    """
    if candidates_per_job == "auto":
        return 1
    return math.ceil(max_candidate_count(phase, grid) / int(candidates_per_job))


def max_candidates_per_part(phase: str, grid: OrderGrid, candidates_per_job: int | str) -> int:
    """Count the candidates of a phase's largest job, at most."""
    return math.ceil(max_candidate_count(phase, grid) / part_count(phase, grid, candidates_per_job))


def scoring_window(settings: DatasetSettings) -> ScoringWindow:
    """Find the samples on which every candidate of every phase is compared.

    Residuals start behind the longest memory of any candidate. The loss starts
    ``search.n_initial_discard`` later: the unknown initial noise fits the first residuals.
    """
    grid = settings.order_grid
    candidates = _largest_candidates(grid)
    largest = {name: max(candidate[name] for candidate in candidates) for name in candidates[0]}
    memory = largest.get("nb", 0) + (range_of(grid, "nk")[1] if "nk" in largest else 0) - 1
    memory = max(memory, *(order for name, order in largest.items() if name not in ("nb", "nk")), 0)
    return ScoringWindow(memory, memory + settings.search.n_initial_discard)


def _largest_candidates(grid: OrderGrid) -> list[CandidateOrders]:
    """The largest candidates of the delay, of the plant order, and of the last phase."""
    phases = phases_of(grid.structure)
    candidates = []
    if "delay" in phases:
        candidates.append(orders_of_plant(range_of(grid, "delay")[1], grid))
    if "plant" in phases:
        candidates.append(orders_of_plant(plant_range(grid)[1], grid))
    last = dict(candidates[-1])
    for phase in phases:
        if phase not in ("delay", "plant"):
            upper = range_of(grid, phase)[1]
            # The last phase may keep the number of coefficients of B of the plant order.
            last[phase] = max(last[phase], upper) if phase == "nb" else upper
    return [*candidates, last]


def sample_requirements(settings: DatasetSettings) -> SampleRequirements:
    """Find what a recording must have for the largest candidate of any phase."""
    grid, window = settings.order_grid, scoring_window(settings)
    candidates = _largest_candidates(grid)
    last = candidates[-1]
    counts = [
        sum(order for name, order in candidate.items() if name != "nk") + candidate.get("nf", 0)
        for candidate in candidates  # coefficients and plant states
    ]
    states = last.get("nf", 0) + max(last.get("nc", 0), last.get("nd", 0))
    return SampleRequirements(
        loss_start=window.loss_start,
        parameters=max(counts) + int(grid.level),
        settling=window.residual_start + states,
    )


def check_samples(
    requirements: SampleRequirements, estimation: int, validation: int, place: str
) -> None:
    """Refuse a recording that is too short for some candidate, before any of them is estimated.

    Validation samples have to outnumber twice those in which the longest model settles: the initial
    state of a simulation is estimated from them, and would explain fewer by itself.
    """
    left = max(estimation - requirements.loss_start, 0)
    if left <= requirements.parameters:
        problem = (
            f"the largest model has {requirements.parameters} parameters and {estimation}"
            f" estimation samples, without the first {requirements.loss_start}, leave {left}"
        )
        remedy = "lower the upper ends of delay and orders, shorten split.discard, or record longer"
        raise InputError(f"{place}.orders", problem, remedy)
    least = 2 * requirements.settling
    if validation <= least:
        problem = (
            f"{validation} validation samples are left and more than {least} are needed, twice"
            " the settling time of the longest model"
        )
        remedy = "leave more to validation, lower the ends of delay and orders, or record longer"
        raise InputError(f"{place}.split", problem, remedy)


def range_of(grid: OrderGrid, name: str) -> Range:
    """A range of the chapter's recipe, which has one input and all ranges."""
    given: Range = getattr(grid.ranges, name)
    return given


def inclusive(limits: Range) -> range:
    """All orders of a range."""
    return range(limits[0], limits[1] + 1)
