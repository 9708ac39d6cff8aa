"""The numbers behind each figure as one table, for those who want to draw it themselves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.pole_zero_map import root_spread, roots_in_z, stabilization
from evopem.figures.style import extremes

if TYPE_CHECKING:
    from evopem.results.dataset import Results
    from evopem.signals.recording import Recording

ORDERS = ["na", "nb", "nc", "nk"]


def record_table(results: Results) -> pd.DataFrame:
    """Both signals as recorded, and as used: estimation, then validation samples."""
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
    return pd.DataFrame(
        {"stage": stage, "time_s": time, "input": recording.input, "output": recording.output}
    )


def spectrum_table(results: Results) -> pd.DataFrame:
    """Spectrum of the output with its band."""
    return results.spectrum[["frequency_hz", "density", "lower", "upper"]]


def delay_table(results: Results) -> pd.DataFrame:
    """Criteria of the candidates of the delay search."""
    tried = results.candidates[results.candidates["phase"] == "delay"]
    return tried[[*ORDERS, "rss", "bic", "selected"]]


def phases_table(results: Results) -> pd.DataFrame:
    """Criteria of the candidates of the three phases."""
    tried = results.candidates[results.candidates["phase"] != "delay"]
    return tried[["phase", *ORDERS, "rss", "bic", "selected"]]


def roots_table(results: Results) -> pd.DataFrame:
    """Every root of A, B and C with the covariance of its real and imaginary part."""
    rows = []
    for polynomial, kind in (("a", "pole"), ("b", "zero"), ("c", "root of C")):
        for root in roots_in_z(np.asarray(results.model[polynomial], dtype=float)):
            spread = root_spread(results.model, polynomial, complex(root))
            known = np.full((2, 2), math.nan) if spread is None else spread
            rows.append(
                (kind, root.real, root.imag, abs(root), known[0, 0], known[1, 1], known[0, 1])
            )
    columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
    return pd.DataFrame(rows, columns=columns)


def frequency_response_table(results: Results) -> pd.DataFrame:
    """Frequency response of the model, then the multitaper estimate."""
    prefix = "frequency_response_"
    estimate = results.spectrum.rename(columns=lambda name: name.removeprefix(prefix))
    columns = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]
    return pd.concat(
        [
            results.frequency_response[columns].assign(source="model"),
            estimate[[*columns, "coherence"]].assign(source="multitaper"),
        ],
        ignore_index=True,
    )[["source", *columns, "coherence"]]


def residuals_table(results: Results) -> pd.DataFrame:
    """Autocorrelation and cross-correlation by lag, with their bounds."""
    return results.cross_correlation.merge(
        results.residual_autocorrelation,
        on="lag",
        how="outer",
        suffixes=("_of_cross_correlation", "_of_autocorrelation"),
    ).sort_values("lag")


def simulation_table(results: Results) -> pd.DataFrame:
    """Validation samples, simulated and predicted."""
    return results.simulation


def stabilization_table(results: Results) -> pd.DataFrame:
    """Poles over the common orders, each with its status."""
    common = results.phases.get("common", {}).get("candidates", [])
    return stabilization(common, float(results.model["sampling_rate"]))


def convergence_table(results: Results) -> pd.DataFrame:
    """Best objective after each generation of the search for the chosen model."""
    history = (results.chosen_candidate() or {}).get("convergence") or []
    return pd.DataFrame(history, columns=["evaluations", "best_objective"])


def thin_table(table: pd.DataFrame, rows: int) -> pd.DataFrame:
    """Leave out rows of a long table and keep the extremes of every column.

    Parameters
    ----------
    table : pandas.DataFrame
        Its first column of numbers is the one the others are drawn over.
    rows : int
        At most so many are kept.
    """
    if len(table) <= rows:
        return table
    drawn = list(table.select_dtypes("number").columns[1:])
    bins = rows // (2 * max(len(drawn), 1))
    # Series of at most 4 × bins points would be kept whole, and here none may be.
    kept = [extremes(table[column], min(bins, len(table) // 4 - 1)) for column in drawn]
    return table.iloc[np.unique(np.concatenate(kept))]
