"""The candidates of the order search: the orders that each phase tries, and their jobs.

The number of jobs and the samples on which all candidates are compared follow from the
configuration alone, so the whole graph is known before anything runs.
"""

from __future__ import annotations

import math

from evopem.config.settings import (
    PHASES,
    DatasetSettings,
    OrderGrid,
    Range,
    SampleRequirements,
    ScoringWindow,
)
from evopem.errors import InputError

AUTO_JOINT_UPPER = 14
"""Upper end of ``orders.joint: auto``, the chapter's own."""

Candidate = tuple[int, int, int, int]
"""PolynomialOrders (na, nb, nc, nk)."""


def previous_phase(phase: str) -> str | None:
    """Name the phase whose selection `phase` takes; None for the first one.

    Examples
    --------
    >>> previous_phase("nc")
    'joint'
    """
    position = PHASES.index(phase)
    return PHASES[position - 1] if position else None


def joint_range(joint: Range | str, resonances: int | None) -> Range:
    """Find the joint orders of the first phase, both ends included.

    With ``"auto"`` each resonance needs a pair of complex poles, so the lower end is twice their
    number. It stays within the range that the graph was planned for.

    Parameters
    ----------
    joint : (lower, upper) or "auto"
    resonances : int or None
        Number of spectral peaks that may be resonances; None gives the widest range.

    Examples
    --------
    >>> joint_range("auto", resonances=3)
    (6, 14)
    >>> joint_range((2, 9), resonances=3)
    (2, 9)
    """
    if not isinstance(joint, str):
        return joint
    lower = 2 if resonances is None else max(2, 2 * resonances)
    return (min(lower, AUTO_JOINT_UPPER), AUTO_JOINT_UPPER)


def candidate_orders(
    phase: str,
    grid: OrderGrid,
    selected: Candidate | None = None,
    resonances: int | None = None,
) -> list[Candidate]:
    """List the candidates (na, nb, nc, nk) of a phase.

    Parameters
    ----------
    phase : str
        One of :data:`PHASES`.
    grid : OrderGrid
    selected : (na, nb, nc, nk), optional
        Selection of the phase before; not needed for the first.
    resonances : int, optional
        Number of spectral peaks that may be resonances, for ``orders.joint: auto``.

    Examples
    --------
    The third phase, with the built-in grid, from the selection of the second one:

    >>> candidate_orders("nc", OrderGrid(), selected=(7, 7, 7, 3))[:2]
    [(7, 7, 2, 3), (7, 7, 3, 3)]
    """
    if phase == "delay":
        return [
            (order, order, order, delay)
            for order in _inclusive(grid.delay.orders)
            for delay in _inclusive(grid.delay.nk)
        ]
    if selected is None:
        raise ValueError(f"phase {phase} needs the selection of phase {previous_phase(phase)}")
    na, nb, nc, nk = selected
    match phase:
        case "joint":
            orders = _inclusive(joint_range(grid.orders.joint, resonances))
            return [(order, order, order, nk) for order in orders]
        case "nc":
            return [(na, nb, order, nk) for order in _inclusive(grid.orders.nc)]
        case "nb":
            return [(na, order, nc, nk) for order in _inclusive(grid.orders.nb)]
    raise ValueError(f"no phase is called {phase}")


def needs_resonances(phase: str, grid: OrderGrid) -> bool:
    """Whether the candidates of a phase depend on the number of resonances in the spectrum."""
    return phase == "joint" and grid.orders.joint == "auto"


def grid_of_phase(phase: str, grid: OrderGrid) -> OrderGrid:
    """Keep the part of a grid that a phase uses; the rest takes its built-in values.

    A phase then does not rerun when the range of another one changes.
    """
    default = OrderGrid()
    if phase == "delay":
        return OrderGrid(delay=grid.delay)
    orders = {phase: getattr(grid.orders, phase)}
    return OrderGrid(orders=type(default.orders)(**orders))


def max_candidate_count(phase: str, grid: OrderGrid) -> int:
    """Count the candidates of a phase, at most: the number that the graph is planned for.

    Examples
    --------
    >>> max_candidate_count("joint", OrderGrid())  # orders 6 to 14
    9
    """
    return len(candidate_orders(phase, grid, (1, 1, 1, 0)))


def part_count(phase: str, grid: OrderGrid, candidates_per_job: int | str) -> int:
    """Count the jobs of a phase. Job i estimates ``candidates[i::parts]``, which balances them.

    With ``"auto"`` there is one job, which shares its candidates out among its cores: the graph
    does not depend on the number of cores.

    Examples
    --------
    >>> part_count("joint", OrderGrid(), candidates_per_job=4)
    3
    """
    if candidates_per_job == "auto":
        return 1
    return math.ceil(max_candidate_count(phase, grid) / int(candidates_per_job))


def max_candidates_per_part(phase: str, grid: OrderGrid, candidates_per_job: int | str) -> int:
    """Count the candidates of a phase's largest job, at most."""
    return math.ceil(max_candidate_count(phase, grid) / part_count(phase, grid, candidates_per_job))


def scoring_window(settings: DatasetSettings) -> ScoringWindow:
    """Find the samples on which every candidate of every phase is compared.

    Residuals start behind the longest memory of any candidate, max(na, nb + nk - 1, nc). The loss
    starts ``search.n_initial_discard`` samples later: the unknown initial noise fits the first
    residuals.

    Examples
    --------
    >>> from evopem.config.settings import (
    ...     PreparationSettings, SearchSettings, SpectrumSettings, SyntheticSource
    ... )
    >>> settings = DatasetSettings(
    ...     "arm",
    ...     SyntheticSource("flexible_arm"),
    ...     PreparationSettings(),
    ...     SpectrumSettings(),
    ...     OrderGrid(),
    ...     SearchSettings(n_initial_discard=50),
    ... )
    >>> scoring_window(settings)
    ScoringWindow(residual_start=18, loss_start=68)
    """
    grid = settings.order_grid
    in_delay, joint = grid.delay.orders[1], joint_range(grid.orders.joint, None)[1]
    largest_nb = max(in_delay, joint, grid.orders.nb[1])
    memory = max(in_delay, joint, grid.orders.nc[1], largest_nb + grid.delay.nk[1] - 1)
    return ScoringWindow(memory, memory + settings.search.n_initial_discard)


def sample_requirements(settings: DatasetSettings) -> SampleRequirements:
    """Find what a record must have for the largest candidate of any phase."""
    grid = settings.order_grid
    in_delay, joint = grid.delay.orders[1], joint_range(grid.orders.joint, None)[1]
    window = scoring_window(settings)
    return SampleRequirements(
        loss_start=window.loss_start,
        parameters=max(
            3 * in_delay, 3 * joint, joint + max(joint, grid.orders.nb[1]) + grid.orders.nc[1]
        ),
        settling=window.residual_start + grid.orders.nc[1],
    )


def check_samples(
    requirements: SampleRequirements, estimation: int, validation: int, place: str
) -> None:
    """Refuse a record that is too short for some candidate, before any of them is estimated.

    Every candidate needs more residuals in its loss than parameters. The validation samples have
    to outnumber twice those in which the longest model settles: the initial state of a simulation
    is estimated from them, and would explain fewer by itself.

    Parameters
    ----------
    requirements : SampleRequirements
    estimation, validation : int
        Numbers of prepared samples.
    place : str
        Configuration key of the data set, such as ``datasets.arm``.

    Raises
    ------
    InputError
    """
    left = max(estimation - requirements.loss_start, 0)
    if left <= requirements.parameters:
        raise InputError(
            f"{place}.orders",
            f"the largest model has {requirements.parameters} parameters and {estimation} "
            f"estimation samples, without the first {requirements.loss_start}, leave {left} to "
            "estimate it from",
            "lower the upper ends of delay and orders, shorten split.discard, or record longer",
        )
    least = 2 * requirements.settling
    if validation <= least:
        raise InputError(
            f"{place}.split",
            f"{validation} validation samples are left and more than {least} are needed, twice "
            "the settling time of the longest model",
            "leave more samples to validation, lower the upper ends of delay and orders, or "
            "record longer",
        )


def _inclusive(limits: Range) -> range:
    return range(limits[0], limits[1] + 1)
