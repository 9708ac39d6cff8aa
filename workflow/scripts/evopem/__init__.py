"""Evolutionary prediction-error identification of dynamic systems.

The names below are the public interface; they load on first use, so that a light import stays
light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from evopem.version import __version__

if TYPE_CHECKING:
    from evopem.automatic.identify import Identification, identify
    from evopem.config.settings import ScoringWindow, SearchSettings
    from evopem.errors import InputError
    from evopem.estimation.estimate import Estimate
    from evopem.estimation.model_record import load_model as load
    from evopem.estimation.polynomial_estimate import PolynomialEstimate
    from evopem.estimation.structured_estimate import estimate
    from evopem.models.armax import ArmaxModel, Orders
    from evopem.models.polynomial import PolynomialModel
    from evopem.models.structures import PolynomialOrders

__all__ = [
    "ArmaxModel",
    "Estimate",
    "Identification",
    "InputError",
    "Orders",
    "PolynomialEstimate",
    "PolynomialModel",
    "PolynomialOrders",
    "ScoringWindow",
    "SearchSettings",
    "__version__",
    "estimate",
    "identify",
    "load",
]

_HOMES = {
    "ArmaxModel": "evopem.models.armax",
    "Estimate": "evopem.estimation.estimate",
    "Identification": "evopem.automatic.identify",
    "InputError": "evopem.errors",
    "Orders": "evopem.models.armax",
    "PolynomialEstimate": "evopem.estimation.polynomial_estimate",
    "PolynomialModel": "evopem.models.polynomial",
    "PolynomialOrders": "evopem.models.structures",
    "ScoringWindow": "evopem.config.settings",
    "SearchSettings": "evopem.config.settings",
    "estimate": "evopem.estimation.structured_estimate",
    "identify": "evopem.automatic.identify",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name == "load":
        return import_module("evopem.estimation.model_record").load_model
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
