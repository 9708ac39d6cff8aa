"""The data of each figure as one table."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.config.structures import ORDER_NAMES, plant_order
from evopem.errors import InputError
from evopem.figures.frequency_domain import complex_plane
from evopem.figures.style import extremes
from evopem.figures.summary import shown_samples, simulated_or_predicted
from evopem.models.confidence_ellipse import Polynomial, uncertain_roots
from evopem.models.stabilization import StabilizationPole, stabilization
from evopem.signals.spectral.multitaper import multitaper_spectrum

if TYPE_CHECKING:
    from evopem.results.dataset import DatasetResults
    from evopem.signals.recording import Recording

# Bins of the gain on the first screen; twice as many points show all its extremes.
GAIN_BINS = 300
# Length of the transforms of the residual spectrum: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024
ORDERS = list(ORDER_NAMES)
ROOTS: tuple[tuple[Polynomial, str], ...] = (
    ("A", "pole"),
    ("F", "pole of the plant"),
    ("B", "zero"),
    ("C", "root of C"),
    ("D", "pole of the noise filter"),
)


def record_table(results: DatasetResults) -> pd.DataFrame:
    """Both signals as recorded, and as used: estimation samples, then validation samples."""
    prepared = results.prepared
    begin = prepared.estimation.output.size / prepared.estimation.sampling_rate
    return pd.concat(
        [
            _signals("recorded", results.recording, 0.0),
            _signals("estimation", prepared.estimation, 0.0),
            _signals("validation", prepared.validation, begin),
        ],
        ignore_index=True,
    )


def _signals(stage: str, recording: Recording, begin: float) -> pd.DataFrame:
    time = begin + np.arange(recording.output.size) / recording.sampling_rate
    columns = {"stage": stage, "time_s": time, "input": recording.input}
    if not recording.has_input:
        del columns["input"]
    return pd.DataFrame(columns | {"output": recording.output})


def spectrum_table(results: DatasetResults) -> pd.DataFrame:
    """Spectrum of the output with its band."""
    return results.spectrum[["frequency_hz", "density", "lower", "upper"]]


def delay_table(results: DatasetResults) -> pd.DataFrame:
    """Criteria of the candidates of the delay search."""
    tried = results.candidates[results.candidates["phase"] == "delay"]
    return tried[[*ORDERS, "rss", "bic", "selected"]]


def phases_table(results: DatasetResults) -> pd.DataFrame:
    """Criteria of the candidates of the three phases of the orders."""
    tried = results.candidates[results.candidates["phase"] != "delay"]
    return tried[["phase", *ORDERS, "rss", "bic", "selected"]]


def roots_table(results: DatasetResults) -> pd.DataFrame:
    """Every root of the polynomials with the covariance of its real and imaginary part."""
    model = results.model.model
    rows = [
        {
            "kind": kind,
            "real": root.value.real,
            "imag": root.value.imag,
            "radius": abs(root.value),
            "variance_real": root.covariance[0, 0],
            "variance_imag": root.covariance[1, 1],
            "covariance": root.covariance[0, 1],
        }
        for polynomial, kind in ROOTS
        for root in uncertain_roots(model, polynomial)
    ]
    columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
    return pd.DataFrame(rows, columns=columns)


def frequency_response_table(results: DatasetResults) -> pd.DataFrame:
    """Frequency response of the model, then the multitaper estimate."""
    prefix = "frequency_response_"
    estimate = results.spectrum.rename(columns=lambda name: name.removeprefix(prefix))
    columns = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]
    noise = results.frequency_response[["frequency_hz", *(f"noise_{name}" for name in columns[1:])]]
    noise = noise.set_axis(columns, axis="columns").assign(source="noise filter")
    if not results.model.model.has_input:
        return noise[["source", *columns]]
    return pd.concat(
        [
            results.frequency_response[columns].assign(source="model"),
            noise,
            estimate[[*columns, "coherence"]].assign(source="multitaper"),
        ],
        ignore_index=True,
    )[["source", *columns, "coherence"]]


def residuals_table(results: DatasetResults) -> pd.DataFrame:
    """Autocorrelation and cross-correlation by lag, with their bounds."""
    tables = results.validation_tables
    return tables.cross_correlation.merge(
        tables.residual_autocorrelation,
        on="lag",
        how="outer",
        suffixes=("_of_cross_correlation", "_of_autocorrelation"),
    ).sort_values("lag")


def simulation_table(results: DatasetResults) -> pd.DataFrame:
    """Validation samples, simulated and predicted."""
    return results.validation_tables.simulation


def measured_and_simulated_table(results: DatasetResults) -> pd.DataFrame:
    """The first scored validation samples, measured and simulated; without an input, predicted."""
    table = results.validation_tables.simulation
    computed = simulated_or_predicted(table)
    scored = table[table[computed].notna()]
    kept = shown_samples(results.model.modes, results.model.sampling_rate)
    return scored[["time_s", "output", computed]].iloc[:kept]


def gain_table(results: DatasetResults) -> pd.DataFrame:
    """Gain of the model and of the multitaper estimate, thinned to their extremes.

    Of a model without input that of the noise filter.
    """
    table = frequency_response_table(results)[
        ["source", "frequency_hz", "gain", "gain_lower", "gain_upper"]
    ]
    if results.model.model.has_input:
        table = table[table["source"] != "noise filter"]
    thin = [
        rows.iloc[extremes(rows["gain"], GAIN_BINS)]
        for _, rows in table.groupby("source", sort=False)
    ]
    return pd.concat(thin, ignore_index=True)


def nyquist_table(results: DatasetResults) -> pd.DataFrame:
    """Real and imaginary part of the frequency response of the model and of the data."""
    table = frequency_response_table(results)
    table = table[table["source"] != "noise filter"]
    parts = complex_plane(table["gain"], table["phase_deg"])
    return table[["source", "frequency_hz"]].assign(real=parts[:, 0], imag=parts[:, 1])


def simulation_as_recorded_table(results: DatasetResults) -> pd.DataFrame:
    """Validation samples in the units of the recording, simulated and predicted."""
    columns = ["time_s", "recorded_output", "recorded_simulated", "recorded_predicted"]
    return results.validation_tables.simulation[columns]


def residual_spectrum_table(results: DatasetResults) -> pd.DataFrame:
    """Spectrum of the one-step errors on the validation samples; empty where there are too few."""
    columns = ["frequency_hz", "density", "lower", "upper", "white_level"]
    errors = results.validation_tables.simulation["prediction_error"].dropna().to_numpy()
    rate = results.model.sampling_rate
    try:
        found = multitaper_spectrum(errors, rate, nfft=RESIDUAL_NFFT)
    except InputError:
        return pd.DataFrame(columns=columns, dtype=float)
    values = (found.frequencies, found.density, found.lower, found.upper)
    table = pd.DataFrame(dict(zip(columns, values, strict=False)))
    return table.assign(white_level=2.0 * float(np.var(errors)) / rate)


def horizons_table(results: DatasetResults) -> pd.DataFrame:
    """Error of k-step predictions by k."""
    return results.validation_tables.horizons


def stabilization_poles(results: DatasetResults) -> list[StabilizationPole]:
    """Poles over the joint orders, each compared with the next lower order."""
    order = plant_order(results.model.orders.structure)
    return stabilization(
        (getattr(candidate.orders, order), candidate.model, candidate.criteria.bic)
        for candidate in results.models_of_orders.candidates
    )


def stabilization_table(results: DatasetResults) -> pd.DataFrame:
    """Poles over the joint orders, each with its status."""
    columns = ["order", "frequency_hz", "damping_ratio", "status"]
    table = pd.DataFrame([asdict(pole) for pole in stabilization_poles(results)], columns=columns)
    table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
    return table


def convergence_table(results: DatasetResults) -> pd.DataFrame:
    """Lowest objective after each generation of the search for the selected model."""
    history = results.selected.diagnostics.convergence
    return pd.DataFrame(history, columns=["evaluations", "lowest_objective"])


def thin_table(table: pd.DataFrame, rows: int) -> pd.DataFrame:
    """Leave out rows of a long table and keep the extremes of every column.

    Parameters
    ----------
    table : pandas.DataFrame
        Its first numeric column is the abscissa of the others.
    rows : int
        Largest number of rows.
    """
    if len(table) <= rows:
        return table
    drawn = list(table.select_dtypes("number").columns[1:])
    bins = rows // (2 * max(len(drawn), 1))
    # `extremes` keeps a series of at most 4 × bins points whole; here it must not.
    kept = [extremes(table[column], min(bins, len(table) // 4 - 1)) for column in drawn]
    return table.iloc[np.unique(np.concatenate(kept))]
