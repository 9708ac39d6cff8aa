"""Validation of a state-space model: errors of every output, and tests of its residuals.

All of it is computed from validation samples, which no choice has seen.  The tests of the residuals
need no correction for the fit there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from evopem.estimation.state_space.held_out import (
    simulated_from_fitted_state,
    simulated_on,
)
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording
from evopem.validation.residual_tests import (
    apart,
    cross_correlation,
    ljung_box_lags,
    residual_autocorrelation,
    share_inside,
)
from evopem.validation.scores import error_percent, outlier_percent

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

CORRELATION_LAGS = 100
HORIZONS = (1, 2, 5, 10, 20, 50)


@dataclass(frozen=True)
class OutputValidation:
    """Errors and tests of one output; NaN where a number could not be computed.

    Attributes
    ----------
    name, unit : str
    prediction_error_percent, simulation_error_percent : float
        ``100 ||y - yhat|| / ||y - mean(y)||`` of the validation samples, one step ahead from the
        initial state that fits, and from the inputs alone; no simulation without an input.
    fitted_state_error_percent : float
        Of a simulation from the initial state that fits.
    fit_percent : float
        100 minus the error of the simulation, without an input of the prediction, as MATLAB's
        ``compare`` has it.
    horizon_errors_percent : tuple of float
        Errors of the predictions :data:`HORIZONS` samples ahead.
    ljung_box_p, ljung_box_lags : float, int
        Joint test of the residuals' autocorrelations.
    autocorrelation_share_inside95 : float
        Share of them inside their 95 % bounds.
    outlier_percent : float
        Percentage of residuals beyond five robust standard deviations.
    """

    name: str
    unit: str
    prediction_error_percent: float
    simulation_error_percent: float
    fitted_state_error_percent: float
    fit_percent: float
    horizon_errors_percent: tuple[float, ...]
    ljung_box_p: float
    ljung_box_lags: int
    autocorrelation_share_inside95: float
    outlier_percent: float


@dataclass(frozen=True)
class PairCorrelation:
    """Cross-correlation of the residuals of an output with an input.

    Attributes
    ----------
    output, input : str
    share_inside95 : float
    max_in_bounds : float
        Largest correlation, in units of its 95 % bound.
    """

    output: str
    input: str
    share_inside95: float
    max_in_bounds: float


@dataclass(frozen=True)
class RecordingErrors:
    """Errors on one held-out recording in percent, means over the outputs.

    Attributes
    ----------
    samples : int
    prediction_error_percent, simulation_error_percent : float
    """

    samples: int
    prediction_error_percent: float
    simulation_error_percent: float


@dataclass(frozen=True)
class MultichannelValidation:
    """Errors and tests of a state-space model.

    Attributes
    ----------
    samples : int
        Validation samples.
    prediction_error_percent, simulation_error_percent, fitted_state_error_percent : float
        Means over the outputs; of the simulation that sees no validation output, and of one from
        the initial state that fits them best.
    horizons : tuple of int
        Samples ahead of the predictions.
    outputs : tuple of OutputValidation
    pairs : tuple of PairCorrelation
    correlation_lags : int
        Largest lag of the cross-correlations to either side.
    recordings : tuple of RecordingErrors
        Of each held-out recording.
    """

    samples: int
    prediction_error_percent: float
    simulation_error_percent: float
    fitted_state_error_percent: float
    horizons: tuple[int, ...]
    outputs: tuple[OutputValidation, ...]
    pairs: tuple[PairCorrelation, ...]
    correlation_lags: int
    recordings: tuple[RecordingErrors, ...]


@dataclass(frozen=True, eq=False)
class MultichannelTables:
    """The series behind a validation.

    Attributes
    ----------
    simulation : pandas.DataFrame
        Validation samples, and for each output the measured, predicted and simulated ones.
    residual_autocorrelation : pandas.DataFrame
        By output and lag.
    cross_correlation : pandas.DataFrame
        By output, input and lag.
    """

    simulation: pd.DataFrame
    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame


def validate_multichannel(
    model: StateSpaceModel,
    validation: Recording,
    free_level: bool = False,
    fitted: int = 0,
    before: Recording | None = None,
) -> tuple[MultichannelValidation, MultichannelTables]:
    """Score a model on validation samples, and test its residuals there.

    Each of several recordings has states of its own, and no correlation reaches over a joint.

    Parameters
    ----------
    model : StateSpaceModel
    validation : Recording
        Less the means of the estimation samples, each of several recordings less its own.
    free_level : bool
        Whether a constant level of the simulation is fitted to the validation samples; to each of
        several recordings its own.
    fitted : int
        Parameters of each output that were fitted to these samples: the joint test of the
        residuals' autocorrelations has as many degrees of freedom less.
    before : Recording, optional
        Samples that the validation samples continue, of each recording: they determine the state of
        its simulation.  Without them the first tenth of a recording does, and is not scored.
    """
    u, y, bounds = validation.inputs, validation.outputs, validation.bounds
    horizons = tuple(k for k in HORIZONS if k < validation.longest.samples // 4)
    with np.errstate(all="ignore"):
        pasts = before.separated if before else [None] * len(validation.separated)
        parts = [
            _responses(model, past, each, horizons, free_level)
            for past, each in zip(pasts, validation.separated, strict=True)
        ]
    residuals, simulated, compared, *ahead = map(np.concatenate, zip(*parts, strict=True))
    tests = [residual_autocorrelation(e, CORRELATION_LAGS, bounds) for e in residuals.T]
    outputs = tuple(
        _output(
            validation,
            place,
            residuals[:, place],
            simulated[:, place],
            compared[:, place],
            [each[:, place] for each in ahead],
            tests[place],
            model.order,
            fitted,
        )
        for place in range(y.shape[1])
    )
    crossed = {
        (output, input_): cross_correlation(
            residuals[:, row], u[:, column], CORRELATION_LAGS, bounds
        )
        for row, output in enumerate(validation.output_names)
        for column, input_ in enumerate(validation.input_names)
    }
    found = MultichannelValidation(
        samples=len(y),
        prediction_error_percent=float(np.mean([o.prediction_error_percent for o in outputs])),
        simulation_error_percent=float(np.mean([o.simulation_error_percent for o in outputs])),
        fitted_state_error_percent=float(np.mean([o.fitted_state_error_percent for o in outputs])),
        horizons=horizons,
        outputs=outputs,
        pairs=tuple(_pair(*names, table) for names, table in crossed.items()),
        correlation_lags=min(CORRELATION_LAGS, len(y) - 1),
        recordings=tuple(
            _errors_of(record, *part[:2])
            for record, part in zip(validation.separated, parts, strict=True)
        ),
    )
    tables = MultichannelTables(
        _simulation_table(validation, residuals, simulated),
        *_correlation_tables(dict(zip(validation.output_names, tests, strict=True)), crossed),
    )
    return found, tables


def _responses(
    model: StateSpaceModel,
    before: Recording | None,
    record: Recording,
    horizons: tuple[int, ...],
    free_level: bool,
) -> list[Array]:
    """Residuals, two simulations, and predictions at the horizons of a record.

    The second simulation, and the predictions, begin with the states that fit the record.
    """
    u, y = record.inputs, record.outputs
    state = model.prediction_state(u, y)
    simulated = compared = np.full(y.shape, np.nan)
    if record.has_input:
        simulated = simulated_on(model, before, record, free_level)
        compared = simulated_from_fitted_state(model, record, free_level)
    ahead = [model.predict(u, y, k, state) for k in horizons]
    return [model.residuals(u, y, state), simulated, compared, *ahead]


def _errors_of(record: Recording, residuals: Array, simulated: Array) -> RecordingErrors:
    columns = range(record.outputs.shape[1])
    measured, predicted = record.outputs, record.outputs - residuals
    return RecordingErrors(
        record.samples,
        float(np.mean([_finite_error(measured[:, k], predicted[:, k]) for k in columns])),
        float(np.mean([_finite_error(measured[:, k], simulated[:, k]) for k in columns])),
    )


def mean_errors(
    model: StateSpaceModel,
    validation: Recording,
    free_level: bool,
    before: Recording | None = None,
) -> tuple[float, float]:
    """Errors one step ahead and of the simulation in percent, means over the outputs.

    Parameters
    ----------
    model, validation, free_level, before
        As of :func:`validate_multichannel`.
    """
    found, _ = validate_multichannel(model, validation, free_level, before=before)
    return found.prediction_error_percent, found.simulation_error_percent


def _output(
    validation: Recording,
    place: int,
    residuals: Array,
    simulated: Array,
    compared: Array,
    ahead: list[Array],
    autocorrelations: pd.DataFrame,
    order: int,
    fitted: int,
) -> OutputValidation:
    measured = validation.outputs[:, place]
    prediction = error_percent(measured, measured - residuals)
    simulation = _finite_error(measured, simulated)
    lags, p_value = _ljung_box(residuals, validation.bounds, order, fitted)
    later = autocorrelations[autocorrelations["lag"] > 0]
    return OutputValidation(
        name=validation.output_names[place],
        unit=validation.output_units[place],
        prediction_error_percent=prediction,
        simulation_error_percent=simulation,
        fitted_state_error_percent=_finite_error(measured, compared),
        fit_percent=100.0 - (simulation if validation.has_input else prediction),
        horizon_errors_percent=tuple(_finite_error(measured, each) for each in ahead),
        ljung_box_p=p_value,
        ljung_box_lags=lags,
        autocorrelation_share_inside95=share_inside(later["autocorrelation"], later["bound95"]),
        outlier_percent=outlier_percent(residuals),
    )


def _finite_error(measured: Array, computed: Array) -> float:
    """Error of the samples that are not missing; NaN where one is infinite, or there are none."""
    scored = ~np.isnan(computed)
    if not scored.any() or np.isinf(computed).any():
        return math.nan
    return error_percent(measured[scored], computed[scored])


def _ljung_box(
    residuals: Array, bounds: tuple[int, ...], order: int, fitted: int
) -> tuple[int, float]:
    """Ljung-Box test with as many degrees of freedom as lags, less what was fitted."""
    samples = residuals.size
    lags = ljung_box_lags(samples, order, min(CORRELATION_LAGS, samples // 3))
    if lags < 1 or not np.isfinite(residuals).all() or np.ptp(residuals) == 0.0:
        return lags, math.nan
    e = apart(residuals, bounds, lags) - residuals.mean()
    k = np.arange(1, lags + 1)
    rho = np.array([e[lag:] @ e[:-lag] for lag in k]) / (e @ e)
    statistic = samples * (samples + 2) * float(np.sum(rho**2 / (samples - k)))
    return lags, float(chdtrc(max(lags - fitted, 1), statistic))


def _pair(output: str, input_: str, table: pd.DataFrame) -> PairCorrelation:
    ratio = np.abs(table["cross_correlation"]) / table["bound95"]
    share = share_inside(table["cross_correlation"], table["bound95"])
    return PairCorrelation(output, input_, share, float(ratio.max()))


def _correlation_tables(
    tests: Mapping[str, pd.DataFrame], crossed: Mapping[tuple[str, str], pd.DataFrame]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Correlations of the residuals of all outputs, and with all inputs, one below the other."""
    import pandas as pd

    own = [
        table.assign(output=output)[["output", *table.columns]] for output, table in tests.items()
    ]
    if not crossed:
        columns = ["output", "input", "lag", "cross_correlation", "bound95"]
        return pd.concat(own), pd.DataFrame(columns=columns)
    pairs = [
        table.assign(output=output, input=input_)[["output", "input", *table.columns]]
        for (output, input_), table in crossed.items()
    ]
    return pd.concat(own), pd.concat(pairs)


def _simulation_table(validation: Recording, residuals: Array, simulated: Array) -> pd.DataFrame:
    """Measured, predicted and simulated samples."""
    import pandas as pd

    samples = [np.arange(each.samples) for each in validation.separated]
    columns = {"time_s": np.concatenate(samples) / validation.sampling_rate}
    if validation.is_joined:
        numbers = np.arange(len(samples)) + 1
        columns = {"recording": np.repeat(numbers, [each.size for each in samples]), **columns}
    columns |= {
        f"input_{name}": validation.inputs[:, column]
        for column, name in enumerate(validation.input_names)
    }
    for place, name in enumerate(validation.output_names):
        measured = validation.outputs[:, place]
        columns[f"output_{name}"] = measured
        columns[f"predicted_{name}"] = measured - residuals[:, place]
        if validation.has_input:
            columns[f"simulated_{name}"] = simulated[:, place]
    return pd.DataFrame(columns)
