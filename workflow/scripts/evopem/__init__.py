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

_HOMES = {
    "Results": "evopem.notebook.results",
    "Constraints": "evopem.config.constraints",
    "ContinuousModel": "evopem.models.continuous",
    "FrequencyResponses": "evopem.signals.readers.frequency_responses",
    "fit_responses": "evopem.notebook.state_space",
    "FixedPole": "evopem.config.constraints",
    "InputError": "evopem.errors",
    "PolynomialEstimate": "evopem.estimation.polynomial_estimate",
    "PolynomialModel": "evopem.models.polynomial",
    "Orders": "evopem.models.orders",
    "Prior": "evopem.config.constraints",
    "Recording": "evopem.signals.recording",
    "ScoringWindow": "evopem.config.settings",
    "SearchSettings": "evopem.config.settings",
    "StateSpaceEstimate": "evopem.estimation.state_space.local_estimates",
    "StateSpaceModel": "evopem.models.state_space",
    "estimate": "evopem.notebook.estimate",
    "identify": "evopem.notebook.identify",
    "read_results": "evopem.notebook.identify",
    "damage_index": "evopem.results.damage_index",
    "estimate_delays": "evopem.estimation.delays",
    "mode_table": "evopem.validation.mode_evidence",
    "ModeTable": "evopem.validation.mode_evidence",
    "estimates_of_orders": "evopem.notebook.state_space",
    "export_c": "evopem.exports.c_code",
    "export_fmu": "evopem.exports.fmu",
    "VaryingResults": "evopem.notebook.results",
    "VaryingModel": "evopem.models.varying",
    "estimate_varying": "evopem.notebook.identify",
}


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name == "load":
        return import_module("evopem.estimation.model_record").load_model
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
