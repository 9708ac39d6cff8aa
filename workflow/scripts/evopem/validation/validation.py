"""The results of a validation: errors, residual tests, and the series behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from evopem.validation.distortion import NOT_TESTED, Distortion, Floor
from evopem.validation.held_out_tests import HeldOutTest
from evopem.validation.mode_evidence import ModeTable
from evopem.validation.model_class import ModelClass
from evopem.validation.residual_tests import WhitenessTest
from evopem.validation.spectra import PeakEvidence, SplitSpectra

if TYPE_CHECKING:
    import pandas as pd

# One-step errors up to this, in percent, are rounding errors: single precision leaves 1e-6.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Check:
    """One check of a model."""

    name: str
    """what is checked, a name that stays the same"""
    passed: bool | None
    """null where the check could not be judged"""
    statement: str
    """what was found, with its numbers"""
    advice: str = ""
    """what to do about it; empty for a check that passed"""
    grade: Literal["defect", "caution", "note"] = "defect"
    """what it means where the check failed. defect: the model or its numbers are wrong for a use;
    caution: they hold with a reservation; note: it is no statement about the model"""
    follows_from: str = ""
    """the failed check whose cause explains this one as well: a caution, and no cause of its own"""

    @property
    def word(self) -> str:
        """What a reader reads of the outcome: "Passed", "Failed", "Caution", "Note"."""
        if self.passed is not False:
            return "Passed" if self.passed else "Not judged"
        return "Failed" if self.grade == "defect" else self.grade.capitalize()


@dataclass(frozen=True)
class RecordedErrors:
    """Errors of an output in the units of the recording, over the scored validation samples."""

    # prediction_error_percent, simulation_error_percent: ``100 ||y - yhat|| / ||y - mean(y)||``;
    # NaN where no sample is defined
    prediction_error_percent: float
    simulation_error_percent: float
    # Simulated samples that leave the range of the Box-Cox transform and have no recorded value
    undefined_samples: int
    # Number of times that the inverse of differencing sums up the error of the simulation. From 1
    # on this error drifts, and its percentage grows with the length of the record
    integrations: int


@dataclass(frozen=True)
class OutputValidation:
    """Errors and tests of one output; NaN where a number could not be computed."""

    name: str
    unit: str
    # The three errors as of :class:`Validation`
    prediction_error_percent: float
    simulation_error_percent: float
    fitted_state_error_percent: float
    recorded: RecordedErrors  # the errors in the units of the recording
    # Errors of predictions, by the horizons of the validation
    horizon_errors_percent: tuple[float, ...]
    ljung_box: WhitenessTest
    # Share of the residual autocorrelations inside their 95 % bounds
    autocorrelation_share_inside95: float
    outlier_percent: float  # percentage of residuals beyond five robust standard deviations
    # For each peak of the output's spectrum whether the model gives the output that much power
    peaks: tuple[PeakEvidence, ...]


@dataclass(frozen=True)
class InputValidation:
    """What is known of one input."""

    name: str
    excitation_order: int  # of persistent excitation
    excitation_needed: int  # coefficients of the plant; 0 for a state-space model
    split: SplitSpectra  # its spectra in estimation and validation samples beside each other
    hidden_hz: tuple[tuple[float, float], ...]  # where the others hide its response
    test: HeldOutTest  # as that of all inputs, of its response beside those to the others
    may_follow: bool = False  # whether it may follow noise of the same sample


@dataclass(frozen=True)
class PairCorrelation:
    """Cross-correlation of the residuals of an output with an input against its 95 % bounds."""

    output: str
    input: str
    p_value: float  # of the sum of squares of all correlations
    max_in_bounds: float  # largest correlation, in units of its bound


@dataclass(frozen=True)
class StretchErrors:
    """Errors on one stretch of validation samples in percent, means over the outputs."""

    samples: int
    prediction_error_percent: float
    simulation_error_percent: float


@dataclass(frozen=True, eq=False)
class Validation:
    """Errors and residual tests of a model; NaN where a number could not be computed.

    Errors are ``100 ||y - yhat|| / ||y - mean(y)||`` over the scored validation samples, means over
    the outputs, and fits are 100 minus the error, as MATLAB's ``compare`` has them.
    """

    # samples, unscored_samples: validation samples that are scored, and those before them
    samples: int
    unscored_samples: int
    prediction_error_percent: float  # one step ahead
    # Of a simulation that runs on from the estimation samples, or in another recording from the
    # state that its first samples determine; NaN without an input
    simulation_error_percent: float
    # Of a simulation from the initial state that fits the validation samples best
    fitted_state_error_percent: float
    outputs: tuple[OutputValidation, ...]
    inputs: tuple[InputValidation, ...]
    pairs: tuple[PairCorrelation, ...]  # of each output with each input
    horizons: tuple[int, ...]  # samples ahead of the predictions
    stretches: tuple[StretchErrors, ...]
    residual_samples: int  # estimation samples whose residuals the tests use
    # lags, correlation_lags: largest lag of the residual autocorrelations, and of the
    # cross-correlations to either side
    lags: int
    correlation_lags: int
    # Of the response of all outputs to the inputs, on samples that the model was not estimated from
    input_test: HeldOutTest
    model_class: ModelClass  # tests of what every model assumes, on all samples
    resolution_hz: float  # of the spectra whose peaks are judged
    modes: ModeTable
    # Smallest share that fitted states leave of records of the model's own noise
    share_of_noise: float = math.nan
    distortion: Distortion = NOT_TESTED  # what no linear model explains of the response
    floors: tuple[Floor, ...] = ()  # of the simulation error, of each output; none where not known
    # Of a model of frequency responses, whose errors at frequencies are judged; else of a recording
    checks: tuple[Check, ...] = ()

    @property
    def without_noise(self) -> bool:
        """Whether the one-step errors are as small as rounding errors."""
        return self.prediction_error_percent <= ROUNDING

    @property
    def at_floor(self) -> bool:
        """Whether all outputs are simulated as well as by any linear model, as far as is known."""
        return bool(self.floors) and all(floor.reached for floor in self.floors)

    @property
    def horizon_errors_percent(self) -> tuple[float, ...]:
        """Errors of predictions by horizon, means over the outputs."""
        errors = [output.horizon_errors_percent for output in self.outputs]
        return tuple(np.mean(errors, axis=0).tolist())


@dataclass(frozen=True, eq=False)
class ValidationTables:
    """The series behind a validation, as in the CSV files of these names."""

    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame
    simulation: pd.DataFrame
    horizons: pd.DataFrame
