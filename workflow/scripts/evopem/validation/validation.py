"""A fitted model against the data: residual tests, prediction, and pure simulation.

Prediction and simulation answer different questions and are never mixed. The one-step prediction
uses every measured output up to the sample before; the simulation sees the input alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.models.initial_state import estimate_initial_state, estimate_noise_state
from evopem.validation.excitation import excitation_order
from evopem.validation.residual_tests import (
    LjungBox,
    cross_correlation,
    ljung_box,
    ljung_box_lags,
    residual_autocorrelation,
    share_inside,
)
from evopem.validation.scores import error_percent, fit_percent, outlier_percent

if TYPE_CHECKING:
    from evopem.models.armax import ArmaxModel
    from evopem.signals.preparation import PreparedData
    from evopem.signals.recording import Recording

# Missed dynamics and feedback show at short lags; more lags only dilute the test.
CROSS_CORRELATION_LAGS = 200


@dataclass(frozen=True)
class Validation:
    """Everything the validation of one model yields.

    Percentages refer to the scored validation samples; ``samples`` is their number. Errors are
    100 ‖y − ŷ‖/‖y‖, fits 100 (1 − ‖y − ŷ‖/‖y − ȳ‖).  ``continued_simulation_error_percent`` is None
    where the validation samples do not continue the estimation samples.
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
    ljung_box: LjungBox
    cross_correlation_share_inside95: float
    cross_correlation_max_abs: float
    cross_correlation_max_in_bounds: float
    cross_correlation_lags: int
    excitation_order: int
    excitation_needed: int
    residual_outlier_percent: float
    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame
    simulation: pd.DataFrame

    def scalars(self) -> dict[str, Any]:
        """Everything but the tables, ready for ``validation.json``.

        A number that could not be computed is None.
        """
        return {
            "prediction_error_percent": _finite(self.prediction_error_percent),
            "simulation_error_percent": _finite(self.simulation_error_percent),
            "prediction_fit_percent": _finite(self.prediction_fit_percent),
            "simulation_fit_percent": _finite(self.simulation_fit_percent),
            "continued_simulation_error_percent": (
                None
                if self.continued_simulation_error_percent is None
                else _finite(self.continued_simulation_error_percent)
            ),
            "samples": self.samples,
            "unscored_samples": self.unscored_samples,
            "residual_samples": self.residual_samples,
            "autocorrelation_share_inside95": _finite(self.autocorrelation_share_inside95),
            "lags": self.lags,
            "ljung_box": {
                "statistic": _finite(self.ljung_box.statistic),
                "degrees_of_freedom": self.ljung_box.degrees_of_freedom,
                "p_value": _finite(self.ljung_box.p_value),
                "lags": self.ljung_box.lags,
            },
            "cross_correlation": {
                "share_inside95": _finite(self.cross_correlation_share_inside95),
                "max_abs": _finite(self.cross_correlation_max_abs),
                "max_in_bounds": _finite(self.cross_correlation_max_in_bounds),
                "lags": self.cross_correlation_lags,
            },
            "residual_outlier_percent": _finite(self.residual_outlier_percent),
            "excitation": {"order": self.excitation_order, "needed": self.excitation_needed},
        }


def _finite(value: float) -> float | None:
    """JSON has no nan; say null."""
    return float(value) if math.isfinite(value) else None


@dataclass(frozen=True)
class _Responses:
    """Validation samples with the two computed responses; ``nan`` where there is none."""

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    predicted: NDArray[np.float64]
    simulated: NDArray[np.float64]
    continued: NDArray[np.float64] | None
    unscored: int


def validate(
    model: ArmaxModel,
    prepared: PreparedData,
    lags: int = 1200,
    scoring_start: int | None = None,
) -> Validation:
    """Validate a model on the data it was fitted to and on the samples it never saw.

    Parameters
    ----------
    model : ArmaxModel
        The fitted model.
    prepared : PreparedData
        Estimation and validation samples, transformed alike.
    lags : int
        Largest lag of the residual autocorrelation; cut to the number of residuals less one.
    scoring_start : int, optional
        First estimation sample whose residual is used. By default the nc-th residual: the ones
        before are fitted by the noise state.

    Returns
    -------
    Validation

    Raises
    ------
    ValueError
        When too few samples are left for a test.

    Notes
    -----
    Residual tests use the estimation samples (Ljung 1999, section 16.6), from the noise state that
    fits them best.

    The simulation of the validation samples starts from the initial state that fits them best, as
    MATLAB's ``compare`` has it: a few numbers, and nothing else, come from the output it is
    compared with.  When the validation samples continue the estimation samples
    (``prepared.contiguous``), a stricter simulation goes with it: it starts with the estimation
    samples, to which alone its state is fitted, and runs on without seeing one validation output
    (``continued_simulation_error_percent``).

    The predictor runs through both parts of a continuous record, so that it knows all the measured
    past.  An independent recording has no past on record: there the predictor starts with the
    recording, its noise state is fitted to it, and the first max(na, nb + nk − 1, nc) samples and
    the nc after them are not scored.
    """
    estimation = prepared.estimation
    orders = model.orders
    start = orders.first_residual + orders.nc if scoring_start is None else scoring_start
    noise_state = estimate_noise_state(model, estimation.input, estimation.output)
    residuals = model.residuals(estimation.input, estimation.output, noise_state)[start:]
    if residuals.size < 2:
        raise ValueError(
            f"{estimation.output.size} estimation samples leave no residuals from sample {start} on"
        )
    autocorrelation = residual_autocorrelation(residuals, lags)
    largest = len(autocorrelation) - 1
    cross = cross_correlation(
        residuals, estimation.input[start:], min(lags, CROSS_CORRELATION_LAGS)
    )
    fitted = orders.na + orders.nc
    responses = (
        _continued(model, prepared, noise_state)
        if prepared.contiguous
        else _restarted(model, prepared)
    )
    scored = slice(responses.unscored, None)
    measured = responses.output[scored]
    if measured.size == 0:
        raise ValueError("no validation sample is left to score; keep more samples for validation")
    ratio = cross["cross_correlation"].abs() / cross["bound95"]
    return Validation(
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
        unscored_samples=responses.unscored,
        residual_samples=residuals.size,
        autocorrelation_share_inside95=share_inside(
            autocorrelation["autocorrelation"].iloc[1:], autocorrelation["bound95"].iloc[1:]
        ),
        lags=largest,
        ljung_box=ljung_box(
            autocorrelation["autocorrelation"],
            residuals.size,
            fitted,
            ljung_box_lags(residuals.size, fitted, largest),
        ),
        cross_correlation_share_inside95=share_inside(cross["cross_correlation"], cross["bound95"]),
        cross_correlation_max_abs=float(cross["cross_correlation"].abs().max()),
        cross_correlation_max_in_bounds=float(ratio.max()),
        cross_correlation_lags=int(cross["lag"].max()),
        excitation_order=excitation_order(estimation.input, orders.na + orders.nb),
        excitation_needed=orders.na + orders.nb,
        residual_outlier_percent=outlier_percent(residuals),
        residual_autocorrelation=autocorrelation,
        cross_correlation=cross,
        simulation=_table(responses, estimation.sampling_rate),
    )


def _continued(
    model: ArmaxModel, prepared: PreparedData, noise_state: NDArray[np.float64]
) -> _Responses:
    """Predict and simulate validation samples that follow the estimation samples directly."""
    estimation, validation = prepared.estimation, prepared.validation
    inputs = np.concatenate([estimation.input, validation.input])
    output = np.concatenate([estimation.output, validation.output])
    seen = estimation.output.size
    state = estimate_initial_state(model, estimation.input, estimation.output)
    return _Responses(
        input=validation.input,
        output=validation.output,
        predicted=model.predict(inputs, output, noise_state)[seen:],
        simulated=_simulated(model, validation),
        continued=model.simulate(inputs, state)[seen:],
        unscored=0,
    )


def _restarted(model: ArmaxModel, prepared: PreparedData) -> _Responses:
    """Predict and simulate an independent recording, whose past is not on record."""
    validation = prepared.validation
    noise_state = estimate_noise_state(model, validation.input, validation.output)
    return _Responses(
        input=validation.input,
        output=validation.output,
        predicted=model.predict(validation.input, validation.output, noise_state),
        simulated=_simulated(model, validation),
        continued=None,
        unscored=model.orders.first_residual + model.orders.nc,
    )


def _simulated(model: ArmaxModel, validation: Recording) -> NDArray[np.float64]:
    """Response to the validation input from the state that fits the validation output best."""
    state = estimate_initial_state(model, validation.input, validation.output)
    return model.simulate(validation.input, state)


def _table(responses: _Responses, sampling_rate: float) -> pd.DataFrame:
    """Validation samples, time from their first; unscored computed values are missing."""
    predicted, simulated = responses.predicted.copy(), responses.simulated.copy()
    predicted[: responses.unscored] = np.nan
    simulated[: responses.unscored] = np.nan
    return pd.DataFrame(
        {
            "time_s": np.arange(responses.output.size) / sampling_rate,
            "input": responses.input,
            "output": responses.output,
            "simulated": simulated,
            "predicted": predicted,
            "simulation_error": responses.output - simulated,
            "prediction_error": responses.output - predicted,
        }
    )
