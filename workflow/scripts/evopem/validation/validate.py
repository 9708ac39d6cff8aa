"""A fitted model against the data: residual tests, prediction, and pure simulation.

Prediction and simulation answer different questions and are never mixed. The one-step prediction
uses every measured output up to the sample before; the simulation sees the input alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.config.settings import OBJECTIVES, SpectrumSettings
from evopem.errors import InputError, check_choice
from evopem.models.polynomial import PolynomialModel
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Recording
from evopem.signals.spectral.frequency_response import FrequencyResponse, frequency_response
from evopem.validation.excitation import excitation_order
from evopem.validation.held_out_tests import HeldOutTest, input_significance
from evopem.validation.mode_evidence import NO_TEST, ModeEvidence, mode_evidence
from evopem.validation.peak_evidence import peak_evidence
from evopem.validation.recorded_units import (
    recorded_errors,
    recorded_series,
)
from evopem.validation.residual_tests import (
    CROSS_CORRELATION_LAGS,
    cross_correlation,
    ljung_box_lags,
    residual_autocorrelation,
    share_inside,
    whiteness_test,
)
from evopem.validation.responses import (
    HeldOutSamples,
    held_out_samples,
    responses_of,
    simulation_table,
    unscored_samples,
)
from evopem.validation.scores import error_percent, fit_percent, outlier_percent
from evopem.validation.split_spectra import SplitSpectra, split_spectra
from evopem.validation.tested_residuals import TestedResiduals, tested_residuals
from evopem.validation.validation import (
    CrossCorrelationTest,
    Excitation,
    HorizonError,
    Validation,
    ValidationTables,
)
from evopem.validation.whiteness import WhitenessTest

Array = NDArray[np.float64]

# Horizons of a decade, and the longest one.
DECADE = (1, 2, 3, 5, 7)
LONGEST = 1000


def log_spaced_horizons(samples: int) -> tuple[int, ...]:
    """Horizons about evenly spaced in their logarithm, up to a quarter of a record.

    Examples
    --------
    >>> log_spaced_horizons(200)
    (1, 2, 3, 5, 7, 10, 20, 30, 50)
    """
    last = max(1, min(LONGEST, samples // 4))
    every = (10**decade * step for decade in range(4) for step in DECADE)
    return tuple(horizon for horizon in every if horizon <= last)


@dataclass(frozen=True)
class PredictedStretch:
    """A stretch to predict, with the model and states of its prediction.

    Attributes
    ----------
    model : PolynomialModel
    input, output : (N,) arrays
    states : (plant state, noise state)
        As for :meth:`PolynomialModel.predict`.
    first : int
        First sample that counts.
    """

    model: PolynomialModel
    input: Array
    output: Array
    states: tuple[Array, Array]
    first: int

    def ahead(self, horizon: int) -> Array:
        """Predictions of the samples that count."""
        return self.model.predict(self.input, self.output, horizon, *self.states)[self.first :]


def horizon_errors(stretches: Sequence[PredictedStretch], horizons: Sequence[int]) -> Array:
    """Errors ``100 ||y - yhat|| / ||y - mean(y)||`` of k-step predictions, one for each horizon.

    Parameters
    ----------
    stretches : sequence of PredictedStretch
    horizons : sequence of int
        Samples, each at least 1.
    """
    measured = np.concatenate([each.output[each.first :] for each in stretches])
    return np.array(
        [
            error_percent(measured, np.concatenate([each.ahead(horizon) for each in stretches]))
            for horizon in horizons
        ]
    )


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
        Whether a constant level of the simulation is fitted to the validation samples.

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

    The simulation of the validation samples sees none of their output, but for a level where one is
    fitted.  When they continue the estimation samples (``before_validation``) it runs on from
    these, which determine its state; else the first tenth of a recording does, and is not scored.
    A second simulation starts from the initial state that fits the validation samples best, as
    MATLAB's ``compare`` has it (``fitted_state_error_percent``): poles near the unit circle that
    zeros nearly cancel let such a state draw slow waves through drifts.

    The predictor runs through both parts of a continuous record, so that it knows all the measured
    past.  An independent recording has no past on record: there the predictor starts with the
    recording, its states are fitted to it, and its first tenth is not scored, or at least the first
    max(na, nb + nk − 1) samples and the max(nc, nd, nf) after them.

    Of a model without input there is no simulation, and no test concerns the input.
    """
    check_choice("objective", objective, OBJECTIVES)
    spectrum = spectrum or SpectrumSettings()
    estimation = prepared.estimation
    start = unscored_samples(model) if loss_start is None else loss_start
    tested = tested_residuals(model, estimation, start, objective)
    if tested.residuals.size < 2:
        raise ValueError(
            f"{estimation.output.size} estimation samples leave no residuals from sample {start} on"
        )
    autocorrelation = residual_autocorrelation(tested.residuals, lags)
    cross = cross_correlation(tested.residuals, tested.input, min(lags, CROSS_CORRELATION_LAGS))
    held_out = held_out_samples(model, prepared, free_level)
    responses = responses_of(model, prepared, held_out, free_level)
    scored = responses.scored
    measured = responses.output[scored]
    if measured.size == 0:
        raise ValueError("no validation sample is left to score; keep more samples for validation")
    by_horizon = _horizons(held_out, int(np.argmax(scored)), measured.size)
    recorded = recorded_series(
        prepared.transforms, responses.output, responses.predicted, responses.simulated
    )
    largest = len(autocorrelation) - 1
    input_test, modes = _tests_on_held_out(held_out, estimation.longest, spectrum, others)
    validation = Validation(
        prediction_error_percent=error_percent(measured, responses.predicted[scored]),
        simulation_error_percent=error_percent(measured, responses.simulated[scored]),
        prediction_fit_percent=fit_percent(measured, responses.predicted[scored]),
        simulation_fit_percent=fit_percent(measured, responses.simulated[scored]),
        fitted_state_error_percent=error_percent(measured, responses.fitted[scored]),
        samples=measured.size,
        unscored_samples=int(np.sum(~scored)),
        residual_samples=tested.residuals.size,
        autocorrelation_share_inside95=share_inside(
            autocorrelation["autocorrelation"].iloc[1:], autocorrelation["bound95"].iloc[1:]
        ),
        lags=largest,
        ljung_box=_whiteness(tested, model, largest, objective),
        cross_correlation=_cross_correlation_test(cross),
        residual_outlier_percent=outlier_percent(tested.residuals),
        excitation=_excitation(model, estimation),
        recorded=recorded_errors(prepared.transforms, recorded, scored),
        input_test=input_test,
        modes=modes,
        peaks=peak_evidence(model, estimation.longest, spectrum),
        split=_split(model, prepared, measured.size),
        horizons=by_horizon,
    )
    simulation = simulation_table(responses, recorded, estimation.sampling_rate)
    return validation, ValidationTables(
        autocorrelation, cross, simulation, _horizon_table(by_horizon, estimation.sampling_rate)
    )


def _excitation(model: PolynomialModel, estimation: Recording) -> Excitation:
    """Order of excitation of the input, and what the model needs; 0 without an input."""
    if not model.has_input:
        return Excitation(excitation_order(np.zeros_like(estimation.output), 0), 0)
    orders = model.orders
    needed = orders.na + orders.single.nf + orders.single.nb
    return Excitation(excitation_order(estimation.input, needed), needed)


def _split(model: PolynomialModel, prepared: PreparedData, scored: int) -> SplitSpectra:
    """The input's spectra in both parts; none can be compared without an input."""
    estimation, validation = prepared.estimation, prepared.validation
    inputs = estimation.input, validation.input
    if not model.has_input:
        inputs = np.zeros_like(estimation.output), np.zeros(scored)
    return split_spectra(*inputs, estimation.sampling_rate)


def _tests_on_held_out(
    held_out: Sequence[HeldOutSamples],
    estimation: Recording,
    spectrum: SpectrumSettings,
    others: Sequence[PolynomialModel],
) -> tuple[HeldOutTest, tuple[ModeEvidence, ...]]:
    """Tests of the input and of each mode on the longest stretch of held-out samples."""
    longest = max(held_out, key=lambda each: each.samples)
    model, samples = longest.model, (longest.input, longest.output, longest.first)
    has_input = model.has_input
    coherence = _coherence(estimation, spectrum) if has_input else None
    input_test = input_significance(model, *samples) if has_input else NO_TEST
    modes = mode_evidence(model, *samples, longest.states, coherence, others)
    return input_test, tuple(modes)


def _cross_correlation_test(table: pd.DataFrame) -> CrossCorrelationTest:
    """What the table of the cross-correlation says of its bounds."""
    correlation, bound = table["cross_correlation"], table["bound95"]
    return CrossCorrelationTest(
        share_inside95=share_inside(correlation, bound),
        max_abs=float(correlation.abs().max()),
        max_in_bounds=float((correlation.abs() / bound).max()),
        lags=int(table["lag"].max()),
    )


def _horizons(
    held_out: Sequence[HeldOutSamples], unscored: int, scored: int
) -> tuple[HorizonError, ...]:
    """Errors of k-step predictions, where the first samples are not scored."""
    longest = max(each.samples for each in held_out)
    horizons = log_spaced_horizons(min(longest - unscored, scored))
    stretches = [
        PredictedStretch(
            *(each.model, each.input, each.output, each.states),
            len(each.output) - each.samples + unscored,
        )
        for each in held_out
    ]
    errors = horizon_errors(stretches, horizons)
    return tuple(map(HorizonError, horizons, errors.tolist()))


def _horizon_table(errors: Sequence[HorizonError], sampling_rate: float) -> pd.DataFrame:
    """The errors by horizon in samples and in seconds."""
    horizons = np.array([each.samples for each in errors])
    return pd.DataFrame(
        {
            "horizon": horizons,
            "horizon_s": horizons / sampling_rate,
            "error_percent": [each.error_percent for each in errors],
        }
    )


def _whiteness(
    tested: TestedResiduals, model: PolynomialModel, largest: int, objective: str
) -> WhitenessTest:
    """Joint test of the residuals over some lags up to the largest; NaN where there are too few."""
    orders = model.orders
    lags = ljung_box_lags(tested.residuals.size, orders.na + orders.nc + orders.nd, largest)
    if not 0 < lags < tested.residuals.size:
        return WhitenessTest(math.nan, math.nan, math.nan, max(lags, 0))
    return whiteness_test(tested.residuals, tested.jacobian(), lags, objective)


def _coherence(estimation: Recording, settings: SpectrumSettings) -> FrequencyResponse | None:
    """Empirical frequency response with its coherence; None where no spectrum can be estimated."""
    try:
        return frequency_response(estimation, settings.time_halfbandwidth, settings.nfft)
    except InputError:
        return None
