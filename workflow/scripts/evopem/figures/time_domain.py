"""Figures over time, lags and horizons: recording, simulation, responses, residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from evopem.figures.chart import (
    MOST_PANELS,
    TIME,
    VALIDATION_TIME,
    Chart,
    Curve,
    Mark,
    Panel,
    ReportFigure,
    Role,
    columns_of,
    family,
    nothing,
    scale_of,
    small,
)
from evopem.figures.style import with_unit
from evopem.figures.view import View
from evopem.models.modes import Mode

# So many periods of the lowest mode are shown, between the two limits in samples.
PERIODS = 12
FEWEST_SAMPLES, MOST_SAMPLES = 60, 400
# Outputs whose validation samples are all drawn, and channels of the recording.
MOST_OUTPUTS, MOST_CHANNELS = 4, 8
# Share of its largest value below which an impulse response has settled, and samples at least.
REMAINDER, FEWEST_OF_RESPONSE = 0.01, 50
# Column and title of the responses to an input; without an input, of that to the innovations.
OF_PLANT = (("step", "Step response"), ("impulse", "Impulse response (one sample of 1)"))
OF_NOISE = (("noise_impulse", "Impulse response of the noise filter (one sample of 1)"),)


def shown_samples(modes: Sequence[Mode], sampling_rate: float) -> int | None:
    """Samples over which the simulation is shown; None for all, where nothing oscillates."""
    if not modes:
        return None
    lowest = max(min(mode.frequency_hz for mode in modes), sampling_rate / MOST_SAMPLES)
    return min(max(round(PERIODS * sampling_rate / lowest), FEWEST_SAMPLES), MOST_SAMPLES)


def measured_and_simulated(view: View) -> Chart:
    """First validation samples of every output, the worst one first."""
    computed = "simulated" if view.has_input else "predicted"
    outputs = [output for output, _ in view.worst_first[:MOST_PANELS]]
    count = len(outputs)
    columns = [f"{kind}_{o.name}" for o in outputs for kind in ("output", computed)]
    panels = tuple(
        Panel(
            view.pair_title(output),
            *("time_s", VALIDATION_TIME if count == 1 else TIME),
            output.label if view.is_single else output.prepared_unit,
            (
                Curve("measured", f"output_{output.name}", "ink"),
                Curve(computed, f"{computed}_{output.name}", "error", dashed=True),
            ),
            height=210 if count == 1 else 150,
            linked="" if count == 1 else "first",
        )
        for output in outputs
    )
    rows = 1 if count == 1 else 2 if count <= 6 else 3
    return Chart(_first_samples(view, columns), panels, rows)


def _first_samples(view: View, columns: list[str]) -> pd.DataFrame:
    """The first scored samples; of several held-out recordings as many of each, with gaps."""
    table = view.simulation
    kept = shown_samples(view.modes, view.sampling_rate)
    scored = table[table[columns].notna().all(axis="columns")]
    if "recording" not in table:
        return scored[["time_s", *columns]].iloc[:kept]
    recordings = [each for _, each in scored.groupby("recording")]
    own = max((kept or len(scored)) // max(len(recordings), 1), 1)
    gap = scored.iloc[:1] * np.nan
    parts = [part for each in recordings for part in (each.iloc[:own], gap)][:-1]
    together = pd.concat(parts, ignore_index=True)
    time = np.arange(len(together)) / view.sampling_rate
    return together.assign(time_s=time)[["time_s", *columns]]


def simulation(view: View) -> Chart:
    """Measured, simulated and predicted samples, and the errors."""
    outputs = [output for output, _ in view.worst_first[:MOST_OUTPUTS]]
    kept = shown_samples(view.modes, view.sampling_rate)
    times = view.simulation["time_s"].iloc[: kept or len(view.simulation)]
    panels: list[Panel] = []
    columns = ["time_s"]
    for output in outputs:
        name = output.name
        signals = [
            Curve("measured", f"output_{name}", "ink"),
            Curve("predicted one step ahead", f"predicted_{name}", "model"),
        ]
        errors = [Curve("of one-step prediction", f"prediction_error_{name}", "model")]
        if view.has_input:
            signals.append(Curve("simulated", f"simulated_{name}", "error", dashed=True))
            error = Curve("of simulation", f"simulation_error_{name}", "error", dashed=True)
            errors.insert(0, error)
        columns += [curve.column for curve in (*signals, *errors)]
        for title, y_label, height, curves in (
            (view.pair_title(output), output.label, 240, signals),
            ("Errors", "", 200, errors),
        ):
            panels.append(
                Panel(
                    *(title, "time_s", VALIDATION_TIME, y_label, tuple(curves)),
                    height=height,
                    linked="validation",
                    shown=float(times.max()) if len(times) else 0.0,
                )
            )
    return Chart(view.simulation[columns], tuple(panels), 1 if len(outputs) == 1 else 2)


def simulation_as_recorded(view: View) -> Chart:
    """The same in the units of the recording."""
    if not view.changes_output:
        return nothing("The output was not transformed.")
    kinds: tuple[tuple[str, str, Role], ...] = (
        ("measured", "output", "ink"),
        ("predicted one step ahead", "predicted", "model"),
        ("simulated", "simulated", "error"),
    )
    panels = tuple(
        Panel(
            view.pair_title(output),
            *("time_s", VALIDATION_TIME, with_unit(output.name, output.unit)),
            tuple(
                Curve(label, f"recorded_{kind}_{output.name}", role, dashed=role != "ink")
                for label, kind, role in kinds[: 2 + view.has_input]
            ),
            height=240,
            linked="validation",
        )
        for output, _ in view.worst_first[:MOST_OUTPUTS]
    )
    columns = [curve.column for panel in panels for curve in panel.curves]
    return Chart(view.simulation[["time_s", *columns]], panels, min(len(panels), 2))


def record(view: View) -> Chart:
    """Every channel as recorded and as used."""
    table = view.signals
    used: tuple[tuple[str, Role], ...] = (("estimation", "ink"), ("validation", "model"))
    stages: list[tuple[str, tuple[tuple[str, Role], ...], str]] = [("As used", used, "used")]
    if (table["stage"] == "recorded").any():
        stages.insert(0, ("As recorded", (("recorded", "ink"),), "recorded"))
    channels = [
        *(("input", each) for each in view.inputs),
        *(("output", each) for each in view.outputs),
    ]
    shown = [
        *channels[: MOST_CHANNELS // 2],
        *channels[MOST_CHANNELS // 2 :][-MOST_CHANNELS // 2 :],
    ]
    start = float(table.loc[table["stage"] == "validation", "time_s"].min())
    panels = tuple(
        Panel(
            title if place == 0 else "",
            *(
                "time_s",
                TIME,
                channel.label if linked == "used" else with_unit(channel.name, channel.unit),
            ),
            tuple(
                Curve(
                    *(stage, f"{kind}_{channel.name}", colour),
                    where=(("stage", stage),),
                )
                for stage, colour in parts
            ),
            height=150,
            marks=(Mark(start, "", "error"),) if linked == "used" and start == start else (),
            linked=linked,
        )
        for place, (kind, channel) in enumerate(shown)
        for title, parts, linked in stages
    )
    return Chart(table, panels, len(stages))


def responses_of(view: View) -> tuple[tuple[str, str], ...]:
    """Column and title of each response that a model has."""
    return OF_PLANT if view.has_input else OF_NOISE


def step_and_impulse(view: View) -> Chart:
    """Responses to a unit step and to one sample of 1, of every pair."""
    if view.results.time_response.empty:
        return nothing("The model has no response to show.")
    count = len(view.pairs)
    panels = tuple(
        Panel(
            title if count == 1 else f"{view.pair_title(*pair)}: {column}",
            *("time_s", TIME, with_unit("Response", view.gain_unit(*pair))),
            (
                Curve(
                    *("response", column, "model"),
                    band=(f"{column}_lower", f"{column}_upper"),
                    where=view.where(*pair),
                ),
            ),
            height=small(view.pairs, 190),
            linked="response",
        )
        for column, title in responses_of(view)
        for pair in view.pairs
    )[:MOST_PANELS]
    return Chart(settling_part(view), panels, 1 if count == 1 else columns_of(view, count))


def settling_part(view: View) -> pd.DataFrame:
    """The responses and their 95 % intervals until every impulse response stays small."""
    table = view.results.time_response
    names = [name for name, _ in responses_of(view)]
    pairs = [name for name in ("output", "input") if name in table]
    settled = 0
    for _, rows in table.groupby(pairs, sort=False):
        size = np.abs(rows[names[-1]].to_numpy())
        settled = max(settled, int(np.flatnonzero(size > REMAINDER * size.max()).max(initial=0)))
    kept = max(round(1.2 * settled), FEWEST_OF_RESPONSE)
    columns = [f"{name}{end}" for name in names for end in ("", "_lower", "_upper")]
    first = table.groupby(pairs, sort=False).head(kept)
    return first[[*pairs, "time_s", *columns]].reset_index(drop=True)


LAG = "Lag (samples)"


def residuals(view: View) -> Chart:
    """Autocorrelations of all outputs, and cross-correlations with all inputs."""
    # Lag 0 is 1 by definition and would flatten all other lags.
    computed = view.results.validation_tables
    own = computed.residual_autocorrelation[computed.residual_autocorrelation["lag"] > 0]
    tables = [own.rename(columns={"autocorrelation": "correlation"}).assign(input="")]
    if view.has_input:
        crossed = computed.cross_correlation
        tables.append(crossed.rename(columns={"cross_correlation": "correlation"}))
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
    if table.empty:
        return nothing("No predictions of several steps were computed.")
    single = len(view.outputs) == 1
    rows = {
        "k-step prediction" if single else output.name: view.where(output)
        for output in view.outputs
    }
    levels = tuple(
        Mark(each.simulation_error_percent, "simulation", "error")
        for each in view.results.validation.outputs
        if math.isfinite(each.simulation_error_percent) and single
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
        *("measured_and_simulated", "summary", "Measured and simulated"),
        "Validation samples from the first on, less the level of the estimation samples. The"
        " simulation uses the input alone.",
        ("simulation.csv",),
        measured_and_simulated,
        without_input=(
            "Measured and predicted",
            "Validation samples from the first on, less the level of the estimation samples. The"
            " prediction knows the output before.",
        ),
    ),
    ReportFigure(
        *("step_and_impulse", "response", "Step and impulse"),
        "Responses to a unit step and to one sample of 1, with 95 % bands where they are known.",
        ("time_response.csv",),
        step_and_impulse,
        without_input=(
            "Impulse response",
            "Response of the noise filter to one sample of 1, with 95 % band.",
        ),
    ),
    ReportFigure(
        *("simulation", "errors", "Simulation"),
        "Validation samples, simulated and predicted, and the errors. The drawing shows the first"
        " of them.",
        ("simulation.csv",),
        simulation,
        without_input=(
            "Prediction",
            "Validation samples, predicted one step ahead, and the errors.",
        ),
    ),
    ReportFigure(
        *("simulation_as_recorded", "errors", "In recorded units"),
        "Validation samples with all transforms inverted.",
        ("simulation.csv",),
        simulation_as_recorded,
    ),
    ReportFigure(
        *("record", "recording", "Signals"),
        "Input and output as recorded and as used.",
        ("recording.npz", "prepared.npz"),
        record,
        without_input=("", "Output as recorded and as used."),
    ),
    ReportFigure(
        *("horizons", "errors", "Prediction over longer horizons"),
        "Error of the prediction of the validation samples over its horizon, and of the"
        " simulation.",
        ("horizons.csv",),
        horizons,
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
