"""What moves: modes over time, and the frozen gain beside the spectrogram of the output."""

from dataclasses import replace

import numpy as np
import pandas as pd
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.automatic.varying import Varying, table_of, whole
from evopem.config.settings import VaryingSettings
from evopem.estimation.varying import Scheduled
from evopem.figures.chart import TIME, Chart, Curve, Panel, family
from evopem.figures.style import styled, svg_text
from evopem.models.varying import VaryingModel
from evopem.signals.prepared_data import PreparedData
from evopem.synthesis import Truth

# Moments and frequencies of the picture, and decibels below the highest value that it tells apart.
MOMENTS, FREQUENCIES, RANGE = 120, 160, 60.0
HALFBANDWIDTH, TAPERS = 2.5, 4  # time-halfbandwidth product and tapers of the spectrogram


def moving_modes(varying: Varying, truth: Truth | None = None) -> Chart:
    """Natural frequencies and damping ratios along the schedule with 95 % bands.

    A known truth that moves stands behind them, as modes of negative numbers.
    """
    assert varying.moves is not None
    along, label_along = varying.moves.column, axis_of(varying.moves.schedule)
    table = pd.DataFrame(table_of(varying)).astype({"mode": int})
    rows = {f"mode {n}": (("mode", str(n)),) for n in sorted(set(table["mode"]))}
    true = dict(zip(truth.modes, truth.last_hz, strict=True)) if truth and truth.last_hz else {}
    behind: list[Curve] = []
    for number, (mode, last) in enumerate(true.items(), start=1):
        ends = {along: [table[along].min(), table[along].max()]}
        ends |= {"mode": [-number] * 2, "frequency_hz": [mode.frequency_hz, last]}
        table = pd.concat([table, pd.DataFrame(ends)], ignore_index=True)
        label, where = "" if behind else "true modes", (("mode", str(-number)),)
        behind.append(Curve(label, "frequency_hz", "truth", dashed=True, where=where))
    panels = []
    for name, label, column in (
        ("frequency", "Natural frequency (Hz)", "frequency_hz"),
        ("damping", "Damping ratio (%)", "damping_percent"),
    ):
        band = (f"{name}_lower", f"{name}_upper")
        curves = tuple(replace(c, band=band, marker="") for c in family(column, rows))
        curves = (*curves, *(behind if name == "frequency" else ()))
        panels.append(Panel("", along, label_along, label, curves, linked="time"))
    return Chart(table, tuple(panels))


def axis_of(schedule: str) -> str:
    """What the axis along the schedule is called."""
    return TIME if schedule == "time" else schedule.capitalize()


def frozen_gains(model: VaryingModel) -> tuple[Array, Array, Array]:
    """Times (T,), frequencies (F,), and gain from the first input, or of the noise, (F, T), dB."""
    times = np.linspace(model.basis.low, model.basis.high, MOMENTS)
    frequencies = np.linspace(0.0, model.sampling_rate / 2.0, FREQUENCIES + 1)[1:]
    columns = []
    for time in times:
        frozen = model.frozen(float(time))
        response = frozen.frequency_response if frozen.inputs else frozen.noise_response
        columns.append(np.abs(response(frequencies)[:, 0, 0]))
    return times, frequencies, 20.0 * np.log10(np.maximum(columns, 1e-300)).T


def spectrograms(scheduled: Scheduled) -> list[tuple[Array, Array, Array]]:
    """Times, frequencies and multitaper power, (F, T), dB, of stretches that fill a window."""
    y, times, rate = scheduled.data.output, scheduled.schedule, scheduled.data.sampling_rate
    breaks = np.flatnonzero(np.abs(np.diff(times) * rate - 1.0) > 0.5) + 1
    length = max(int(np.sqrt(8.0 * scheduled.data.longest.samples)), 16)
    windows = scipy.signal.windows.dpss(length, HALFBANDWIDTH, TAPERS)
    drawn: list[tuple[Array, Array, Array]] = []
    for part in np.split(np.arange(len(y)), breaks):
        if len(part) < length:
            continue
        transforms = [
            scipy.signal.ShortTimeFFT(taper, max(length // 8, 1), rate) for taper in windows
        ]
        centred = y[part] - y[part].mean()
        powers = [np.abs(transform.stft(centred)) ** 2 for transform in transforms]
        at = transforms[0].t(len(part))
        inside = (at >= 0.0) & (at <= len(part) / rate)
        levels = 10.0 * np.log10(np.maximum(np.sum(powers, axis=0)[:, inside], 1e-300))
        drawn.append((times[part[0]] + at[inside], transforms[0].f, levels))
    return drawn


@styled
def picture(data: PreparedData, model: VaryingModel) -> str:
    """The frozen gain beside the multitaper spectrogram of the output, as SVG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.0), layout="constrained")
    parts = [("Gain of the moving model", [frozen_gains(model)])]
    if model.schedule == "time":
        parts.append(("Spectrogram of the output", spectrograms(whole(data, VaryingSettings()))))
    row = figure.subplots(1, len(parts), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, drawn) in zip(row, parts, strict=True):
        top = max(float(levels.max()) for *_, levels in drawn)
        for stretch in drawn:
            mesh = axes.pcolormesh(*stretch, vmin=top - RANGE, vmax=top, rasterized=True)
        axes.set_title(title)
        axes.set_xlabel(axis_of(model.schedule))
        figure.colorbar(mesh, ax=axes, label="dB")
    figure.axes[0].set_ylabel("Frequency (Hz)")
    return svg_text(figure)
