"""The report of a data set with several channels as an HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import Markup

from evopem.automatic.state_space_choice import scores_of
from evopem.config.state_space_settings import Geometry, is_polynomial
from evopem.config.structures import STRUCTURES, structure_name
from evopem.figures.channel_drawings import (
    PANEL_WIDTH,
    WIDE_PANEL,
    assurance_matrix,
    response_panel,
    scores_chart,
    series_panel,
    shape_bars,
)
from evopem.figures.shape_drawings import ShapeDrawing
from evopem.models.state_space_modes import ShapedMode
from evopem.report import provenance
from evopem.report.fit_table import input_constraint_rows, input_fit_sentences
from evopem.report.numbers import count, hertz, number, percent, plural
from evopem.report.recording_table import recording_rows
from evopem.report.sentences.about_decisions import PurposeRow, decision_row
from evopem.report.sentences.about_recording import uneven_stamps
from evopem.report.sentences.about_state_space import state_space_verdict
from evopem.report.templates import environment
from evopem.results.multichannel import MultichannelResults
from evopem.validation.mode_table import JudgedMode
from evopem.validation.multichannel import OutputValidation

# Validation samples that a panel shows, and points of a line at most.
SHOWN_SAMPLES, POINTS = 200, 300
# Decibels that a frequency response is shown over.
DECIBELS = 80.0
# Share of an output's energy below which a mode is not seen there.
NEGLIGIBLE = 1e-3
# Outputs that a mode is seen at and inputs that it is driven by, named at most.
NAMED = 3
# Outputs up to which panels are as wide as the page, and from which on they are small.
FEW, MANY = 2, 6

VARIANT_WORDS = {
    "innovations": "innovations form",
    "output_error": "output-error form",
    "output_error_drift": "output-error form with drift",
    "box_jenkins": "next to Box-Jenkins",
} | {structure: structure_name(structure) for structure in STRUCTURES}


@dataclass(frozen=True)
class OutputPanel:
    """An output measured and simulated."""

    output: OutputValidation
    svg: Markup


@dataclass(frozen=True)
class ResponseRow:
    """The frequency responses of an output to all inputs."""

    output: str
    panels: list[tuple[str, Markup]]


@dataclass(frozen=True)
class ModeRow:
    """A mode of the table, with its shape.

    Attributes
    ----------
    mode : ShapedMode
    why : str
        Reasons not to trust it; empty for a trusted one.
    why_not_shape : str
        Reason not to trust its shape, and what is known of it nevertheless.
    evidence : str
        What drives it, where it is seen, and which orders have it.
    bars : Markup
    still, moving : Markup, optional
        Over the geometry, where there is one.
    """

    mode: ShapedMode
    why: str
    why_not_shape: str
    evidence: str
    bars: Markup
    still: Markup | None
    moving: Markup | None


def build_state_space_report(
    results: MultichannelResults, wall_clock: Mapping[str, float], templates: Path, commit: str
) -> str:
    """Build the report of one data set with several channels.

    Parameters
    ----------
    results : MultichannelResults
    wall_clock : mapping of str to float
        Seconds by stage.
    templates : Path
        Folder of ``state_space.html.j2`` and what it includes.
    commit : str
        Commit of the workflow that writes the report.

    Returns
    -------
    str
        One HTML page that loads no other file.
    """
    checks = results.checks
    rows = _mode_rows(results)
    names = [f"{row + 1}: {number(each.mode.frequency_hz, 3)}" for row, each in enumerate(rows)]
    page = environment(templates).get_template("state_space.html.j2")
    return page.render(
        results=results,
        model=results.model,
        has_input=bool(results.model.input_names),
        panel_size=_panel_size(len(results.model.output_names)),
        verdict=state_space_verdict(results),
        failed=[check for check in checks if check.passed is False],
        passed=[check for check in checks if check.passed is True],
        not_judged=[check for check in checks if check.passed is None],
        panels=_output_panels(results),
        recordings=recording_rows(results),
        shown=min(SHOWN_SAMPLES, results.validation.samples),
        outputs=_worst_first(results),
        modes=rows,
        geometry=results.settings.geometry is not None,
        assurance=Markup(
            assurance_matrix(
                results.modes.assurance, names, "Modal assurance criterion of all pairs of modes"
            )
        )
        if len(rows) > 1
        else None,
        responses=_response_rows(results),
        scores=_scores(results),
        variant_words=VARIANT_WORDS,
        order_words=_order_words(results),
        purposes=_purposes(results),
        constraints=input_constraint_rows(results.model.fit),
        fit_sentences=input_fit_sentences(results.model.fit),
        decisions=[decision_row(each) for each in results.decisions.decisions],
        remedies=results.decisions.remedies,
        provenance=_provenance(results, commit),
        stages=wall_clock,
        command=provenance.command(commit),
    )


def _worst_first(results: MultichannelResults) -> list[OutputValidation]:
    """The outputs by decreasing error, unknown errors before all others."""

    def error(output: OutputValidation) -> float:
        found = output.simulation_error_percent
        if not results.model.input_names:
            found = output.prediction_error_percent
        return found if np.isfinite(found) else np.inf

    return sorted(results.validation.outputs, key=error, reverse=True)


def _panel_size(outputs: int) -> str:
    """The class of the grid of panels."""
    if outputs <= FEW:
        return "few"
    return "many" if outputs > MANY else ""


def _output_panels(results: MultichannelResults) -> list[OutputPanel]:
    few = len(results.model.output_names) <= FEW
    table = _shown_samples(results.simulation)
    step = max(len(table) // POINTS, 1)
    times = (np.arange(len(table)) / results.model.sampling_rate)[::step]
    kind = "simulated" if results.model.input_names else "predicted"
    panels = []
    for output in _worst_first(results):
        signals = [
            ("measured", table[f"output_{output.name}"].to_numpy()[::step]),
            ("model", table[f"{kind}_{output.name}"].to_numpy()[::step]),
        ]
        signals.append(("difference", signals[0][1] - signals[1][1]))
        label = f"{output.name}, measured and {kind}"
        svg = series_panel(times, signals, "s", label, WIDE_PANEL if few else PANEL_WIDTH)
        panels.append(OutputPanel(output, Markup(svg)))
    return panels


def _shown_samples(simulation: pd.DataFrame) -> pd.DataFrame:
    """The first samples, of each held-out recording as many, with a gap between recordings."""
    if "recording" not in simulation:
        return simulation.iloc[:SHOWN_SAMPLES]
    recordings = [each for _, each in simulation.groupby("recording")]
    gap = simulation.iloc[:1] * np.nan
    shown = max(SHOWN_SAMPLES // len(recordings), 1)
    parts = [part for each in recordings for part in (each.iloc[:shown], gap)]
    return pd.concat(parts[:-1])


def _response_rows(results: MultichannelResults) -> list[ResponseRow]:
    """Panels of all pairs, those of one input on a common axis."""
    if not results.model.input_names:
        return []
    groups = dict(list(results.frequency_response.groupby(["output", "input"], sort=False)))
    limits = {name: _limits(results.frequency_response, name) for name in results.model.input_names}
    return [
        ResponseRow(
            output,
            [
                (input_, Markup(_response(groups[output, input_], limits[input_])))
                for input_ in results.model.input_names
            ],
        )
        for output in results.model.output_names
    ]


def _limits(table: pd.DataFrame, input_: str) -> tuple[float, float]:
    gains = table.loc[table["input"] == input_, "gain"]
    positive = gains[gains > 0]
    if positive.empty:
        return -1.0, 1.0
    high = 20.0 * float(np.log10(positive.max())) + 3.0
    low = max(20.0 * float(np.log10(positive.quantile(0.01))) - 3.0, high - DECIBELS)
    return low, high


def _response(table: pd.DataFrame, limits: tuple[float, float]) -> str:
    step = max(len(table) // POINTS, 1)
    shown = table.iloc[::step]
    label = f"Gain from {shown['input'].iloc[0]} to {shown['output'].iloc[0]}"
    return response_panel(
        shown["frequency_hz"].to_numpy(),
        shown["gain"].to_numpy(),
        (shown["gain_lower"].to_numpy(), shown["gain_upper"].to_numpy()),
        shown["measured_gain"].to_numpy(),
        limits,
        label,
    )


def _mode_rows(results: MultichannelResults) -> list[ModeRow]:
    geometry = results.settings.geometry
    outputs = results.modes.output_names
    drawing = _drawing(geometry, outputs)
    deviation = results.prepared.estimation.inputs.std(axis=0)
    rows = []
    for number_, judged in enumerate(results.modes.table.modes, 1):
        mode = judged.mode
        label = f"Shape of mode {number_} at {hertz(mode.frequency_hz)}"
        rows.append(
            ModeRow(
                mode,
                "; ".join(judged.doubts),
                _why_not_shape(judged),
                _evidence(judged, results, deviation),
                Markup(shape_bars(outputs, mode.shape, mode.shape_se_real, label)),
                Markup(drawing.still(mode.shape, label)) if drawing else None,
                Markup(drawing.moving(mode.shape, f"{label}, moving")) if drawing else None,
            )
        )
    return rows


def _why_not_shape(judged: JudgedMode) -> str:
    if judged.pair is None:
        return judged.shape_doubt
    return (
        f"{judged.shape_doubt}; the plane of its shape and that of mode {judged.pair + 1} is known"
    )


_ORIGINS = {
    "input": "driven by the inputs",
    "noise": "in the noise",
    "neither": "neither in the response nor in the noise",
    "not judged": "not tested",
}


def _evidence(judged: JudgedMode, results: MultichannelResults, deviation: np.ndarray) -> str:
    """What drives a mode, where it is seen, the model that it is of, and the orders that have it.

    ``deviation``: standard deviations of the inputs, (nu,).
    """
    table, mode = results.modes.table, judged.mode
    origin = _ORIGINS[judged.origin]
    if judged.origin == "input" and len(deviation) > 1:
        driven = np.abs(mode.input_participation) * deviation
        shares = driven / max(float(driven.sum()), 1e-300)
        origin = f"driven by {_strongest(results.modes.input_names, shares)}"
    words = [origin]
    if len(results.modes.output_names) > 1:
        words.append(_seen_at(results.modes.output_names, mode.output_shares))
    if judged.order != table.order:
        polynomial = results.model.polynomials is not None
        size = f"joint order {judged.order}" if polynomial else plural(judged.order, "state")
        words.append(f"of the model of {size}")
    words.append(f"{len(judged.orders)} of {plural(len(table.orders), 'order')}")
    return "; ".join(words)


def _seen_at(outputs: tuple[str, ...], shares: np.ndarray) -> str:
    if shares.max() < NEGLIGIBLE:
        return f"below {percent(100.0 * NEGLIGIBLE, 1)} of the energy of every output"
    return f"seen at {_strongest(outputs, shares)}"


def _drawing(geometry: Geometry | None, outputs: tuple[str, ...]) -> ShapeDrawing | None:
    return None if geometry is None else ShapeDrawing(geometry, outputs)


def _strongest(names: tuple[str, ...], shares: np.ndarray) -> str:
    """The channels with the largest shares, in percent."""
    best = [k for k in np.argsort(-shares, kind="stable")[:NAMED] if shares[k] >= NEGLIGIBLE]
    return ", ".join(f"{names[k]} {percent(100.0 * float(shares[k]), 2)}" for k in best)


def _scores(results: MultichannelResults) -> Markup | None:
    """Errors on held-out samples over the order, where there is more than one."""
    if len({order for each in results.searches for order in each.orders}) < 2:
        return None
    choice = results.choice.model
    kind = scores_of(choice.purpose, choice.level)
    curves = [
        (each.variant.form, each.orders, getattr(each, kind))
        for each in results.searches
        if each.orders
    ]
    own = next(each for each in results.searches if each.variant == choice.variant)
    error = getattr(own, kind)[own.orders.index(choice.order)]
    label = "Errors on held-out samples over the order"
    return Markup(scores_chart(curves, (choice.order, error), label))


def _purposes(results: MultichannelResults) -> list[PurposeRow]:
    """The model and the one for the other purpose."""
    other, validation = results.decisions.other, results.validation
    own = PurposeRow(
        *(results.decisions.purpose, "model.json", results.model.text),
        *(validation.prediction_error_percent, validation.simulation_error_percent),
    )
    return [own] if other is None else [own, PurposeRow.of(other)]


def _order_words(results: MultichannelResults) -> str:
    """What the order of the searched models is."""
    kinds = {is_polynomial(each.variant.form) for each in results.searches if each.orders}
    words = {False: "the number of states of the plant", True: "the joint order of the polynomials"}
    return " or ".join(words[kind] for kind in sorted(kinds))


def _provenance(results: MultichannelResults, commit: str) -> list[tuple[str, str]]:
    model = results.model
    time = results.recording_info.time_told
    versions = provenance.listed({"evopem": model.evopem} | model.versions)
    return [
        *(row for file in results.files for row in provenance.file_rows(file)),
        *([("Sampling rate", f"of the time stamps “{time}”, told by name")] if time else []),
        *(("Time stamps", each) for each in uneven_stamps(results.recording_info.uneven_times)),
        ("Objective of the search", model.settings.objective),
        ("Seed of the search", str(model.settings.seed)),
        ("Objective evaluations of the last search", count(model.search.evaluations)),
        ("Commit of the workflow", commit),
        ("Versions behind the numbers", versions),
        (
            "Versions behind this page",
            provenance.listed(provenance.installed(provenance.REPORT_LIBRARIES)),
        ),
    ]
