"""Evolutionary prediction-error identification of dynamic systems.

The names below are the public interface; they load on first use, so that a light import stays
light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evopem.errors import InputError
    from evopem.estimation.estimate import Estimate, estimate
    from evopem.estimation.search.memetic import SearchSettings
    from evopem.models.armax import ArmaxModel, Orders
    from evopem.models.files import load

__version__ = "0.1.0"
__all__ = ["ArmaxModel", "Estimate", "InputError", "Orders", "SearchSettings", "estimate", "load"]

_HOMES = {
    "ArmaxModel": "evopem.models.armax",
    "Estimate": "evopem.estimation.estimate",
    "InputError": "evopem.errors",
    "Orders": "evopem.models.armax",
    "SearchSettings": "evopem.estimation.search.memetic",
    "estimate": "evopem.estimation.estimate",
    "load": "evopem.models.files",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
