"""Evolutionary prediction-error identification of dynamic systems.

The names below are the public interface; they load on first use, so that a light import stays
light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from evopem.version import __version__

if TYPE_CHECKING:
    from evopem.config.constraints import Constraints, FixedPole, Prior
    from evopem.config.settings import ScoringWindow, SearchSettings
    from evopem.errors import InputError
    from evopem.estimation.delays import estimate_delays
    from evopem.estimation.model_record import load_model as load
    from evopem.estimation.polynomial_estimate import PolynomialEstimate
    from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
    from evopem.exports.c_code import export_c
    from evopem.exports.fmu import export_fmu
    from evopem.models.continuous import ContinuousModel
    from evopem.models.orders import Orders
    from evopem.models.polynomial import PolynomialModel
    from evopem.models.state_space import StateSpaceModel
    from evopem.models.varying import VaryingModel
    from evopem.notebook.estimate import estimate
    from evopem.notebook.identify import estimate_varying, identify, read_results
    from evopem.notebook.results import Results, VaryingResults
    from evopem.notebook.state_space import estimates_of_orders, fit_responses
    from evopem.results.damage_index import damage_index
    from evopem.signals.readers.frequency_responses import FrequencyResponses
    from evopem.signals.recording import Recording
    from evopem.validation.mode_evidence import ModeTable, mode_table

__all__ = [
    "Constraints",
    "ContinuousModel",
    "FixedPole",
    "FrequencyResponses",
    "InputError",
    "ModeTable",
    "Orders",
    "PolynomialEstimate",
    "PolynomialModel",
    "Prior",
    "Recording",
    "Results",
    "ScoringWindow",
    "SearchSettings",
    "StateSpaceEstimate",
    "StateSpaceModel",
    "VaryingModel",
    "VaryingResults",
    "__version__",
    "damage_index",
    "estimate",
    "estimate_delays",
    "estimate_varying",
    "estimates_of_orders",
    "export_c",
    "export_fmu",
    "fit_responses",
    "identify",
    "load",
    "mode_table",
    "read_results",
]

_NAMES = {
    "evopem.config.constraints": "Constraints FixedPole Prior",
    "evopem.config.settings": "ScoringWindow SearchSettings",
    "evopem.errors": "InputError",
    "evopem.estimation.delays": "estimate_delays",
    "evopem.estimation.polynomial_estimate": "PolynomialEstimate",
    "evopem.estimation.state_space.local_estimates": "StateSpaceEstimate",
    "evopem.exports.c_code": "export_c",
    "evopem.exports.fmu": "export_fmu",
    "evopem.models.continuous": "ContinuousModel",
    "evopem.models.orders": "Orders",
    "evopem.models.polynomial": "PolynomialModel",
    "evopem.models.state_space": "StateSpaceModel",
    "evopem.models.varying": "VaryingModel",
    "evopem.notebook.estimate": "estimate",
    "evopem.notebook.identify": "estimate_varying identify read_results",
    "evopem.notebook.results": "Results VaryingResults",
    "evopem.notebook.state_space": "estimates_of_orders fit_responses",
    "evopem.results.damage_index": "damage_index",
    "evopem.signals.readers.frequency_responses": "FrequencyResponses",
    "evopem.signals.recording": "Recording",
    "evopem.validation.mode_evidence": "ModeTable mode_table",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name == "load":
        return import_module("evopem.estimation.model_record").load_model
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
