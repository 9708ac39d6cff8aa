"""Figures of the errors: correlations of the residuals, and errors over the horizon."""

from __future__ import annotations

import math

import pandas as pd

from evopem.figures.chart import Chart, Curve, Mark, Panel, family, scale_of
from evopem.figures.report_figure import MOST_PANELS, ReportFigure, columns_of, small
from evopem.figures.view import View

LAG = "Lag (samples)"


def residuals(view: View) -> Chart:
    """Autocorrelations of all outputs, and cross-correlations with all inputs."""
    # Lag 0 is 1 by definition and would flatten all other lags.
    own = view.autocorrelation[view.autocorrelation["lag"] > 0]
    tables = [own.rename(columns={"autocorrelation": "correlation"}).assign(input="")]
    if view.has_input:
        crossed = view.cross_correlation.rename(columns={"cross_correlation": "correlation"})
        tables.append(crossed)
    table = pd.concat(tables, ignore_index=True)
    table = table[["output", "input", "lag", "correlation", "bound95"]]
    titles = [
        *((o.name, "", "Autocorrelation of the residuals") for o in view.outputs),
        *(
            (output.name, source.name, "Cross-correlation of residuals and input")
            for output in view.outputs
            for source in view.inputs
        ),
    ]
    panels = tuple(
        _correlation(view, output, source, title, small(titles, 200))
        for output, source, title in titles[:MOST_PANELS]
    )
    return Chart(table, panels, 1 if view.is_single else columns_of(view, len(panels)))


def _correlation(view: View, output: str, source: str, title: str, height: int) -> Panel:
    where = (("output", output), ("input", source))
    if not view.is_single:
        title = f"{output} ← {source}" if source else f"{output}, residuals"
    return Panel(
        *(title, "lag", LAG, "Correlation"),
        (
            Curve("correlation", "correlation", "ink", "stems", where=where, bounds="bound95"),
            Curve("95 % bounds", "bound95", "model", dashed=True, where=where),
            Curve("", "bound95", "model", dashed=True, where=where, factor=-1.0),
        ),
        height=height,
    )


def horizons(view: View) -> Chart:
    """Errors of k-step predictions by k, with that of the simulation."""
    table = view.horizons
    single = len(view.outputs) == 1
    rows = {
        "k-step prediction" if single else output.name: view.where(output)
        for output in view.outputs
    }
    levels = tuple(
        Mark(each.simulation, "simulation", "error")
        for each in view.errors
        if math.isfinite(each.simulation) and single
    )
    panel = Panel(
        *("", "horizon", "Horizon k (samples)", "Relative error (%)"),
        family("error_percent", rows),
        scale=scale_of(table["error_percent"]),
        levels=levels,
        decades=True,
    )
    return Chart(table, (panel,))


FIGURES = (
    ReportFigure(
        *("horizons", "errors", "Prediction over longer horizons"),
        "Error of the prediction of the validation samples over its horizon, and of the"
        " simulation.",
        ("horizons.csv",),
        horizons,
        lambda view: len(view.horizons) > 0,
        without_input=(
            "",
            "Error of the prediction of the validation samples over its horizon.",
        ),
    ),
    ReportFigure(
        *("residuals", "residual_tests", "Correlation of the residuals"),
        "Correlations of the residuals with themselves and with the input, with 95 % bounds. At"
        " positive lags the residual follows the input.",
        ("residual_autocorrelation.csv", "cross_correlation.csv"),
        residuals,
        without_input=(
            "Autocorrelation of the residuals",
            "Correlations of the residuals with themselves, with 95 % bounds.",
        ),
    ),
)
