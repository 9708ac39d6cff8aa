"""Focus and constraints that contradict the orders of a search, refused before it."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from itertools import product

from evopem.config.channels import RecordedSource, are_one
from evopem.config.constraints import Constraints
from evopem.config.order_grid import inclusive, orders_of_plant, plant_range
from evopem.config.settings import DatasetSettings, FitSettings, OrderGrid
from evopem.config.structures import STRUCTURES, is_polynomial, phases_of, searched_forms
from evopem.errors import InputError
from evopem.models.constraint_checks import check_fit as check
from evopem.models.orders import Orders, orders_of

LARGE = 60  # an order that no search of the automatic recipe exceeds


def known_rate(settings: DatasetSettings) -> float | None:
    """Sampling rate of the prepared samples in Hz; None where only the recording states it."""
    source = settings.source
    if settings.preparation.resample is not None:
        return settings.preparation.resample
    if isinstance(source, RecordedSource):
        return source.channels.sampling_rate
    return source.sampling_rate


def check_fit(
    fit: FitSettings,
    selectable: Iterable[Orders],
    sampling_rate: float | None,
    source: str,
    place: str,
) -> None:
    """Refuse a focus or constraints that some model of orders cannot have."""
    constraints = fit.constraints
    if constraints is not None and sampling_rate is None:
        constraints = _without_frequencies(constraints)
    for orders in selectable:
        with naming_key(orders, source, place):
            check(fit.focus, constraints, orders, sampling_rate or 1.0)


@contextmanager
def naming_key(orders: Orders, source: str, place: str) -> Iterator[None]:
    """Give an error of the estimation, which names its argument, the key and the orders."""
    try:
        yield
    except InputError as error:
        key = ".".join(filter(None, (error.source, error.place)))
        problem = error.problem
        if str(orders) not in problem:
            problem += f" (for {orders}, which the order search may select)"
        raise InputError(source, problem, error.remedy, place + key) from None


def selectable_orders(grid: OrderGrid) -> Iterator[Orders]:
    """The orders that a search may select: all plant orders, and the ends of the other ranges.

    The comparison with neighbouring lags of B at its end may select another nb.
    """
    phases = phases_of(grid.structure)
    plant = inclusive(plant_range(grid) if "plant" in phases else (1, 1))
    names = [phase for phase in phases if phase not in ("delay", "plant")]
    ends = [sorted(set(getattr(grid.ranges, name))) for name in names]
    for k, *values in product(plant, *ends):
        orders = orders_of_plant(k, grid) | dict(zip(names, values, strict=True))
        if any(value for name, value in orders.items() if name != "nk"):
            yield orders_of(grid.structure, orders)


def _without_frequencies(constraints: Constraints) -> Constraints:
    """The constraints whose meaning does not depend on the sampling rate."""
    return replace(
        constraints,
        frequency_band=None,
        forbidden_bands=(),
        fixed_poles=tuple(pole for pole in constraints.fixed_poles if pole.real is not None),
        priors=tuple(p for p in constraints.priors if p.quantity not in ("frequency", "damping")),
    )


def check_planned_fits(datasets: Mapping[str, DatasetSettings], source: str) -> None:
    """Check focus and constraints of polynomials, as far as the configuration shows them.

    Of several inputs they are checked by their names, once the recording is read.
    """
    for name, settings in datasets.items():
        inputs, is_chapter = settings.channels.inputs, settings.automatic is None
        has_polynomials = is_chapter or any(map(is_polynomial, searched_forms(settings)))
        named = are_one(inputs) or not inputs
        if not (has_polynomials and named and settings.fit.changes_model):
            continue
        rate, place, grid = known_rate(settings), f"datasets.{name}.", settings.order_grid
        if settings.automatic is not None:
            structure, fit = settings.automatic.structure, settings.fit
            if structure is None and fit.constraints is not None:
                # Which coefficients there are is not known before the structure.
                known = replace(fit.constraints, fixed_coefficients={}, fixed_poles=(), priors=())
                fit = replace(fit, constraints=known)
            structure = structure or ("armax" if inputs else "arma")
            degrees = {name: 1 if name == "nk" else LARGE for name in STRUCTURES[structure]}
            check_fit(fit, [orders_of(structure, degrees)], rate, source, place)
            continue
        check_fit(settings.fit, selectable_orders(grid), rate, source, place)
        if settings.fit.constraints is not None and rate is not None:
            # Imports numpy, which only a configuration with constraints needs before its first job.
            from evopem.estimation.pem.constrained_model import constrained_parameters

            radius = settings.search.max_root_radius
            for orders in selectable_orders(grid):
                # They may leave no pole, or no polynomial with what is fixed.
                with naming_key(orders, source, place):
                    constrained_parameters(settings.fit.constraints, orders, rate, radius)
