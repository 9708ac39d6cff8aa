"""Evolutionary prediction-error identification of dynamic systems.

The names below are the public interface; they load on first use, so that a light import stays
light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from evopem.version import __version__

if TYPE_CHECKING:
    from evopem.config.constraints import Constraints as Constraints
    from evopem.config.constraints import FixedPole as FixedPole
    from evopem.config.constraints import Prior as Prior
    from evopem.config.settings import ScoringWindow as ScoringWindow
    from evopem.config.settings import SearchSettings as SearchSettings
    from evopem.errors import InputError as InputError
    from evopem.estimation.delays import estimate_delays as estimate_delays
    from evopem.estimation.model_record import load_model as load
    from evopem.estimation.polynomial_estimate import PolynomialEstimate as PolynomialEstimate
    from evopem.estimation.state_space.local_estimates import (
        StateSpaceEstimate as StateSpaceEstimate,
    )
    from evopem.exports.c_code import export_c as export_c
    from evopem.exports.fmu import export_fmu as export_fmu
    from evopem.models.continuous import ContinuousModel as ContinuousModel
    from evopem.models.orders import Orders as Orders
    from evopem.models.polynomial import PolynomialModel as PolynomialModel
    from evopem.models.state_space import StateSpaceModel as StateSpaceModel
    from evopem.models.varying import VaryingModel as VaryingModel
    from evopem.notebook.estimate import estimate as estimate
    from evopem.notebook.identify import estimate_varying as estimate_varying
    from evopem.notebook.identify import identify as identify
    from evopem.notebook.identify import read_results as read_results
    from evopem.notebook.results import Results as Results
    from evopem.notebook.results import VaryingResults as VaryingResults
    from evopem.notebook.state_space import estimates_of_orders as estimates_of_orders
    from evopem.notebook.state_space import fit_responses as fit_responses
    from evopem.results.damage_index import damage_index as damage_index
    from evopem.signals.readers.frequency_responses import FrequencyResponses as FrequencyResponses
    from evopem.signals.recording import Recording as Recording
    from evopem.validation.mode_evidence import ModeTable as ModeTable
    from evopem.validation.mode_evidence import mode_table as mode_table

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
__all__ = ["__version__", "load", *_HOMES]


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name == "load":
        return import_module("evopem.estimation.model_record").load_model
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
