"""The results of a validation: errors, residual tests, and the series behind them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from evopem.validation.held_out_tests import HeldOutTest
from evopem.validation.mode_evidence import ModeEvidence
from evopem.validation.peak_evidence import PeakEvidence
from evopem.validation.recorded_units import RecordedErrors
from evopem.validation.split_spectra import SplitSpectra
from evopem.validation.whiteness import WhitenessTest

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class CrossCorrelationTest:
    """Cross-correlation of residuals and input against its 95 % bounds.

    Attributes
    ----------
    share_inside95 : float
        Share of the lags inside the bounds.
    max_abs : float
        Largest correlation.
    max_in_bounds : float
        Largest correlation, in units of its bound.
    lags : int
        Largest lag to either side.
    """

    share_inside95: float
    max_abs: float
    max_in_bounds: float
    lags: int


@dataclass(frozen=True)
class Excitation:
    """Order of excitation of the input, and the order that the model needs."""

    order: int
    needed: int


@dataclass(frozen=True)
class HorizonError:
    """Error of predictions some samples ahead, in percent.

    Attributes
    ----------
    samples : int
        Horizon k: the prediction knows the outputs up to k samples before.
    error_percent : float
        ``100 ||y - yhat|| / ||y - mean(y)||``.
    """

    samples: int
    error_percent: float


@dataclass(frozen=True)
class Validation:
    """Errors and residual tests of one model; NaN where a number could not be computed.

    Errors are ``100 ||y - yhat|| / ||y - mean(y)||`` over the scored validation samples, and fits
    are 100 minus the error, as MATLAB's ``compare`` has them.

    Attributes
    ----------
    prediction_error_percent, prediction_fit_percent : float
        One step ahead.
    simulation_error_percent, simulation_fit_percent : float
        Of a simulation that runs on from the estimation samples, or in another recording from the
        state that its first samples determine; NaN without an input.
    fitted_state_error_percent : float
        Of a simulation from the initial state that fits the validation samples best.
    samples, unscored_samples : int
        Validation samples that are scored, and those before them that are not.
    residual_samples : int
        Residuals of the estimation samples that the tests use.
    autocorrelation_share_inside95 : float
        Share of the residual autocorrelations inside their 95 % bounds.
    lags : int
        Largest lag of the residual autocorrelation.
    ljung_box : WhitenessTest
    cross_correlation : CrossCorrelationTest
    residual_outlier_percent : float
        Percentage of residuals beyond five robust standard deviations.
    excitation : Excitation
    recorded : RecordedErrors
        The errors in the units of the recording.
    input_test : HeldOutTest
        Of the response to the input, on samples that the model was not estimated from.
    modes : tuple of ModeEvidence
        For each mode whether the input reaches it, whether it is stable over the orders, and
        whether the noise model needs it.
    peaks : tuple of PeakEvidence
        For each peak of the output's spectrum whether the model gives the output that much power.
    split : SplitSpectra
        The input's spectra in the estimation and the validation samples beside each other.
    horizons : tuple of HorizonError
        Errors of k-step predictions of the scored validation samples, by k.
    """

    prediction_error_percent: float
    simulation_error_percent: float
    prediction_fit_percent: float
    simulation_fit_percent: float
    fitted_state_error_percent: float
    samples: int
    unscored_samples: int
    residual_samples: int
    autocorrelation_share_inside95: float
    lags: int
    ljung_box: WhitenessTest
    cross_correlation: CrossCorrelationTest
    residual_outlier_percent: float
    excitation: Excitation
    recorded: RecordedErrors
    input_test: HeldOutTest
    modes: tuple[ModeEvidence, ...]
    peaks: tuple[PeakEvidence, ...]
    split: SplitSpectra
    horizons: tuple[HorizonError, ...]


@dataclass(frozen=True, eq=False)
class ValidationTables:
    """The series behind a validation.

    Attributes
    ----------
    residual_autocorrelation, cross_correlation : pandas.DataFrame
        By lag, with their 95 % bounds.
    simulation : pandas.DataFrame
        Validation samples, predicted and simulated.
    horizons : pandas.DataFrame
        Error of k-step predictions, by k in samples and seconds.
    """

    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame
    simulation: pd.DataFrame
    horizons: pd.DataFrame
