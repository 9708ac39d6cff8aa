"""Figures of several models side by side, of every pair of channels that all of them have."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.chart import (
    FAMILY,
    FREQUENCY,
    VALIDATION_TIME,
    Chart,
    Curve,
    Panel,
    around,
    family,
    nothing,
)
from evopem.figures.frequency_domain import GAIN_BINS, model_source
from evopem.figures.style import extremes, with_unit
from evopem.figures.time_domain import shown_samples
from evopem.figures.view import view_of

if TYPE_CHECKING:
    from evopem.results.comparison import Comparison


def simulated_column(number: int) -> str:
    """Column of the simulation by a model, counted from 1."""
    return f"simulated_{number}"


def compared_responses(comparison: Comparison) -> Chart:
    """Gain and phase of every model, with the 95 % bands of the gains."""
    views = [view_of(each) for each in comparison.results]
    columns = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]
    tables = []
    for number, view in enumerate(views, start=1):
        table = view.frequency_response
        own = table[(table["source"] == model_source(view)[0]) & (table["frequency_hz"] > 0)]
        tables.append(own.iloc[extremes(own["gain"], GAIN_BINS)][columns].assign(model=number))
    table = pd.concat(tables, ignore_index=True)[["model", *columns]]
    units = {view.gain_unit(*view.pairs[0]) for view in views}

    models = [
        (label, role, (("model", str(number)),))
        for number, (label, role) in enumerate(zip(comparison.labels, FAMILY, strict=False), 1)
    ]
    gains = [
        Curve(label, "gain", role, where=where, band=("gain_lower", "gain_upper"))
        for label, role, where in models
    ]
    phases = [Curve(label, "phase_deg", role, "points", where=w) for label, role, w in models]
    highest = max(view.sampling_rate for view in views) / 2
    panels = (
        Panel(
            *("", "frequency_hz", FREQUENCY),
            with_unit("Gain", units.pop() if len(units) == 1 else ""),
            tuple(gains),
            scale="logarithmic",
            limits=around(table["gain"]),
            highest=highest,
            height=260,
            linked="frequency",
        ),
        Panel(
            *("", "frequency_hz", FREQUENCY, "Phase (°)", tuple(phases)),
            scale="phase",
            limits=(-190, 190),
            highest=highest,
            height=170,
            linked="frequency",
        ),
    )
    return Chart(table, panels)


def compared_simulations(comparison: Comparison) -> Chart:
    """Validation samples, measured and simulated by every model; without an input, predicted."""
    if not comparison.has_same_validation:
        return nothing("The models were validated on different samples.")
    views = [view_of(each) for each in comparison.results]
    first, name = views[0], views[0].outputs[0].name
    kind = "simulated" if first.has_input else "predicted"
    together = first.simulation[["time_s", f"output_{name}"]].set_axis(["time_s", "output"], axis=1)
    for number, view in enumerate(views, start=1):
        computed = view.simulation[f"{kind}_{view.outputs[0].name}"]
        together = together.assign(**{simulated_column(number): computed})
    table = together[together.notna().all(axis="columns")]
    kept = shown_samples(first.modes, first.sampling_rate)
    until = float(table["time_s"].iloc[: kept or len(table)].max())
    curves = (
        Curve("measured", "output", "ink"),
        *(
            Curve(label, simulated_column(number), role, dashed=True)
            for number, (label, role) in enumerate(zip(comparison.labels, FAMILY, strict=False), 1)
        ),
    )
    label = first.outputs[0].label
    return Chart(
        table, (Panel("", "time_s", VALIDATION_TIME, label, curves, shown=until, height=250),)
    )


def compared_modes(comparison: Comparison) -> Chart:
    """Damping ratio over natural frequency with 95 % intervals; not to be trusted where open."""
    table = comparison.mode_table
    if table.empty:
        return nothing("No model has an oscillating mode.")
    errors = ("frequency_se_hz", "damping_se_percent")
    curves: list[Curve] = []
    models = {label: (("data set", label),) for label in comparison.labels}
    for curve in family("damping_percent", models):
        trusted, doubted = ((*curve.where, ("trusted", word)) for word in ("True", "False"))
        points = replace(curve, kind="points", dashed=False)
        curves += [
            replace(points, where=trusted, errors=errors),
            replace(points, label="", where=doubted, marker=f"open{curve.marker}"),
        ]
    damping = table["damping_percent"]
    limits = (min(0.0, 1.2 * float(damping.min())), 1.3 * max(float(damping.max()), 1e-6))
    panel = Panel(
        *("", "frequency_hz", "Natural frequency (Hz)", "Damping ratio (%)", tuple(curves)),
        limits=limits,
        highest=max(view_of(each).sampling_rate for each in comparison.results) / 2,
        height=250,
    )
    return Chart(table, (panel,), live=False)
