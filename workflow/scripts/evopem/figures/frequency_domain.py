"""Figures over frequency: spectra, gain, phase and coherence of every pair of channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from evopem.figures.chart import (
    FREQUENCY,
    MOST_PANELS,
    Chart,
    Curve,
    Mark,
    Panel,
    across,
    around,
    columns_of,
    nothing,
    rows_of,
    small,
)
from evopem.figures.style import extremes, with_unit
from evopem.figures.view import Pair, View
from evopem.signals.spectrum_summary import SpectralPeak

PLANT, NOISE_FILTER = "model G", "noise filter H"
# Bins of the gain on the first screen; twice as many points show all its extremes.
GAIN_BINS = 300
# Number of peaks that are labelled, the most prominent ones.
MOST_LABELS = 8
# A response at 0 Hz that exceeds all others by this factor is that of an integrator.
UNBOUNDED = 1e6
# Points of a Nyquist diagram; neighbours of the estimate from the data are almost the same.
NYQUIST_POINTS, FEWEST_NYQUIST = 1200, 150
MOST_NYQUIST = 12


def model_source(view: View) -> tuple[str, str]:
    """The rows of the model in a table of frequency responses, and how it is labelled."""
    return ("model", PLANT) if view.has_input else ("noise filter", NOISE_FILTER)


def true_modes(view: View) -> tuple[Mark, ...]:
    """Marks at the true natural frequencies, if there is a truth."""
    found = view.truth.modes if view.truth else ()
    return tuple(
        Mark(mode.frequency_hz, "" if place else "true modes", "truth")
        for place, mode in enumerate(found)
    )


def _panel(
    view: View, title: str, y_label: str, curves: Sequence[Curve], height: int, **options: Any
) -> Panel:
    return Panel(
        *(title, "frequency_hz", FREQUENCY, y_label, tuple(curves)),
        highest=view.sampling_rate / 2,
        height=height,
        linked="frequency",
        **options,
    )


def _over_data(view: View, pair: Pair, curve: Curve) -> list[Curve]:
    """The curve of a pair's model; with an input over the one that the data give."""
    where, kind = view.where(*pair), model_source(view)[0]
    model = replace(curve, where=(("source", kind), *where))
    measured = (("source", "measured"), *where)
    data = Curve("from the data", curve.column, "muted", curve.kind, where=measured)
    return [data, model] if view.has_input else [model]


def gain_panels(view: View, marks: Sequence[Mark], height: int) -> list[Panel]:
    """The gain of every pair over the data."""
    kind, label = model_source(view)
    table = view.frequency_response
    table = table[table["source"] == kind]
    band = Curve(f"{label} with 95 % band", "gain", "model", band=("gain_lower", "gain_upper"))
    return [
        _panel(
            *(view, view.pair_title(*pair), with_unit("Gain", view.gain_unit(*pair))),
            *(_over_data(view, pair, band), height),
            scale="logarithmic",
            limits=around(rows_of(table, view.where(*pair))["gain"]),
            marks=tuple(marks),
        )
        for pair in view.pairs[:MOST_PANELS]
    ]


def gain(view: View) -> Chart:
    """Gain with its 95 % band over the estimate from the data, trusted modes marked."""
    table = view.frequency_response
    kept = table[table["source"].isin([model_source(view)[0], "measured"])]
    kept = kept[kept["frequency_hz"] > 0].dropna(axis="columns", how="all")
    columns = [each for each in kept if each not in ("phase_deg", "coherence")]
    keys = [each for each in ("source", "output", "input") if each in columns]
    thin = [
        rows.iloc[extremes(rows["gain"], GAIN_BINS)]
        for _, rows in kept[columns].groupby(keys, sort=False)
    ]
    trusted = [m for m, kept in zip(view.modes, view.trusted, strict=True) if kept]
    marks = [Mark(m.frequency_hz, "" if k else "trusted modes") for k, m in enumerate(trusted)]
    together = pd.concat(thin, ignore_index=True)
    for name in ("gain_lower", "gain_upper"):
        together[name] = together.get(name, np.nan)
    panels = gain_panels(view, marks, 210 if len(view.pairs) == 1 else 150)
    return Chart(together, tuple(panels), columns_of(view, panels))


def frequency_response(view: View) -> Chart:
    """Gain, phase and coherence; of very many pairs the phases alone."""
    has_room = 2 * len(view.pairs) + len(view.outputs) <= MOST_PANELS
    panels = gain_panels(view, true_modes(view), small(view.pairs, 230)) if has_room else []
    phase = Curve(model_source(view)[1], "phase_deg", "model", "points")
    panels += [
        _panel(
            *(view, view.pair_title(*pair), "Phase (°)", _over_data(view, pair, phase)),
            small(view.pairs, 170),
            scale="phase",
            limits=(-190, 190),
        )
        for pair in view.pairs[:MOST_PANELS]
    ]
    if view.has_input and has_room:
        for output in view.outputs:
            where = (("source", "measured"), *view.where(output, view.inputs[0]))
            curves = [Curve("coherence", "coherence", "muted", where=where)]
            title = "" if view.is_single else f"{output.name}: coherence with all inputs"
            panels.append(_panel(view, title, "Coherence", curves, 110, limits=(0, 1.05)))
    table = view.frequency_response[view.frequency_response["frequency_hz"] > 0]
    if view.has_input and not view.is_single:
        table = table[table["source"] != "noise filter"]  # room for the responses that are drawn
    return Chart(table, tuple(panels), columns_of(view, panels[: len(view.pairs)]))


def nyquist(view: View) -> Chart:
    """G of every pair in the complex plane over positive frequencies."""
    if not view.has_input:
        return nothing("The model has no input.")
    if len(view.pairs) > MOST_NYQUIST:
        return nothing(f"There are more than {MOST_NYQUIST} pairs of channels.")
    table = view.frequency_response
    table = table[(table["source"] != "noise filter") & (table["frequency_hz"] > 0)]
    parts = complex_plane(table["gain"], table["phase_deg"])
    columns = ["source", "output", "input", "frequency_hz"]
    together = table[columns].assign(real=parts[:, 0], imag=parts[:, 1])
    most = max(NYQUIST_POINTS // len(view.pairs), FEWEST_NYQUIST)
    together = pd.concat(
        [
            rows.iloc[:: -(-len(rows) // most)]
            for (source, *_), rows in together.groupby(columns[:3], sort=False)
        ]
    )
    panels = []
    for pair in view.pairs:
        model = Curve(PLANT, "imag", "model", where=(("source", "model"), *view.where(*pair)))
        measured = (("source", "measured"), *view.where(*pair))
        data = Curve("from the data", "imag", "muted", "points", where=measured, marker=".")
        reach = _reach(rows_of(together, model.where)[["real", "imag"]].to_numpy())
        unit = view.gain_unit(*pair)
        panels.append(
            Panel(
                *(view.pair_title(*pair), "real", with_unit("Real part of G", unit)),
                *(with_unit("Imaginary part of G", unit), (data, model)),
                limits=(-reach, reach),
                plane="complex",
                height=330 if len(view.pairs) == 1 else 220,
            )
        )
    return Chart(together, tuple(panels), columns_of(view, panels))


def _reach(points: np.ndarray) -> float:
    magnitudes = np.abs(points).max(axis=1)
    # At 0 Hz the response of an integrator is infinite, or as large as rounding makes it.
    if not magnitudes[0] < UNBOUNDED * magnitudes[1:].max(initial=0.0):
        magnitudes = magnitudes[1:]
    finite = magnitudes[np.isfinite(magnitudes)]
    return 1.15 * float(finite.max(initial=0.0)) or 1.0


def complex_plane(gain: pd.Series, phase_deg: pd.Series) -> np.ndarray:
    """Real and imaginary parts, (N, 2), of a response given by gain and phase in degrees."""
    angle = np.radians(np.asarray(phase_deg, dtype=float))
    size = np.asarray(gain, dtype=float)
    return np.column_stack([size * np.cos(angle), size * np.sin(angle)])


def spectrum(view: View) -> Chart:
    """Spectra of the prepared outputs with their peaks."""
    table = _with_peaks(view.spectrum, view.peaks)
    return _densities(
        view,
        table[table["frequency_hz"] > 0],
        Curve("estimate with 95 % band", "density", "ink", band=("lower", "upper")),
        Curve("peaks", "peak", "error", "points", marker="v", names="peak_name"),
    )


def _with_peaks(table: pd.DataFrame, peaks: Mapping[str, Sequence[SpectralPeak]]) -> pd.DataFrame:
    """The table with a column of the peaks' densities, and of the names of the prominent ones."""
    table = table.assign(peak=np.nan, peak_name="")
    for output, found in peaks.items():
        prominent = sorted(found, key=lambda peak: -peak.prominence_db)[:MOST_LABELS]
        for peak in found:
            near = (table["output"] == output) & np.isclose(
                table["frequency_hz"], peak.frequency_hz, rtol=1e-9
            )
            table.loc[near, "peak"] = peak.density
            if peak in prominent:
                table.loc[near, "peak_name"] = f"{peak.frequency_hz:.4g} Hz"
    return table


def residual_spectrum(view: View) -> Chart:
    """Spectra of the one-step errors on the validation samples, and the level of white noise."""
    table = view.residual_spectrum
    if table.empty:
        return nothing("There are too few residuals for a spectrum.")
    return _densities(
        view,
        table[table["frequency_hz"] > 0],
        Curve("residuals with 95 % band", "density", "ink", band=("lower", "upper")),
        Curve("white noise of the same variance", "white_level", "error", dashed=True),
    )


def _densities(view: View, table: pd.DataFrame, *curves: Curve) -> Chart:
    outputs = view.outputs[:MOST_PANELS]
    panels = tuple(
        _panel(
            *(view, "" if len(view.outputs) == 1 else output.name, view.density_label(output)),
            [replace(each, where=view.where(output)) for each in curves],
            small(outputs, 230),
            scale="logarithmic",
            marks=true_modes(view) if curves[-1].column == "peak" else (),
        )
        for output in outputs
    )
    return Chart(table, panels, across(panels))
