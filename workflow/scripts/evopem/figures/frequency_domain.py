"""Figures over frequency: spectra, gain, phase and coherence of every pair of channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from evopem.errors import InputError
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
    of_pair,
    rows_of,
    small,
)
from evopem.figures.style import extremes
from evopem.results.channels import Channel, Pair, gain_unit, with_unit
from evopem.results.dataset import DatasetResults
from evopem.signals.spectra import multitaper_spectrum
from evopem.signals.spectrum_summary import SpectralPeak

PLANT, NOISE_FILTER = "model G", "noise filter H"
# Bins of the gain on the first screen; twice as many points show all its extremes.
GAIN_BINS = 300
# Length of the transforms of the residuals: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024
# Number of peaks that are labelled, the most prominent ones.
MOST_LABELS = 8
# A response at 0 Hz that exceeds all others by this factor is that of an integrator.
UNBOUNDED = 1e6
# Points of a Nyquist diagram; neighbours of the estimate from the data are almost the same.
NYQUIST_POINTS, FEWEST_NYQUIST = 1200, 150
MOST_NYQUIST = 12


def model_source(results: DatasetResults) -> tuple[str, str]:
    """The rows of the model in a table of frequency responses, and how it is labelled."""
    return ("model", PLANT) if results.model.has_input else ("noise filter", NOISE_FILTER)


def true_modes(results: DatasetResults) -> tuple[Mark, ...]:
    """Marks at the true natural frequencies, if there is a truth."""
    found = results.true_modes
    return tuple(
        Mark(mode.frequency_hz, "" if place else "true modes", "truth")
        for place, mode in enumerate(found)
    )


def _panel(
    results: DatasetResults,
    title: str,
    y_label: str,
    curves: Sequence[Curve],
    height: int,
    **options: Any,
) -> Panel:
    return Panel(
        *(title, "frequency_hz", FREQUENCY, y_label, tuple(curves)),
        highest=results.model.sampling_rate / 2,
        height=height,
        linked="frequency",
        **options,
    )


def _over_data(results: DatasetResults, pair: Pair, curve: Curve) -> list[Curve]:
    """The curve of a pair's model; with an input over the one that the data give."""
    where, kind = of_pair(*pair), model_source(results)[0]
    model = replace(curve, where=(("source", kind), *where))
    measured = (("source", "measured"), *where)
    data = Curve("from the data", curve.column, "muted", curve.kind, where=measured)
    return [data, model] if results.model.has_input else [model]


def gain_panels(results: DatasetResults, marks: Sequence[Mark], height: int) -> list[Panel]:
    """The gain of every pair over the data."""
    kind, label = model_source(results)
    table = results.responses
    table = table[table["source"] == kind]
    band = Curve(f"{label} with 95 % band", "gain", "model", band=("gain_lower", "gain_upper"))
    return [
        _panel(
            *(results, results.pair_title(*pair), with_unit("Gain", gain_unit(*pair))),
            *(_over_data(results, pair, band), height),
            scale="logarithmic",
            limits=around(rows_of(table, of_pair(*pair))["gain"]),
            marks=tuple(marks),
        )
        for pair in results.pairs[:MOST_PANELS]
    ]


def gain(results: DatasetResults) -> Chart:
    """Gain with its 95 % band over the estimate from the data, trusted modes marked."""
    table = results.responses
    kept = table[table["source"].isin([model_source(results)[0], "measured"])]
    kept = kept[kept["frequency_hz"] > 0].dropna(axis="columns", how="all")
    columns = [each for each in kept if each not in ("phase_deg", "coherence")]
    keys = [each for each in ("source", "output", "input") if each in columns]
    thin = [
        rows.iloc[extremes(rows["gain"], GAIN_BINS)]
        for _, rows in kept[columns].groupby(keys, sort=False)
    ]
    trusted = results.validation.modes.trusted
    marks = [Mark(m.frequency_hz, "" if k else "trusted modes") for k, m in enumerate(trusted)]
    together = pd.concat(thin, ignore_index=True)
    for name in ("gain_lower", "gain_upper"):
        together[name] = together.get(name, np.nan)
    panels = gain_panels(results, marks, 210 if len(results.pairs) == 1 else 150)
    return Chart(together, tuple(panels), columns_of(results, panels))


def frequency_response(results: DatasetResults) -> Chart:
    """Gain, phase and coherence; of very many pairs the phases alone."""
    has_room = 2 * len(results.pairs) + len(results.outputs) <= MOST_PANELS
    panels = (
        gain_panels(results, true_modes(results), small(results.pairs, 230)) if has_room else []
    )
    phase = Curve(model_source(results)[1], "phase_deg", "model", "points")
    panels += [
        _panel(
            *(results, results.pair_title(*pair), "Phase (°)", _over_data(results, pair, phase)),
            small(results.pairs, 170),
            scale="phase",
            limits=(-190, 190),
        )
        for pair in results.pairs[:MOST_PANELS]
    ]
    if results.model.has_input and has_room:
        for output in results.outputs:
            where = (("source", "measured"), *of_pair(output, results.inputs[0]))
            curves = [Curve("coherence", "coherence", "muted", where=where)]
            title = "" if results.is_single else f"{output.name}: coherence with all inputs"
            panels.append(_panel(results, title, "Coherence", curves, 110, limits=(0, 1.05)))
    table = results.responses[results.responses["frequency_hz"] > 0]
    if results.model.has_input and not results.is_single:
        table = table[table["source"] != "noise filter"]  # room for the responses that are drawn
    return Chart(table, tuple(panels), columns_of(results, panels[: len(results.pairs)]))


def nyquist(results: DatasetResults) -> Chart:
    """G of every pair in the complex plane over positive frequencies."""
    if not results.model.has_input:
        return nothing("The model has no input.")
    if len(results.pairs) > MOST_NYQUIST:
        return nothing(f"There are more than {MOST_NYQUIST} pairs of channels.")
    table = results.responses
    table = table[(table["source"] != "noise filter") & (table["frequency_hz"] > 0)]
    parts = complex_plane(table["gain"], table["phase_deg"])
    columns = ["source", "output", "input", "frequency_hz"]
    together = table[columns].assign(real=parts[:, 0], imag=parts[:, 1])
    most = max(NYQUIST_POINTS // len(results.pairs), FEWEST_NYQUIST)
    together = pd.concat(
        [
            rows.iloc[:: -(-len(rows) // most)]
            for (source, *_), rows in together.groupby(columns[:3], sort=False)
        ]
    )
    panels = []
    for pair in results.pairs:
        model = Curve(PLANT, "imag", "model", where=(("source", "model"), *of_pair(*pair)))
        measured = (("source", "measured"), *of_pair(*pair))
        data = Curve("from the data", "imag", "muted", "points", where=measured, marker=".")
        reach = _reach(rows_of(together, model.where)[["real", "imag"]].to_numpy())
        unit = gain_unit(*pair)
        panels.append(
            Panel(
                *(results.pair_title(*pair), "real", with_unit("Real part of G", unit)),
                *(with_unit("Imaginary part of G", unit), (data, model)),
                limits=(-reach, reach),
                plane="complex",
                height=330 if len(results.pairs) == 1 else 220,
            )
        )
    return Chart(together, tuple(panels), columns_of(results, panels))


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


def spectrum(results: DatasetResults) -> Chart:
    """Spectra of the prepared outputs with their peaks."""
    table = results.spectrum
    if results.inputs:
        table = table[table["input"] == results.inputs[0].name]
    table = table[["output", "frequency_hz", "density", "lower", "upper"]].reset_index(drop=True)
    for output, summary in zip(results.outputs, results.spectrum_summaries, strict=True):
        table = _with_peaks(table, output.name, summary.peaks)
    return _densities(
        results,
        table[table["frequency_hz"] > 0],
        Curve("estimate with 95 % band", "density", "ink", band=("lower", "upper")),
        Curve("peaks", "peak", "error", "points", marker="v", names="peak_name"),
    )


def _with_peaks(table: pd.DataFrame, output: str, peaks: Sequence[SpectralPeak]) -> pd.DataFrame:
    """The table with a column of the peaks' densities, and of the names of the prominent ones."""
    if "peak" not in table:
        table = table.assign(peak=np.nan, peak_name="")
    prominent = sorted(peaks, key=lambda peak: -peak.prominence_db)[:MOST_LABELS]
    for peak in peaks:
        near = np.isclose(table["frequency_hz"], peak.frequency_hz, rtol=1e-9)
        rows = (table["output"] == output) & near
        table.loc[rows, "peak"] = peak.density
        if peak in prominent:
            table.loc[rows, "peak_name"] = f"{peak.frequency_hz:.4g} Hz"
    return table


def residual_spectra(results: DatasetResults) -> pd.DataFrame:
    """Multitaper spectra of the one-step errors, with bands and the levels of white noise."""
    simulation, rate, tables = results.validation_tables.simulation, results.model.sampling_rate, []
    for output in results.outputs:
        errors = simulation[f"output_{output.name}"] - simulation[f"predicted_{output.name}"]
        errors = errors.dropna().to_numpy(dtype=float)
        try:
            found = multitaper_spectrum(errors, rate, nfft=RESIDUAL_NFFT)
        except InputError:  # too few of them
            continue
        columns = {
            "output": output.name,
            "frequency_hz": found.frequencies,
            "density": found.density,
            "lower": found.lower,
            "upper": found.upper,
            "white_level": 2.0 * float(np.var(errors)) / rate,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def residual_spectrum(results: DatasetResults) -> Chart:
    """Spectra of the one-step errors on the validation samples, and the level of white noise."""
    table = residual_spectra(results)
    if table.empty:
        return nothing("There are too few residuals for a spectrum.")
    return _densities(
        results,
        table[table["frequency_hz"] > 0],
        Curve("residuals with 95 % band", "density", "ink", band=("lower", "upper")),
        Curve("white noise of the same variance", "white_level", "error", dashed=True),
    )


def _density_label(output: Channel) -> str:
    unit = output.prepared_unit
    return with_unit("Power spectral density", f"({unit})²/Hz" if unit else "per Hz")


def _densities(results: DatasetResults, table: pd.DataFrame, *curves: Curve) -> Chart:
    outputs = results.outputs[:MOST_PANELS]
    panels = tuple(
        _panel(
            *(
                results,
                "" if len(results.outputs) == 1 else output.name,
                _density_label(output),
            ),
            [replace(each, where=of_pair(output)) for each in curves],
            small(outputs, 230),
            scale="logarithmic",
            marks=true_modes(results) if curves[-1].column == "peak" else (),
        )
        for output in outputs
    )
    return Chart(table, panels, across(panels))
