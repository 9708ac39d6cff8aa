"""Figures over frequency: spectra, gain, phase and coherence of every pair of channels."""

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
    Role,
    across,
    around,
    columns_of,
    nothing,
    of_pair,
    rows_of,
    small,
)
from evopem.figures.style import thin_table
from evopem.models.modes import Mode
from evopem.results.channel_labels import Pair, gain_unit, with_unit
from evopem.results.dataset import DatasetResults
from evopem.signals.spectra import multitaper_spectrum
from evopem.signals.spectrum_summary import SpectralPeak

# Colours of what moves the gain that the data give.
LEVELS: dict[str, Role] = {"noise": "truth", "distortion": "error"}
# Points of a curve on the first screen, and of all curves together.
CURVE_POINTS, MOST_POINTS = 1200, 4800
# Length of the transforms of the residuals: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024
MOST_LABELS = 8  # number of peaks that are labelled, the most prominent ones
# A response at 0 Hz that exceeds all others by this factor is that of an integrator.
UNBOUNDED = 1e6
# Points of a Nyquist diagram; neighbours of the estimate from the data are almost the same.
NYQUIST_POINTS, FEWEST_NYQUIST = 1200, 150
MOST_NYQUIST = 12


def true_modes(results: DatasetResults) -> tuple[Mark, ...]:
    """Marks at the true natural frequencies, if there is a truth."""
    return _marks(results.true_modes, "true modes", "truth")


def _marks(modes: Sequence[Mode], label: str, colour: Role) -> tuple[Mark, ...]:
    return tuple(
        Mark(mode.frequency_hz, "" if place else label, colour) for place, mode in enumerate(modes)
    )


def _panel(
    results: DatasetResults,
    words: tuple[str, str],
    curves: Sequence[Curve],
    height: int,
    **options: Any,
) -> Panel:
    """Curves over the frequency; `words`: title and label of the ordinate."""
    title, y_label = words
    return Panel(
        *(title, "frequency_hz", FREQUENCY, y_label, tuple(curves)),
        highest=results.highest_hz,
        height=height,
        linked="frequency",
        **options,
    )


def _over_data(results: DatasetResults, pair: Pair, model: Curve) -> list[Curve]:
    """The curve of a pair's model; with an input over the one that the data give."""
    kinds = ["measured", "model"] if results.model.has_input else ["noise filter"]
    curves = [Curve("from the data", model.column, "muted", model.kind), model]
    return [
        replace(curve, where=(("source", kind), *of_pair(*pair)))
        for curve, kind in zip(curves[-len(kinds) :], kinds, strict=True)
    ]


def gain_panels(results: DatasetResults, height: int, marks: tuple[Mark, ...] = ()) -> list[Panel]:
    """The gain of every pair over the data."""
    kind, label = results.model_source
    table = results.responses[results.responses["source"] == kind]
    band = Curve(f"{label} with 95 % band", "gain", "model", band=("gain_lower", "gain_upper"))
    return [
        _panel(
            *(results, (results.pair_title(*pair), with_unit("Gain", gain_unit(*pair)))),
            *(_over_data(results, pair, band), height),
            scale="logarithmic",
            limits=around(rows_of(table, of_pair(*pair))["gain"]),
            marks=marks,
        )
        for pair in results.pairs[:MOST_PANELS]
    ]


def phase_panels(results: DatasetResults, height: int) -> list[Panel]:
    """The phase of every pair over the data."""
    phase = Curve(results.model_source[1], "phase_deg", "model", "points")
    return [
        _panel(
            *(results, (results.pair_title(*pair), "Phase (°)")),
            *(_over_data(results, pair, phase), height),
            scale="phase",
            limits=(-190, 190),
        )
        for pair in results.pairs[:MOST_PANELS]
    ]


def thinned(results: DatasetResults) -> pd.DataFrame:
    """The responses of model and data above 0 Hz in fewer rows, with extremes of the gain.

    Without a gain that is not above 0 in its 95 % band, as between the lines of an input.
    """
    table = results.responses
    table = table[table["source"].isin([results.model_source[0], "measured"])]
    table = table[table["frequency_hz"] > 0]
    if not results.of_responses and "gain_lower" in table:
        unknown = (table["source"] == "measured") & (table["gain_lower"] == 0.0)
        gains = ["gain", "gain_lower", "gain_upper", "phase_deg"]
        table = table.assign(**{name: table[name].mask(unknown) for name in gains})
    table = table.dropna(axis="columns", how="all")
    keys = [column for column in ("source", "output", "input") if column in table]
    curves = [rows for _, rows in table.groupby(keys, sort=False)]
    points = min(CURVE_POINTS, MOST_POINTS // len(curves))
    shown = [name for name in ("frequency_hz", "gain", "coherence") if name in table]
    parts = [rows.loc[thin_table(rows[shown], points).index] for rows in curves]
    together = pd.concat(parts, ignore_index=True)
    return together.assign(
        **{name: together.get(name, np.nan) for name in ("gain_lower", "gain_upper")}
    )


def gain(results: DatasetResults) -> Chart:
    """Gain with its 95 % band over the estimate from the data; in a page phase and coherence."""
    marks = _marks(results.validation.modes.trusted, "trusted modes", "model")
    panels = gain_panels(results, 210 if len(results.pairs) == 1 else 150, marks)
    table = thinned(results)
    if levels := _levels(results):
        table = pd.concat([table, *levels], ignore_index=True)
        panels = [_with_levels(panel, table) for panel in panels]
    return Chart(table, tuple(panels), columns_of(results, panels))


def _levels(results: DatasetResults) -> list[pd.DataFrame]:
    """What noise and nonlinear distortion move the gain from the data by, as rows of a table."""
    return [
        pd.DataFrame({"frequency_hz": at.frequency_hz, "gain": gains, "gain_upper": gains}).assign(
            gain_lower=1e-6 * np.max(gains),  # below the axis
            source=source,
            output=at.output,
            input=results.inputs[0].name,
        )
        for at in results.validation.distortion.levels
        for source, gains in (("noise", at.noise), ("distortion", at.distortion))
        if np.max(gains) > 0.0 and (source == "noise" or results.validation.distortion.shown)
    ]


def _with_levels(panel: Panel, table: pd.DataFrame) -> Panel:
    """A panel of a gain with the levels below it."""
    pair = panel.curves[-1].where[1:]
    form = Curve("", "gain", "ink", dashed=True, band=("gain_lower", "gain_upper"))
    shown = [
        replace(form, label=f"from {source}", colour=colour, where=(("source", source), *pair))
        for source, colour in LEVELS.items()
        if (table["source"] == source).any()
    ]
    gains = pd.concat([rows_of(table, curve.where)["gain"] for curve in shown])
    low = around(gains.rolling(9, center=True, min_periods=1).median())
    limits = (min(low[0], panel.limits[0]), panel.limits[1]) if low and panel.limits else ()
    return replace(panel, curves=(*panel.curves, *shown), limits=limits)


def frequency_response(results: DatasetResults) -> Chart:
    """Gain, phase and coherence; of very many pairs the phases alone."""
    pairs = results.pairs
    has_room = 2 * len(pairs) + len(results.outputs) <= MOST_PANELS
    gains = gain_panels(results, small(pairs, 230), true_modes(results)) if has_room else []
    panels = gains + phase_panels(results, small(pairs, 170))
    table = results.responses[results.responses["frequency_hz"] > 0]
    if results.model.has_input and has_room and not results.of_responses:
        for output in results.outputs:
            where = (("source", "measured"), *of_pair(output, results.inputs[0]))
            curves = [Curve("coherence", "coherence", "muted", where=where)]
            title = "" if results.is_single else f"{output.name}: coherence with all inputs"
            panels.append(_panel(results, (title, "Coherence"), curves, 110, limits=(0, 1.05)))
    if results.model.has_input and not results.is_single:
        table = table[table["source"] != "noise filter"]  # room for the responses that are drawn
    return Chart(table, tuple(panels), columns_of(results, panels[: len(pairs)]))


def nyquist(results: DatasetResults) -> Chart:
    """G of every pair in the complex plane over positive frequencies."""
    if not results.model.has_input:
        return nothing("The model has no input.")
    if len(results.pairs) > MOST_NYQUIST:
        return nothing(f"There are more than {MOST_NYQUIST} pairs of channels.")
    table = results.responses
    table = table[(table["source"] != "noise filter") & (table["frequency_hz"] > 0)]
    parts = complex_plane(table["gain"], table["phase_deg"])
    keys = ["source", "output", "input"]
    together = table[[*keys, "frequency_hz"]].assign(real=parts[:, 0], imag=parts[:, 1])
    most = max(NYQUIST_POINTS // len(results.pairs), FEWEST_NYQUIST)
    together = pd.concat(
        [rows.iloc[:: -(-len(rows) // most)] for _, rows in together.groupby(keys, sort=False)]
    )
    panels = []
    for pair in results.pairs:
        data, model = _over_data(results, pair, Curve(results.model_source[1], "imag", "model"))
        reach = _reach(rows_of(together, model.where)[["real", "imag"]].to_numpy())
        unit = gain_unit(*pair)
        panels.append(
            Panel(
                *(results.pair_title(*pair), "real", with_unit("Real part of G", unit)),
                with_unit("Imaginary part of G", unit),
                (replace(data, kind="points", marker="."), model),
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
            estimated = multitaper_spectrum(errors, rate, nfft=RESIDUAL_NFFT)
        except InputError:  # too few of them
            continue
        columns = {
            "output": output.name,
            "frequency_hz": estimated.frequencies,
            **{name: getattr(estimated, name) for name in ("density", "lower", "upper")},
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


def _densities(results: DatasetResults, table: pd.DataFrame, *curves: Curve) -> Chart:
    outputs, panels = results.outputs[:MOST_PANELS], []
    marks = true_modes(results) if curves[-1].column == "peak" else ()
    for output in outputs:
        unit = f"({output.prepared_unit})²/Hz" if output.prepared_unit else "per Hz"
        words = results.pair_title(output), with_unit("Power spectral density", unit)
        shown = [replace(curve, where=of_pair(output)) for curve in curves]
        height = small(outputs, 230)
        panels.append(_panel(results, words, shown, height, scale="logarithmic", marks=marks))
    if len(panels) == 1:
        panels = [replace(panels[0], title="")]
    return Chart(table, tuple(panels), across(panels))
