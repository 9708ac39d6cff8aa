"""Figures over time, lags and horizons: recording, simulation, responses, residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

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
    Role,
    across,
    columns_of,
    family,
    nothing,
    of_pair,
    scale_of,
    small,
)
from evopem.models.modes import Mode
from evopem.results.channels import gain_unit, with_unit
from evopem.results.dataset import DatasetResults

# So many periods of the lowest mode are shown, between the two limits in samples.
PERIODS = 12
FEWEST_SAMPLES, MOST_SAMPLES = 60, 400
# Outputs whose validation samples are all drawn, and channels of the recording.
MOST_OUTPUTS, MOST_CHANNELS = 4, 8
# Share of its largest value below which an impulse response has settled, and samples at least.
REMAINDER, FEWEST_OF_RESPONSE = 0.01, 50
RECORD_STAGES: tuple[tuple[str, Role], ...] = (
    ("recorded", "ink"),
    ("estimation", "ink"),
    ("validation", "model"),
)
# Column and title of the responses to an input; without an input, of that to the innovations.
OF_PLANT = (("step", "Step response"), ("impulse", "Impulse response (one sample of 1)"))
OF_NOISE = (("noise_impulse", "Impulse response of the noise filter (one sample of 1)"),)


def shown_samples(modes: Sequence[Mode], sampling_rate: float) -> int | None:
    """Samples over which the simulation is shown; None for all, where nothing oscillates."""
    if not modes:
        return None
    lowest = max(min(mode.frequency_hz for mode in modes), sampling_rate / MOST_SAMPLES)
    return min(max(round(PERIODS * sampling_rate / lowest), FEWEST_SAMPLES), MOST_SAMPLES)


def _curves(
    results: DatasetResults, kinds: Sequence[tuple[str, str, Role]], name: str
) -> tuple[Curve, ...]:
    """Curves of an output by label, kind of column and role; without an input none simulated."""
    return tuple(
        Curve(label, f"{kind}_{name}", role, dashed=role == "error")
        for label, kind, role in kinds
        if results.model.has_input or not kind.startswith(("simul", "recorded_simul"))
    )


def measured_and_simulated(results: DatasetResults) -> Chart:
    """First validation samples of every output, the worst one first."""
    computed = "simulated" if results.model.has_input else "predicted"
    outputs = [output for output, _ in results.worst_first[:MOST_PANELS]]
    is_one = len(outputs) == 1
    panels = tuple(
        Panel(
            *(results.pair_title(output), "time_s", VALIDATION_TIME if is_one else TIME),
            output.label if results.is_single else output.prepared_unit,
            _curves(
                *(results, (("measured", "output", "ink"), (computed, computed, "error"))),
                output.name,
            ),
            height=210 if is_one else 150,
            linked="" if is_one else "first",
        )
        for output in outputs
    )
    columns = [curve.column for panel in panels for curve in panel.curves]
    return Chart(_first_samples(results, columns), panels, across(panels))


def _first_samples(results: DatasetResults, columns: list[str]) -> pd.DataFrame:
    """The first scored samples; of several held-out recordings as many of each, with gaps."""
    table = results.validation_tables.simulation
    kept = shown_samples(results.modes, results.model.sampling_rate)
    scored = table[table[columns].notna().all(axis="columns")]
    if "recording" not in table:
        return scored[["time_s", *columns]].iloc[:kept]
    recordings = [each for _, each in scored.groupby("recording")]
    own = max((kept or len(scored)) // max(len(recordings), 1), 1)
    gap = scored.iloc[:1] * np.nan
    parts = [part for each in recordings for part in (each.iloc[:own], gap)][:-1]
    together = pd.concat(parts, ignore_index=True)
    time = np.arange(len(together)) / results.model.sampling_rate
    return together.assign(time_s=time)[["time_s", *columns]]


SIGNALS: tuple[tuple[str, str, Role], ...] = (
    ("measured", "output", "ink"),
    ("predicted one step ahead", "predicted", "model"),
    ("simulated", "simulated", "error"),
)
ERRORS: tuple[tuple[str, str, Role], ...] = (
    ("of simulation", "simulation_error", "error"),
    ("of one-step prediction", "prediction_error", "model"),
)
AS_RECORDED = tuple((label, f"recorded_{kind}", role) for label, kind, role in SIGNALS)


def simulation(results: DatasetResults) -> Chart:
    """Measured, simulated and predicted samples, and the errors."""
    kept = shown_samples(results.modes, results.model.sampling_rate)
    until = float(
        results.validation_tables.simulation["time_s"]
        .iloc[: kept or len(results.validation_tables.simulation)]
        .max()
    )
    return _validated(
        results,
        *(
            Panel(
                *(title, "time_s", VALIDATION_TIME, label),
                _curves(results, kinds, output.name),
                height=height,
                shown=until if until == until else 0.0,
            )
            for output, _ in results.worst_first[:MOST_OUTPUTS]
            for title, label, height, kinds in (
                (results.pair_title(output), output.label, 240, SIGNALS),
                ("Errors", "", 200, ERRORS),
            )
        ),
        columns=1 if len(results.outputs) == 1 else 2,
    )


def simulation_as_recorded(results: DatasetResults) -> Chart:
    """The same in the units of the recording."""
    if not results.model.transforms.changes_output:
        return nothing("The output was not transformed.")
    panels = [
        Panel(
            *(results.pair_title(output), "time_s", VALIDATION_TIME),
            with_unit(output.name, output.unit),
            _curves(results, AS_RECORDED, output.name),
            height=240,
        )
        for output, _ in results.worst_first[:MOST_OUTPUTS]
    ]
    return _validated(results, *panels, columns=min(len(panels), 2))


def _validated(results: DatasetResults, *panels: Panel, columns: int) -> Chart:
    """Panels of all validation samples, which show the same part of them."""
    shown = [curve.column for panel in panels for curve in panel.curves]
    linked = tuple(replace(panel, linked="validation") for panel in panels)
    return Chart(results.validation_tables.simulation[["time_s", *shown]], linked, columns)


def record(results: DatasetResults) -> Chart:
    """Every channel as recorded and as used."""
    table = _signals(results)
    channels = [*(("input", u) for u in results.inputs), *(("output", y) for y in results.outputs)]
    half = MOST_CHANNELS // 2
    start = float(table.loc[table["stage"] == "validation", "time_s"].min())
    panels: list[Panel] = []
    for kind, channel in [*channels[:half], *channels[half:][-half:]]:
        column = f"{kind}_{channel.name}"
        recorded, estimation, validation = (
            Curve(stage, column, role, where=(("stage", stage),)) for stage, role in RECORD_STAGES
        )
        label = with_unit(channel.name, channel.unit)
        before = Panel("As recorded", "time_s", TIME, label, (recorded,), linked="recorded")
        after = Panel(
            *("As used", "time_s", TIME, channel.label, (estimation, validation)),
            linked="used",
            marks=(Mark(start, "", "error"),) if start == start else (),
        )
        titles = ("", "") if panels else ("As recorded", "As used")
        panels += [
            replace(panel, title=title, height=150)
            for panel, title in zip((before, after), titles, strict=True)
        ]
    return Chart(table, tuple(panels), 2)


def _signals(results: DatasetResults) -> pd.DataFrame:
    """All channels as recorded and as used."""
    prepared, inputs, outputs = results.prepared, results.inputs, results.outputs
    begin = prepared.estimation.samples / prepared.estimation.sampling_rate
    names = [*(f"input_{each.name}" for each in inputs), *(f"output_{o.name}" for o in outputs)]
    tables = []
    for stage, part, first in (
        ("recorded", results.recording, 0.0),
        ("estimation", prepared.estimation, 0.0),
        ("validation", prepared.validation, begin),
    ):
        columns = np.column_stack([part.inputs[:, : len(inputs)], part.outputs])
        table = pd.DataFrame(columns, columns=names)
        table.insert(0, "time_s", first + np.arange(part.samples) / part.sampling_rate)
        table.insert(0, "stage", stage)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def responses_of(results: DatasetResults) -> tuple[tuple[str, str], ...]:
    """Column and title of each response that a model has."""
    return OF_PLANT if results.model.has_input else OF_NOISE


def step_and_impulse(results: DatasetResults) -> Chart:
    """Responses to a unit step and to one sample of 1, of every pair."""
    if results.time_response.empty:
        return nothing("The model has no response to show.")
    count = len(results.pairs)
    panels = tuple(
        Panel(
            title if count == 1 else f"{results.pair_title(*pair)}: {column}",
            *("time_s", TIME, with_unit("Response", gain_unit(*pair))),
            (
                Curve(
                    *("response", column, "model"),
                    band=(f"{column}_lower", f"{column}_upper"),
                    where=of_pair(*pair),
                ),
            ),
            height=small(results.pairs, 190),
            linked="response",
        )
        for column, title in responses_of(results)
        for pair in results.pairs
    )[:MOST_PANELS]
    return Chart(
        settling_part(results), panels, 1 if count == 1 else columns_of(results, panels[:count])
    )


def settling_part(results: DatasetResults) -> pd.DataFrame:
    """The responses and their 95 % intervals until every impulse response stays small."""
    table = results.time_response
    names = [name for name, _ in responses_of(results)]
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


def residuals(results: DatasetResults) -> Chart:
    """Autocorrelations of all outputs, and cross-correlations with all inputs."""
    # Lag 0 is 1 by definition and would flatten all other lags.
    computed = results.validation_tables
    own = computed.residual_autocorrelation[computed.residual_autocorrelation["lag"] > 0]
    tables = [own.rename(columns={"autocorrelation": "correlation"}).assign(input="")]
    if results.model.has_input:
        crossed = computed.cross_correlation
        tables.append(crossed.rename(columns={"cross_correlation": "correlation"}))
    table = pd.concat(tables, ignore_index=True)
    table = table[["output", "input", "lag", "correlation", "bound95"]]
    titles = [
        *((output, None, "Autocorrelation of the residuals") for output in results.outputs),
        *((*pair, "Cross-correlation of residuals and input") for pair in results.pairs if pair[1]),
    ]
    panels = []
    for output, source, title in titles[:MOST_PANELS]:
        where = (("output", output.name), ("input", source.name if source else ""))
        if not results.is_single:
            title = results.pair_title(output, source) + ("" if source else ", residuals")
        curves = (
            Curve("correlation", "correlation", "ink", "stems", where=where, bounds="bound95"),
            Curve("95 % bounds", "bound95", "model", dashed=True, where=where),
            Curve("", "bound95", "model", dashed=True, where=where, factor=-1.0),
        )
        height = small(titles, 200)
        panels.append(Panel(title, "lag", LAG, "Correlation", curves, height=height))
    return Chart(table, tuple(panels), 1 if results.is_single else columns_of(results, panels))


def horizons(results: DatasetResults) -> Chart:
    """Errors of k-step predictions by k, with that of the simulation."""
    table = results.validation_tables.horizons
    if table.empty:
        return nothing("No predictions of several steps were computed.")
    single = len(results.outputs) == 1
    rows = {
        "k-step prediction" if single else output.name: of_pair(output)
        for output in results.outputs
    }
    levels = tuple(
        Mark(each.simulation_error_percent, "simulation", "error")
        for each in results.validation.outputs
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
