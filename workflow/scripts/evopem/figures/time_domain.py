"""Figures over time, lags and horizons: recording, simulation, responses, residuals."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from evopem.figures.chart import (
    MOST_PANELS,
    TIME,
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
from evopem.results.channel_labels import Channel, gain_unit, with_unit
from evopem.results.dataset import DatasetResults

# So many periods of the lowest mode are shown, between the two limits in samples.
PERIODS = 12
FEWEST_SAMPLES, MOST_SAMPLES = 60, 400
MOST_OUTPUTS, MOST_CHANNELS = 4, 8  # outputs drawn over all samples, channels of the recording
# Share of its largest value below which an impulse response has settled, and samples at least.
REMAINDER, FEWEST_OF_RESPONSE = 0.01, 50
RECORD_STAGES: tuple[tuple[str, Role], ...] = (
    ("recorded", "ink"),
    ("estimation", "ink"),
    ("validation", "model"),
)
# Label, kind of column and role of the curves of an output.
SIGNALS: tuple[tuple[str, str, Role], ...] = (
    ("measured", "output", "ink"),
    ("predicted one step ahead", "predicted", "model"),
    ("simulated", "simulated", "error"),
)
ERRORS: tuple[tuple[str, str, Role], ...] = (
    ("of simulation", "simulation_error", "error"),
    ("of one-step prediction", "prediction_error", "model"),
)
# Column and title of the responses to an input; without an input, of that to the innovations.
OF_PLANT = (("step", "Step response"), ("impulse", "Impulse response (one sample of 1)"))
OF_NOISE = (("noise_impulse", "Impulse response of the noise filter (one sample of 1)"),)


def shown_samples(results: DatasetResults) -> int:
    """Samples over which the simulation is shown; all of them, where nothing oscillates."""
    if not results.modes:
        return len(results.validation_tables.simulation)
    rate = results.model.sampling_rate
    lowest = max(min(mode.frequency_hz for mode in results.modes), rate / MOST_SAMPLES)
    return min(max(round(PERIODS * rate / lowest), FEWEST_SAMPLES), MOST_SAMPLES)


def _of_output(
    results: DatasetResults,
    output: Channel,
    kinds: Sequence[tuple[str, str, Role]],
    title: str,
    label: str,
    **options: Any,
) -> Panel:
    """Curves of an output by label, kind of column and role; without an input none simulated."""
    curves = tuple(
        Curve(label, f"{kind}_{output.name}", role, dashed=role == "error")
        for label, kind, role in kinds
        if results.model.has_input or "simul" not in kind
    )
    return Panel(title, "time_s", validation_time(results), label, curves, **options)


def validation_time(results: DatasetResults) -> str:
    """Label of the time in figures of the samples that judge the model."""
    return f"Time from the first {results.model.transforms.judging} sample (s)"


def _columns(panels: Sequence[Panel]) -> list[str]:
    return ["time_s", *(curve.column for panel in panels for curve in panel.curves)]


def measured_and_simulated(results: DatasetResults) -> Chart:
    """First validation samples of every output, the worst one first."""
    computed = "simulated" if results.model.has_input else "predicted"
    kinds: tuple[tuple[str, str, Role], ...] = (SIGNALS[0], (computed, computed, "error"))
    panels = tuple(
        _of_output(
            *(results, output, kinds, results.pair_title(output)),
            output.label if results.is_single else output.prepared_unit,
            height=210,
        )
        for output, _ in results.worst_first[:MOST_PANELS]
    )
    if len(panels) > 1:
        panels = tuple(replace(panel, x_label=TIME, height=150, linked="first") for panel in panels)
    return Chart(_first_samples(results, _columns(panels)), panels, across(panels))


def _first_samples(results: DatasetResults, columns: list[str]) -> pd.DataFrame:
    """The first scored samples; of several held-out recordings as many of each, with gaps."""
    table = results.validation_tables.simulation
    kept = shown_samples(results)
    scored = table[table[columns].notna().all(axis="columns")]
    if "recording" not in table:
        return scored[columns].iloc[:kept]
    recordings = [part for _, part in scored.groupby("recording")]
    shown = max(kept // max(len(recordings), 1), 1)
    gap = scored.iloc[:1] * np.nan
    parts = [part for recording in recordings for part in (recording.iloc[:shown], gap)][:-1]
    together = pd.concat(parts, ignore_index=True)
    return together.assign(time_s=np.arange(len(together)) / results.model.sampling_rate)[columns]


def simulation(results: DatasetResults) -> Chart:
    """Measured, simulated and predicted samples, and the errors."""
    until = results.validation_tables.simulation["time_s"].iloc[: shown_samples(results)].max()
    panels = [
        _of_output(results, output, kinds, title, label, height=height, shown=float(until))
        for output, _ in results.worst_first[:MOST_OUTPUTS]
        for title, label, height, kinds in (
            (results.pair_title(output), output.label, 240, SIGNALS),
            ("Errors", "", 200, ERRORS),
        )
    ]
    return _validated(results, panels, 1 if len(results.outputs) == 1 else 2)


def simulation_as_recorded(results: DatasetResults) -> Chart:
    """The same in the units of the recording."""
    if not results.model.transforms.changes_output:
        return nothing("The output was not transformed.")
    kinds = [(label, f"recorded_{kind}", role) for label, kind, role in SIGNALS]
    panels = [
        _of_output(
            *(results, output, kinds, results.pair_title(output)),
            *(with_unit(output.name, output.unit),),
            height=240,
        )
        for output, _ in results.worst_first[:MOST_OUTPUTS]
    ]
    return _validated(results, panels, min(len(panels), 2))


def _validated(results: DatasetResults, panels: Sequence[Panel], columns: int) -> Chart:
    """Panels of all validation samples, which show the same part of them."""
    linked = tuple(replace(panel, linked="validation") for panel in panels)
    return Chart(results.validation_tables.simulation[_columns(panels)], linked, columns)


def record(results: DatasetResults) -> Chart:
    """Every channel as recorded and as used."""
    table = _signals(results)
    channels = [*(("input", u) for u in results.inputs), *(("output", y) for y in results.outputs)]
    half = MOST_CHANNELS // 2
    start = float(table.loc[table["stage"] == "validation", "time_s"].min())
    drawn = set(table["stage"].unique())
    stages = [stage for stage in RECORD_STAGES if stage[0] in drawn]
    marks = (Mark(start, "", "error"),) if math.isfinite(start) else ()
    panels: list[Panel] = []
    for kind, channel in [*channels[:half], *channels[half:][-half:]]:
        recorded, *used = (
            Curve(stage, f"{kind}_{channel.name}", role, where=(("stage", stage),))
            for stage, role in stages
        )
        label = with_unit(channel.name, channel.unit)
        before = Panel("", "time_s", TIME, label, (recorded,), height=150, linked="recorded")
        after = replace(before, y_label=channel.label, curves=tuple(used), linked="used")
        panels += [before, replace(after, marks=marks)]
    panels[:2] = [replace(panels[0], title="As recorded"), replace(panels[1], title="As used")]
    return Chart(table, tuple(panels), 2)


def _signals(results: DatasetResults) -> pd.DataFrame:
    prepared, recording, inputs = results.prepared, results.recording, results.inputs
    assert prepared is not None
    assert recording is not None
    begin = prepared.estimation.samples / prepared.estimation.sampling_rate
    names = [f"input_{channel.name}" for channel in inputs]
    names += [f"output_{output.name}" for output in results.outputs]
    tables = []
    parts = recording, prepared.estimation, prepared.validation
    for (stage, _), part, first in zip(RECORD_STAGES, parts, (0.0, 0.0, begin), strict=True):
        columns = np.column_stack([part.inputs[:, : len(inputs)], part.outputs])
        table = pd.DataFrame(columns, columns=names)
        table.insert(0, "time_s", first + np.arange(part.samples) / part.sampling_rate)
        table.insert(0, "stage", stage)
        tables.append(table)
    # Samples that estimate the model and validate it are drawn once.
    kept = 3 if results.model.transforms.holds_out else 2
    return pd.concat(tables[:kept], ignore_index=True)


def responses_of(results: DatasetResults) -> tuple[tuple[str, str], ...]:
    """Column and title of each response that a model has."""
    return OF_PLANT if results.model.has_input else OF_NOISE


def step_and_impulse(results: DatasetResults) -> Chart:
    """Responses to a unit step and to one sample of 1, of every pair."""
    if results.time_response.empty:
        return nothing("The model has no response to show.")
    count = len(results.pairs)
    panels = [
        Panel(
            title if count == 1 else f"{results.pair_title(*pair)}: {column.rpartition('_')[2]}",
            *("time_s", TIME, with_unit("Response", gain_unit(*pair))),
            (Curve("response", column, "model", band=_band(column), where=of_pair(*pair)),),
            height=small(results.pairs, 190),
            linked="response",
        )
        for column, title in responses_of(results)
        for pair in results.pairs
    ]
    columns = columns_of(results, panels[:count])
    return Chart(settling_part(results), tuple(panels[:MOST_PANELS]), columns)


def _band(column: str) -> tuple[str, str]:
    return f"{column}_lower", f"{column}_upper"


def settling_part(results: DatasetResults) -> pd.DataFrame:
    """The responses and their 95 % intervals until every impulse response stays small."""
    table = results.time_response
    names = [name for name, _ in responses_of(results)]
    pairs = [name for name in ("output", "input") if name in table]
    settled = 0
    for _, rows in table.groupby(pairs, sort=False, dropna=False):
        size = np.abs(rows[names[-1]].to_numpy())
        settled = max(settled, int(np.flatnonzero(size > REMAINDER * size.max()).max(initial=0)))
    kept = max(round(1.2 * settled), FEWEST_OF_RESPONSE)
    columns = [column for name in names for column in (name, *_band(name))]
    first = table.groupby(pairs, sort=False, dropna=False).head(kept)
    return first[[*pairs, "time_s", *columns]].reset_index(drop=True)


def residual_correlation(results: DatasetResults) -> Chart:
    """Autocorrelations of all outputs, and cross-correlations with all inputs."""
    # Lag 0 is 1 by definition and would flatten all other lags.
    computed = results.validation_tables
    lagged = computed.residual_autocorrelation[computed.residual_autocorrelation["lag"] > 0]
    tables = [lagged.rename(columns={"autocorrelation": "correlation"}).assign(input="")]
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
        panels.append(Panel(title, "lag", "Lag (samples)", "Correlation", curves, height=height))
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
    error = results.validation.simulation_error_percent
    known = single and math.isfinite(error)
    panel = Panel(
        *("", "horizon", "Horizon k (samples)", "Relative error (%)"),
        family("error_percent", rows),
        scale=scale_of(table["error_percent"]),
        levels=(Mark(error, "simulation", "error"),) if known else (),
        decades=True,
    )
    return Chart(table, (panel,))
