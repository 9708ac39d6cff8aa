"""Sentences about the validation: residual tests and simulation."""

from __future__ import annotations

from evopem.report.numbers import count, is_number, number, p_value, percent, plural, times
from evopem.results.dataset import DatasetResults
from evopem.validation.checks.residuals import WITHOUT_NOISE_MODEL
from evopem.validation.residual_tests import WhitenessTest
from evopem.validation.validation import PairCorrelation, Validation


def residuals(results: DatasetResults) -> list[str]:
    """Outcome of the residual tests."""
    validation = results.validation
    sentences = [
        _autocorrelation(validation),
        _ljung_box(validation.outputs[0].ljung_box),
        *(_cross_correlation(each, validation.correlation_lags) for each in validation.pairs),
    ]
    return [" ".join(sentences)]


def _autocorrelation(validation: Validation) -> str:
    share = validation.outputs[0].autocorrelation_share_inside95
    if not is_number(share):
        return "The autocorrelation of the residuals is not known."
    return (
        f"{percent(100 * share)} of {count(validation.lags)} residual autocorrelations are within"
        f" the 95 % bounds ±1.96/√N, with N = {count(validation.residual_samples)} residuals of the"
        f" {validation.tested} samples. About 95 % are expected of white residuals."
    )


def _ljung_box(test: WhitenessTest) -> str:
    if not is_number(test.p_value):
        return "The Ljung-Box test was not possible."
    return (
        f"The Ljung-Box statistic over {count(test.lags)} lags is {number(test.statistic, 4)};"
        f" {number(test.expected, 4)} is expected of white innovations after this fit:"
        f" {p_value(test.p_value)}."
    )


def _cross_correlation(test: PairCorrelation, lags: int) -> str:
    if not is_number(test.share_inside95):
        return "The cross-correlation of residuals and input is not known."
    return (
        f"{percent(100 * test.share_inside95)} of the cross-correlations with the input at lags"
        f" −{count(lags)} to {count(lags)} are within their 95 % bounds; the largest is"
        f" {number(test.max_abs, 2)}. These bounds take the autocorrelation of residuals and input"
        " into account (Ljung 1999, section 16.6)."
    )


def simulation(results: DatasetResults) -> list[str]:
    """Error of the simulation on samples that were not used for estimation."""
    validation = results.validation
    if not results.model.has_input:
        return [
            "The model has no input, so there is nothing to simulate. The prediction one sample"
            f" ahead has an error of {percent(validation.prediction_error_percent)} of the"
            " deviation of the measured output over"
            f" {plural(validation.samples, 'validation sample')}."
        ]
    sentences = [
        "The simulation uses the input alone. Its error is"
        f" {percent(validation.simulation_error_percent)} of the deviation of the measured output"
        f" ({percent(validation.simulation_fit_percent)} NRMSE fit) over"
        f" {plural(validation.samples, 'validation sample')}."
        + (
            " It runs on from the samples before them, which determine its state."
            if results.model.transforms.validation_source == "cut"
            else " Its state is determined by the samples before those that are scored."
        ),
        "From the initial state that fits these samples best, as in MATLAB's compare, the error is"
        f" {percent(validation.fitted_state_error_percent)}.",
    ]
    sentences += _recorded(results)
    if validation.unscored_samples:
        sentences.append(
            f"The first {plural(validation.unscored_samples, 'sample')} determine the states and"
            " are not scored."
        )
    return [" ".join(sentences)]


def horizons(results: DatasetResults) -> list[str]:
    """How the error of the prediction grows with its horizon."""
    horizons, errors = results.validation.horizons, results.validation.horizon_errors_percent
    text = (
        "A prediction k samples ahead knows the input up to the predicted sample and the output up"
        f" to k samples before. Its error is {percent(errors[0])} at k = {horizons[0]}"
    )
    if len(horizons) > 1:
        text += f" and {percent(errors[-1])} at k = {count(horizons[-1])}"
    text += "."
    if results.model.structure in WITHOUT_NOISE_MODEL:
        text += " Without a noise model it does not depend on the horizon."
    elif results.model.has_input:
        text += " With growing k it approaches the error of the simulation."
    return [text]


def _recorded(results: DatasetResults) -> list[str]:
    """The simulation in recorded units, where transforms make that another quantity."""
    recorded = results.validation.outputs[0].recorded
    if not results.model.transforms.changes_output:
        return []
    text = (
        "In the units of the recording the one-step error is"
        f" {percent(recorded.prediction_error_percent)} and the error of the simulation"
        f" {percent(recorded.simulation_error_percent)}."
    )
    if recorded.integrations:
        text += (
            " The inverse of differencing integrates the error of the simulation"
            f" {times(recorded.integrations)}. This error drifts, and depends more on the length of"
            " the recording than on the model."
        )
    if recorded.undefined_samples:
        text += (
            f" {plural(recorded.undefined_samples, 'simulated sample')} outside the range of the"
            " Box-Cox transform have no recorded value."
        )
    return [text]
