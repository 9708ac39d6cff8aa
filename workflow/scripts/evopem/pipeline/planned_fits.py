"""Focus and constraints of all data sets, checked when a run is planned."""

from __future__ import annotations

from collections.abc import Mapping

from evopem.config.constraints import Constraints
from evopem.config.settings import DatasetSettings
from evopem.models.structures import Orders
from evopem.pipeline.constraint_plan import check_fit, known_rate, naming_key, selectable_orders


def check_planned_fits(datasets: Mapping[str, DatasetSettings], source: str) -> None:
    """Check focus and constraints of every data set, as far as the configuration shows it.

    Raises InputError naming the key.
    """
    for name, settings in datasets.items():
        if not settings.fit.changes_model:
            continue
        rate, place, grid = known_rate(settings), f"datasets.{name}.", settings.order_grid
        check_fit(settings.fit, grid, rate, source, place)
        if settings.fit.constraints is not None and rate is not None:
            for orders in selectable_orders(grid):
                with naming_key(orders, source, place):
                    _check_region(settings, settings.fit.constraints, orders, rate)


def _check_region(
    settings: DatasetSettings, constraints: Constraints, orders: Orders, rate: float
) -> None:
    """Refuse constraints that leave no pole, or no polynomial with what is fixed."""
    # Imports numpy, which only a configuration with constraints needs before its first job.
    from evopem.estimation.constrained_model import constrained_parameters

    constrained_parameters(constraints, orders, rate, settings.search.max_root_radius)
