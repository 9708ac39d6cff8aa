"""Figures over frequency: the output's spectrum and the frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.style import (
    ERROR,
    INK,
    LABEL_BOX,
    MODEL,
    MUTED,
    TRUTH,
    Grid,
    decimate,
    extremes,
    figure_of,
    logarithmic,
    say_nothing_to_draw,
    styled,
    with_unit,
)
from evopem.signals.spectral.peaks import SpectralPeak
from evopem.synthesis.truth import Truth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SPECTRUM = Grid(height=3.3)
FREQUENCY_RESPONSE = Grid(height=5.2, rows=3, sharex=True, height_ratios=(1.7, 1.1, 0.7))
NYQUIST = Grid(height=4.6, width=5.6)
RESIDUAL_SPECTRUM = Grid(height=2.9)

# Spectra are smooth over the bandwidth of the multitaper estimate, so few bins suffice.
BINS = 400
# Number of peaks that are labelled, the most prominent ones.
MOST_LABELS = 8
# Labels closer than this share of the band would overlap.
LABEL_WIDTH = 0.1
PLANT, NOISE_FILTER = "model G", "noise filter H"
# A response at 0 Hz that exceeds all others by this factor is that of an integrator.
UNBOUNDED = 1e6


def _thinned(table: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Reduce a table to the rows with the extremes of the columns."""
    kept = np.unique(np.concatenate([extremes(table[column], BINS) for column in columns]))
    return table.iloc[kept]


def _draw_density(axes: Axes, shown: pd.DataFrame, label: str, width: float) -> None:
    """Draw a spectral density with its 95 % band."""
    frequencies = shown["frequency_hz"]
    axes.fill_between(
        frequencies,
        shown["lower"],
        shown["upper"],
        color=MODEL,
        alpha=0.22,
        linewidth=0,
        label="95 % band",
    )
    axes.plot(frequencies, shown["density"], color=INK, linewidth=width, label=label)


def mark_truth(axes: Axes, truth: Truth | None) -> None:
    """Draw vertical lines at the true natural frequencies, if there is a truth."""
    for number, mode in enumerate(truth.modes if truth else ()):
        axes.axvline(
            mode.frequency_hz,
            color=TRUTH,
            linewidth=0.9,
            linestyle=(0, (1.2, 1.6)),
            zorder=1,
            label="true modes" if number == 0 else None,
        )


@styled
def draw_spectrum(
    spectrum: pd.DataFrame,
    peaks: Sequence[SpectralPeak],
    unit: str = "",
    truth: Truth | None = None,
    axes: Axes | None = None,
) -> Figure:
    """Multitaper spectrum of the output with its 95 % band and peaks (chapter figure 4).

    Parameters
    ----------
    spectrum : pandas.DataFrame
        As in ``spectrum.csv``.
    peaks : sequence of SpectralPeak
    unit : str
        Unit of the prepared output, "" when not stated.
    truth : Truth, optional
        Its modes are marked.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = SPECTRUM.panels(axes)
    shown = spectrum[(spectrum["frequency_hz"] > 0) & (spectrum["density"] > 0)]
    shown = _thinned(shown, "density")
    _draw_density(axes, shown, "estimate", 1.0)
    logarithmic(axes)
    axes.set_xlim(0, shown["frequency_hz"].max())
    mark_truth(axes, truth)
    if peaks:
        axes.plot(
            [peak.frequency_hz for peak in peaks],
            [peak.density for peak in peaks],
            linestyle="none",
            marker="v",
            markersize=6,
            color=ERROR,
            label="peaks",
        )
    _name_peaks(axes, peaks, float(shown["frequency_hz"].max()))
    axes.margins(y=0.12)
    axes.set_xlabel("Frequency (Hz)")
    squared = f"({unit})²/Hz" if unit else "per Hz"
    axes.set_ylabel(with_unit("Power spectral density", squared))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
    return figure_of(axes)


def _name_peaks(axes: Axes, peaks: Sequence[SpectralPeak], highest: float) -> None:
    """Label the most prominent peaks with their frequencies, neighbours on different levels."""
    prominent = sorted(peaks, key=lambda peak: -peak.prominence_db)
    left, level = -highest, 0
    for peak in sorted(prominent[:MOST_LABELS], key=lambda peak: peak.frequency_hz):
        frequency = peak.frequency_hz
        level = (level + 1) % 3 if frequency - left < LABEL_WIDTH * highest else 0
        left = frequency
        axes.annotate(
            f"{frequency:.4g} Hz",
            (frequency, peak.density),
            xytext=(0, 7 + 11 * level),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=INK,
            bbox=LABEL_BOX,
        )


@styled
def draw_frequency_response(
    response: pd.DataFrame,
    spectrum: pd.DataFrame | None = None,
    unit: str = "",
    truth: Truth | None = None,
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Gain and phase of G with its 95 % band, and the multitaper estimate (chapter figure 7).

    Parameters
    ----------
    response : pandas.DataFrame
        As in ``frequency_response.csv``.
    spectrum : pandas.DataFrame, optional
        As in ``spectrum.csv``, for the multitaper estimate and the coherence.
    unit : str
        Unit of the gain, "" when not stated.
    truth : Truth, optional
        Its modes are marked.
    axes : sequence of three matplotlib.axes.Axes, optional
        Where gain, phase and coherence are drawn; on a new figure by default.

    Notes
    -----
    Of a model without input the response of the noise filter is drawn.
    """
    response, label = plant_or_noise_filter(response)
    if label == NOISE_FILTER:
        spectrum = None
    gain, phase, coherence = FREQUENCY_RESPONSE.panels(axes)
    estimate = None if spectrum is None else with_positive_frequency(spectrum)
    for panel in (gain, phase):
        mark_truth(panel, truth)
    shown = draw_gain(gain, response, estimate, unit, label)
    if estimate is not None:
        _draw_phase_and_coherence(phase, coherence, estimate)
    phase.plot(*unwrapped_gaps(shown["frequency_hz"], shown["phase_deg"]), color=MODEL)
    phase.set_ylabel("Phase (°)")
    phase.set_ylim(-190, 190)
    phase.set_yticks([-180, -90, 0, 90, 180])
    coherence.set_ylabel("Coherence")
    coherence.set_ylim(0, 1.05)
    coherence.set_xlabel("Frequency (Hz)")
    coherence.set_xlim(0, float(shown["frequency_hz"].max()))
    return figure_of(gain)


def with_positive_frequency(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of a table above 0 Hz."""
    return table[table["frequency_hz"] > 0]


def plant_or_noise_filter(response: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """The response of G and its label; of a model without input those of the noise filter H.

    Parameters
    ----------
    response : pandas.DataFrame
        As in ``frequency_response.csv``.
    """
    if response["gain"].notna().any():
        return response, PLANT
    columns = {f"noise_{name}": name for name in ("gain", "gain_lower", "gain_upper", "phase_deg")}
    return response[["frequency_hz", *columns]].rename(columns=columns), NOISE_FILTER


def draw_gain(
    axes: Axes, response: pd.DataFrame, spectrum: pd.DataFrame | None, unit: str, label: str
) -> pd.DataFrame:
    """Draw a gain with its band over the multitaper estimate; return what was drawn of the gain."""
    if spectrum is not None:
        axes.plot(
            *decimate(spectrum["frequency_hz"], spectrum["frequency_response_gain"], BINS),
            color=MUTED,
            linewidth=0.7,
            label="multitaper",
        )
    shown = _thinned(with_positive_frequency(response), "gain")
    if shown["gain_lower"].notna().any():
        floor = 1e-3 * float(shown["gain"].min())
        axes.fill_between(
            shown["frequency_hz"],
            shown["gain_lower"].clip(lower=floor),
            shown["gain_upper"],
            color=MODEL,
            alpha=0.28,
            linewidth=0,
            label="95 % band",
        )
    axes.plot(shown["frequency_hz"], shown["gain"], color=MODEL, linewidth=1.5, label=label)
    _gain_limits(axes, shown["gain"])
    logarithmic(axes)
    axes.set_ylabel(with_unit("Gain", unit))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
    return shown


def _draw_phase_and_coherence(phase: Axes, coherence: Axes, spectrum: pd.DataFrame) -> None:
    frequency = spectrum["frequency_hz"]
    x, y = unwrapped_gaps(frequency, spectrum["frequency_response_phase_deg"])
    phase.plot(x, y, color=MUTED, linewidth=0.7)
    x, y = decimate(frequency, spectrum["coherence"], BINS)
    coherence.fill_between(x, y, color=MUTED, alpha=0.35, linewidth=0)
    coherence.plot(x, y, color=MUTED, linewidth=0.7)


def _gain_limits(axes: Axes, gain: pd.Series) -> None:
    """Scale the axis to the model rather than to the scatter of the multitaper estimate."""
    positive = gain[gain > 0]
    if len(positive):
        axes.set_ylim(float(positive.min()) / 4, float(positive.max()) * 4)


def unwrapped_gaps(frequency: pd.Series, degrees: pd.Series) -> tuple[np.ndarray, np.ndarray]:
    """Wrap a phase to ±180° and break its line where it jumps from one end to the other."""
    x = np.asarray(frequency, dtype=float)
    wrapped = (np.asarray(degrees, dtype=float) + 180.0) % 360.0 - 180.0
    jumps = np.flatnonzero(np.abs(np.diff(wrapped)) > 180.0) + 1
    return np.insert(x, jumps, x[jumps - 1] if jumps.size else []), np.insert(
        wrapped, jumps, np.nan
    )


@styled
def draw_nyquist(
    response: pd.DataFrame, spectrum: pd.DataFrame, unit: str = "", axes: Axes | None = None
) -> Figure:
    """G in the complex plane over positive frequencies, with the multitaper estimate.

    Parameters
    ----------
    response, spectrum : pandas.DataFrame
        As in ``frequency_response.csv`` and ``spectrum.csv``.
    unit : str
        Unit of the gain, "" when not stated.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = NYQUIST.panels(axes)
    if response["gain"].isna().all():
        say_nothing_to_draw(axes, "The model has no input.")
        return figure_of(axes)
    model = complex_plane(response["gain"], response["phase_deg"])
    estimate = with_positive_frequency(spectrum)
    points = complex_plane(
        estimate["frequency_response_gain"], estimate["frequency_response_phase_deg"]
    )
    # Neighbouring points of the multitaper estimate are almost the same within its bandwidth.
    step = max(1, len(points) // BINS)
    axes.plot(*points[::step].T, ".", color=MUTED, markersize=2.5, label="multitaper")
    axes.plot(*model.T, color=MODEL, linewidth=1.3, label="model G")
    magnitudes = np.abs(model).max(axis=1)
    # At 0 Hz the response of an integrator is infinite, or as large as rounding makes it.
    if not magnitudes[0] < UNBOUNDED * magnitudes[1:].max(initial=0.0):
        magnitudes = magnitudes[1:]
    reach = 1.15 * float(magnitudes.max(initial=0.0)) or 1.0
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    for line in (axes.axhline, axes.axvline):
        line(0, color=INK, linewidth=0.6)
    axes.plot(-1, 0, "+", color=ERROR, markersize=8, label="−1")
    axes.set_xlabel(with_unit("Real part of G", unit))
    axes.set_ylabel(with_unit("Imaginary part of G", unit))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    return figure_of(axes)


def complex_plane(gain: pd.Series, phase_deg: pd.Series) -> np.ndarray:
    """Real and imaginary parts, (N, 2), of a response given by gain and phase in degrees."""
    angle = np.radians(np.asarray(phase_deg, dtype=float))
    size = np.asarray(gain, dtype=float)
    return np.column_stack([size * np.cos(angle), size * np.sin(angle)])


@styled
def draw_residual_spectrum(table: pd.DataFrame, unit: str = "", axes: Axes | None = None) -> Figure:
    """Spectrum of the residuals with its 95 % band, and the level of white noise.

    Parameters
    ----------
    table : pandas.DataFrame
        ``frequency_hz``, ``density``, ``lower``, ``upper`` and ``white_level``.
    unit : str
        Unit of the prepared output, "" when not stated.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = RESIDUAL_SPECTRUM.panels(axes)
    if table.empty:
        say_nothing_to_draw(axes, "There are too few residuals for a spectrum.")
        return figure_of(axes)
    shown = _thinned(with_positive_frequency(table), "density")
    _draw_density(axes, shown, "residuals", 0.9)
    axes.plot(
        shown["frequency_hz"],
        shown["white_level"],
        color=ERROR,
        linewidth=1.0,
        linestyle=(0, (4, 2)),
        label="white noise of the same variance",
    )
    logarithmic(axes)
    axes.set_xlim(0, shown["frequency_hz"].max())
    axes.set_xlabel("Frequency (Hz)")
    squared = f"({unit})²/Hz" if unit else "per Hz"
    axes.set_ylabel(with_unit("Power spectral density", squared))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    return figure_of(axes)
