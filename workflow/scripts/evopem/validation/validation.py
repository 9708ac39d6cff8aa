"""A fitted model against the data: residual tests, prediction, and pure simulation.

Prediction and simulation answer different questions and are never mixed. The one-step prediction
uses every measured output up to the sample before; the simulation sees the input alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.config.settings import OBJECTIVES, SpectrumSettings
from evopem.errors import InputError, check_choice
from evopem.signals.spectral.frequency_response import (
    FrequencyResponse,
    multitaper_frequency_response,
)
from evopem.validation.excitation import excitation_order
from evopem.validation.held_out_tests import HeldOutTest, input_significance
from evopem.validation.horizons import PredictedStretch, horizon_errors, log_spaced_horizons
from evopem.validation.mode_evidence import NO_TEST, ModeEvidence, mode_evidence
from evopem.validation.peak_evidence import PeakEvidence, peak_evidence
from evopem.validation.recorded_units import (
    RecordedErrors,
    recorded_errors,
    recorded_series,
)
from evopem.validation.residual_tests import (
    CROSS_CORRELATION_LAGS,
    WhitenessTest,
    cross_correlation,
    ljung_box_lags,
    residual_autocorrelation,
    share_inside,
    whiteness_test,
)
from evopem.validation.responses import (
    held_out_samples,
    responses_of,
    simulation_table,
    unscored_samples,
)
from evopem.validation.scores import error_percent, fit_percent, outlier_percent
from evopem.validation.split_spectra import SplitSpectra, split_spectra
from evopem.validation.tested_residuals import TestedResiduals, tested_residuals

if TYPE_CHECKING:
    from evopem.models.polynomial import PolynomialModel
    from evopem.signals.preparation import PreparedData
    from evopem.signals.recording import Recording


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
        From the initial state that fits the validation samples best; NaN without an input.
    continued_simulation_error_percent : float, optional
        Of a simulation that starts with the estimation samples and runs on; None where the
        validation samples do not continue the estimation samples.
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
    continued_simulation_error_percent: float | None
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


def validate(
    model: PolynomialModel,
    prepared: PreparedData,
    loss_start: int | None = None,
    objective: str = "quadratic",
    others: Sequence[PolynomialModel] = (),
    spectrum: SpectrumSettings | None = None,
    lags: int = 1200,
    free_level: bool = False,
) -> tuple[Validation, ValidationTables]:
    """Validate a model on the estimation samples and on samples it was not estimated from.

    Parameters
    ----------
    model : PolynomialModel
    prepared : PreparedData
        Estimation and validation samples, transformed alike.
    loss_start : int, optional
        First estimation sample whose residual is used. By default the first one that the states of
        plant and noise do not fit.
    objective : {"absolute", "quadratic"}
        What the estimate minimised.
    others : sequence of PolynomialModel
        Models of other orders of the same samples, for the stability of the modes.
    spectrum : SpectrumSettings, optional
        Of the multitaper estimates of the output's spectrum and of the coherence.
    lags : int
        Largest lag of the residual autocorrelation; cut to the number of residuals less one.
    free_level : bool
        Whether the simulation fits its level to the validation samples, as it fits the initial
        state.

    Returns
    -------
    Validation, ValidationTables

    Raises
    ------
    ValueError
        When too few samples are left for a test, or the objective is not known.

    Notes
    -----
    Residual tests use the estimation samples (Ljung 1999, section 16.6), from the states that fit
    them best; the residuals of several stretches stand one after the other.  Where the validation
    samples are several stretches, each has its own states, and the tests of the input and of modes
    use the longest.

    The simulation of the validation samples starts from the initial state that fits them best, as
    MATLAB's ``compare`` has it: a few numbers, and nothing else, come from the output it is
    compared with.  When the validation samples continue the estimation samples
    (``prepared.contiguous``), a stricter simulation goes with it: it starts with the estimation
    samples, to which alone its state is fitted, and runs on without seeing one validation output
    (``continued_simulation_error_percent``).

    The predictor runs through both parts of a continuous record, so that it knows all the measured
    past.  An independent recording has no past on record: there the predictor starts with the
    recording, its states are fitted to it, and the first max(na, nb + nk − 1) samples and the
    max(nc, nd, nf) after them are not scored.

    Of a model without input there is no simulation, and no test concerns the input.
    """
    check_choice("objective", objective, OBJECTIVES)
    estimation = prepared.estimation
    inputs = estimation.input if model.has_input else np.zeros_like(estimation.output)
    orders = model.orders
    start = unscored_samples(model) if loss_start is None else loss_start
    tested = tested_residuals(model, estimation, start, objective)
    residuals = tested.residuals
    if residuals.size < 2:
        raise ValueError(
            f"{estimation.output.size} estimation samples leave no residuals from sample {start} on"
        )
    autocorrelation = residual_autocorrelation(residuals, lags)
    largest = len(autocorrelation) - 1
    cross = cross_correlation(residuals, tested.input, min(lags, CROSS_CORRELATION_LAGS))
    noise_parameters = orders.na + orders.nc + orders.nd
    tested_lags = ljung_box_lags(residuals.size, noise_parameters, largest)
    coherence = None
    if model.has_input:
        coherence = _coherence(estimation.longest, spectrum or SpectrumSettings())
    held_out = held_out_samples(model, prepared, free_level)
    longest = max(held_out, key=lambda each: each.samples)
    responses = responses_of(model, prepared, held_out, free_level)
    scored = responses.scored
    measured = responses.output[scored]
    if measured.size == 0:
        raise ValueError("no validation sample is left to score; keep more samples for validation")
    unscored = int(np.argmax(scored))
    horizons = log_spaced_horizons(min(longest.samples - unscored, measured.size))
    errors = horizon_errors(
        [
            PredictedStretch(
                *(each.model, each.input, each.output, each.states),
                len(each.output) - each.samples + unscored,
            )
            for each in held_out
        ],
        horizons,
    )
    recorded = recorded_series(
        prepared.transforms, responses.output, responses.predicted, responses.simulated
    )
    needed = orders.na + orders.nf + orders.nb if model.has_input else 0
    ratio = cross["cross_correlation"].abs() / cross["bound95"]
    validation = Validation(
        prediction_error_percent=error_percent(measured, responses.predicted[scored]),
        simulation_error_percent=error_percent(measured, responses.simulated[scored]),
        prediction_fit_percent=fit_percent(measured, responses.predicted[scored]),
        simulation_fit_percent=fit_percent(measured, responses.simulated[scored]),
        continued_simulation_error_percent=(
            None
            if responses.continued is None
            else error_percent(measured, responses.continued[scored])
        ),
        samples=measured.size,
        unscored_samples=int(np.sum(~scored)),
        residual_samples=residuals.size,
        autocorrelation_share_inside95=share_inside(
            autocorrelation["autocorrelation"].iloc[1:], autocorrelation["bound95"].iloc[1:]
        ),
        lags=largest,
        ljung_box=_whiteness(tested, tested_lags, objective),
        cross_correlation=CrossCorrelationTest(
            share_inside95=share_inside(cross["cross_correlation"], cross["bound95"]),
            max_abs=float(cross["cross_correlation"].abs().max()),
            max_in_bounds=float(ratio.max()),
            lags=int(cross["lag"].max()),
        ),
        residual_outlier_percent=outlier_percent(residuals),
        excitation=Excitation(
            order=excitation_order(inputs, needed),
            needed=needed,
        ),
        recorded=recorded_errors(prepared.transforms, recorded, scored),
        input_test=(
            input_significance(longest.model, longest.input, longest.output, longest.first)
            if model.has_input
            else NO_TEST
        ),
        modes=tuple(
            mode_evidence(
                longest.model,
                longest.input,
                longest.output,
                longest.first,
                longest.states,
                coherence,
                others,
            )
        ),
        peaks=peak_evidence(model, estimation.longest, spectrum or SpectrumSettings()),
        split=split_spectra(
            inputs,
            prepared.validation.input if model.has_input else np.zeros(measured.size),
            estimation.sampling_rate,
        ),
        horizons=tuple(map(HorizonError, horizons, errors.tolist())),
    )
    simulation = simulation_table(responses, recorded, estimation.sampling_rate)
    by_horizon = pd.DataFrame(
        {
            "horizon": horizons,
            "horizon_s": np.array(horizons) / estimation.sampling_rate,
            "error_percent": errors,
        }
    )
    return validation, ValidationTables(autocorrelation, cross, simulation, by_horizon)


def _whiteness(tested: TestedResiduals, lags: int, objective: str) -> WhitenessTest:
    """Joint test of the residuals; NaN where there are too few."""
    if not 0 < lags < tested.residuals.size:
        return WhitenessTest(math.nan, math.nan, math.nan, max(lags, 0))
    return whiteness_test(tested.residuals, tested.jacobian(), lags, objective)


def _coherence(estimation: Recording, settings: SpectrumSettings) -> FrequencyResponse | None:
    """Empirical frequency response with its coherence; None where no spectrum can be estimated."""
    try:
        return multitaper_frequency_response(
            estimation.input,
            estimation.output,
            estimation.sampling_rate,
            settings.time_halfbandwidth,
            settings.nfft,
        )
    except InputError:
        return None
