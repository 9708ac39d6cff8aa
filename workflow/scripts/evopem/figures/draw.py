"""Charts drawn by matplotlib, for files, papers and readers without a script; mode shapes."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.arrays import Array, Complex, Flags
from evopem.config.channels import Geometry
from evopem.errors import InputError
from evopem.figures import style
from evopem.figures.chart import Chart, Curve, Panel, rows_of
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.polynomial_roots import ellipse_outline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DASHED = (0, (4, 2))
DOTTED = (0, (1.2, 1.6))
FRAME = 1.3  # half the side of the frame around the unit circle
# Points of all curves of a figure, about; extremes are kept.
POINTS = 6_000
FEWEST_BINS, MOST_BINS = 30, 1000
FEW_PANELS = 6  # more have no minor ticks
NARROW = 2.4  # inches of a panel in a row of many


def panels_of(
    chart: Chart,
    axes: Axes | Sequence[Axes] | None = None,
    make: Callable[..., Figure] | None = None,
) -> list[Axes]:
    """The given axes, one for each panel, or those of a figure that is made, by default unkept."""
    every, across = chart.panels, chart.columns
    rows = [every[first : first + across] for first in range(0, len(every), across)]
    if axes is not None:
        given = list(np.atleast_1d(np.asarray(axes, dtype=object)).ravel())
        wanted = len(rows) * across
        if len(given) != wanted:
            problem = f"there are {len(given)}, and this figure has {wanted}"
            raise InputError("axes", problem, f"give {wanted}, or none for a new figure")
        return given
    from matplotlib.figure import Figure

    heights = [max(panel.height for panel in row) for row in rows]
    size = max(style.WIDTH, NARROW * across), max(sum(heights) / style.PIXELS, 1.8)
    figure = make(figsize=size, layout="constrained") if make else Figure(figsize=size)
    return list(figure.subplots(len(rows), across, squeeze=False, height_ratios=heights).ravel())


@style.styled
def draw(chart: Chart, axes: Axes | Sequence[Axes] | None = None) -> Figure:
    """Draw a chart."""
    places = panels_of(chart, axes)
    if chart.nothing:
        style.say_nothing_to_draw(places[0], chart.nothing)
        return places[0].figure  # type: ignore[return-value]
    curves = sum(len(panel.curves) for panel in chart.panels)
    bins = min(max(POINTS // (4 * max(curves, 1)), FEWEST_BINS), MOST_BINS)
    before: list[str] = []
    for number, (panel, place) in enumerate(zip(chart.panels, places, strict=False)):
        below = number + chart.columns
        last = below >= len(chart.panels) or chart.panels[below].x_label != panel.x_label
        beside = number % chart.columns and chart.panels[number - 1].y_label == panel.y_label
        labels = [curve.label for curve in panel.curves]
        keyed = labels != before or not beside
        _draw_panel(place, panel, chart.table, bins, keyed, crowded=chart.columns > 1)
        before = labels if len(chart.panels) > 1 and chart.columns > 1 else []
        place.set_xlabel(panel.x_label if last else "")
        lines = textwrap.wrap(panel.y_label, 26, break_on_hyphens=False)[:3]
        place.set_ylabel("" if beside else "\n".join(lines))
        # A label of what lies below another panel of the same abscissa says nothing new.
        place.tick_params(labelbottom=last or panel.linked == "")
        if len(chart.panels) > FEW_PANELS:
            place.minorticks_off()
    for place in places[len(chart.panels) :]:
        place.set_axis_off()
    if axes is None:
        style.arrange(places, chart.columns)
    return places[0].figure  # type: ignore[return-value] # or a part of one, which is like it


def _draw_panel(
    axes: Axes, panel: Panel, table: pd.DataFrame, bins: int, keyed: bool, crowded: bool
) -> None:
    axes.set_title(panel.title)
    for draw_line, marks, width, dashes in (
        (axes.axvline, panel.marks, 0.9, DOTTED),
        (axes.axhline, panel.levels, 1.0, DASHED),
    ):
        for mark in marks:
            colour = style.COLOURS[mark.colour]
            line = draw_line(mark.value, color=colour, linewidth=width, zorder=1)
            line.set(linestyle=dashes, label=mark.label or "_")
    if panel.plane:
        _plane(axes, panel)
    for curve in panel.curves:
        if not curve.source:
            _draw_curve(axes, panel, curve, rows_of(table, curve.where), bins)
    _scales(axes, panel)
    if keyed and any(axes.get_legend_handles_labels()[1]):
        _legend(axes, panel, crowded)


def _draw_curve(axes: Axes, panel: Panel, curve: Curve, rows: pd.DataFrame, bins: int) -> None:
    colour, label = style.COLOURS[curve.colour], curve.label or "_"
    rows = rows[rows[curve.column].notna()]
    x, y = rows[panel.x].to_numpy(dtype=float), curve.factor * rows[curve.column].to_numpy(float)
    if panel.shown:
        kept = x <= panel.shown
        rows, x, y = rows[kept], x[kept], y[kept]
    if panel.scale == "logarithmic":
        y = np.where(y > 0, y, np.nan)
    if curve.band and rows[curve.band[0]].notna().any():
        _band(axes, panel, curve, rows, bins)
    if curve.ellipse:
        for row in rows[[panel.x, curve.column, *curve.ellipse]].to_numpy(dtype=float):
            if np.isfinite(row).all():
                real, imag, of_real, of_imag, of_both = row
                covariance = np.array([[of_real, of_both], [of_both, of_imag]])
                outline = ellipse_outline(complex(real, imag), covariance)
                axes.fill(*outline, facecolor=colour, alpha=0.3, edgecolor=colour)
    if curve.kind == "stems":
        _stems(axes, curve, rows, x, y, bins)
    elif curve.kind == "points" and panel.scale == "phase":
        axes.plot(*unwrapped_gaps(x, y), color=colour, linewidth=1.0, label=label)
    elif curve.kind == "points":
        _points(axes, curve, rows, x, y)
    elif curve.kind == "steps":
        axes.step(x, y, where="post", color=colour, linewidth=1.4, marker="o", label=label)
    else:
        if not curve.marker and panel.plane != "complex":
            kept = style.extremes(y, bins)
            x, y = x[kept], y[kept]
        axes.plot(
            *(x, y),
            color=colour,
            linestyle=DASHED if curve.dashed else "-",
            linewidth=0.8 if curve.colour == "muted" else 1.2,
            marker=curve.marker or None,
            markersize=3.5,
            label=label,
        )


def _band(axes: Axes, panel: Panel, curve: Curve, rows: pd.DataFrame, bins: int) -> None:
    lower, upper = (curve.factor * rows[name].to_numpy(dtype=float) for name in curve.band)
    kept = np.unique(np.concatenate([style.extremes(bound, bins) for bound in (lower, upper)]))
    x = rows[panel.x].to_numpy(dtype=float)[kept]
    if panel.scale == "logarithmic":
        positive = rows[curve.column][rows[curve.column] > 0]
        lower = np.maximum(lower, 1e-3 * float(positive.min()) if len(positive) else 0.0)
    axes.fill_between(
        *(x, lower[kept], upper[kept]), color=style.COLOURS[curve.colour], alpha=0.25, linewidth=0
    )


def _stems(
    axes: Axes, curve: Curve, rows: pd.DataFrame, x: np.ndarray, y: np.ndarray, bins: int
) -> None:
    """Lines from zero; those beyond their bounds in the colour of errors."""
    width = max(0.35, min(1.4, 300.0 / max(len(x), 1)))
    outside = np.zeros(len(x), dtype=bool)
    if curve.bounds:
        outside = np.abs(y) > rows[curve.bounds].to_numpy(dtype=float)
    inside = np.flatnonzero(~outside)
    inside = inside[style.extremes(y[inside], 4 * bins)]
    for at, colour, label in ((inside, style.INK, "inside"), (outside, style.ERROR, "outside")):
        axes.plot(*style.stems(x[at], y[at]), color=colour, linewidth=width, label=label)
    axes.plot(x[outside], y[outside], ".", color=style.ERROR, markersize=3)


def _points(axes: Axes, curve: Curve, rows: pd.DataFrame, x: np.ndarray, y: np.ndarray) -> None:
    colour, open_ = style.COLOURS[curve.colour], curve.marker.startswith("open")
    marker = curve.marker.removeprefix("open") or "o"
    if curve.errors:
        along, across = (
            np.where(np.isfinite(errors), NORMAL_95 * errors, 0.0)
            for errors in (rows[name].to_numpy(dtype=float) for name in curve.errors)
        )
        # A logarithmic axis ends above zero.
        low = np.minimum(across, 0.9 * np.abs(y))
        bars = np.vstack([low, across]), along
        axes.errorbar(x, y, *bars, fmt="none", ecolor=colour, elinewidth=0.9, capsize=2.0)
    axes.plot(
        *(x, y, marker),
        color=colour,
        markerfacecolor="none" if open_ else colour,
        markersize={".": 2.5, "s": 8.0 if open_ else 4.5}.get(marker, 5.0),
        label=curve.label or "_",
    )
    if curve.names:
        for name, across_, up in zip(rows[curve.names], x, y, strict=True):
            if isinstance(name, str) and name:
                label = axes.annotate(name, (across_, up), (0, 7), textcoords="offset points")
                label.set(ha="center", fontsize=8, color=style.INK, bbox=style.LABEL_BOX)


def _plane(axes: Axes, panel: Panel) -> None:
    """One scale for both axes; the unit circle with its frequencies."""
    axes.set_aspect("equal")
    for line in (axes.axhline, axes.axvline):
        line(0, color=style.MUTED, linewidth=0.5)
    if panel.plane != "z":
        return
    angle = np.linspace(0, 2 * math.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color=style.INK, linewidth=0.8)
    for fraction in (0.1, 0.2, 0.3, 0.4, 0.5):
        across, up = math.cos(2 * math.pi * fraction), math.sin(2 * math.pi * fraction)
        axes.plot([across, 1.04 * across], [up, 1.04 * up], color=style.INK, linewidth=0.8)
        place = 1.15 * across, 1.15 * up + (0.08 if fraction == 0.5 else 0.0)  # above the real axis
        label = f"{fraction * panel.rate:.4g}" + (" Hz" if fraction == 0.1 else "")
        axes.text(*place, label, ha="center", va="center", fontsize=7.5, color=style.MUTED)
    axes.grid(False)


def _scales(axes: Axes, panel: Panel) -> None:
    from matplotlib.ticker import MaxNLocator, NullLocator

    if panel.plane:
        reach = panel.limits or (-FRAME, FRAME)
        axes.set_xlim(*reach)
        axes.set_ylim(*reach)
        return
    axes.margins(x=0.01, y=0.08)
    if panel.scale == "phase":
        axes.set_ylim(-190, 190)
        axes.set_yticks([-180, -90, 0, 90, 180])
    elif panel.limits:
        axes.set_ylim(*panel.limits)
    if panel.scale == "logarithmic":
        style.logarithmic(axes)
    elif 0 < max(map(abs, axes.get_ylim())) < 1e-3:
        axes.yaxis.set_major_formatter(style.power_of_ten)
    if panel.counted:
        axes.yaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
    if panel.decades:
        ticks = np.unique(np.concatenate([line.get_xdata() for line in axes.get_lines()[-1:]]))
        axes.set_xscale("log")
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.xaxis.set_minor_locator(NullLocator())
    elif panel.whole:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))
    if panel.highest:
        axes.set_xlim(0, panel.highest)


def _legend(axes: Axes, panel: Panel, crowded: bool) -> None:
    """Above the panel, where it hides no data, in as many columns as the labels leave room for."""
    labels = axes.get_legend_handles_labels()[1]
    if len(labels) < 2 and not panel.title and not panel.curves[0].band and not panel.marks:
        return
    if crowded and panel.title:
        # On paper of its own: where curves fill the panel, no place is free of them.
        frame = {"frameon": True, "facecolor": style.PAPER, "edgecolor": "none"}
        axes.legend(loc="best", fontsize=7.5, **frame)
        return
    columns = max(1, min(4, 90 // max(map(len, labels), default=1)) // (1 + crowded))
    if panel.title:
        columns = min(columns, 3)
    legend = axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1
    )
    legend.get_frame().set_facecolor(style.PAPER)


def unwrapped_gaps(x: np.ndarray, degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wrap a phase to ±180° and break its line where it jumps from one end to the other."""
    wrapped = (degrees + 180.0) % 360.0 - 180.0
    jumps = np.flatnonzero(np.abs(np.diff(wrapped)) > 180.0) + 1
    return np.insert(x, jumps, x[jumps - 1]), np.insert(wrapped, jumps, np.nan)


SHAPE_WIDTH, SHAPE_HEIGHT, MARGIN = 300.0, 220.0, 16.0
FRAMES = 16
SECONDS = 2.0
AMPLITUDE = 0.15  # largest displacement, as a share of the size of the structure


class ShapeDrawing:
    """The shapes of one structure, drawn from one point of view."""

    def __init__(self, geometry: Geometry, output_names: tuple[str, ...]) -> None:
        self.names = list(geometry.points)
        self.rest = np.array([geometry.points[name] for name in self.names])
        index = {name: place for place, name in enumerate(self.names)}
        self.lines = [(index[start], index[end]) for start, end in geometry.lines]
        self.channels = [
            (
                output_names.index(name),
                index[channel.point],
                np.array(channel.direction) / np.linalg.norm(channel.direction),
            )
            for name, channel in geometry.channels.items()
        ]
        extent = np.ptp(self.rest, axis=0)
        self.size = float(np.linalg.norm(extent)) or 1.0
        directions = np.array([direction for _, _, direction in self.channels])
        flat = (extent < 1e-9 * self.size) & np.all(np.abs(directions) < 1e-9, axis=0)
        self.view = _view(flat)
        reach = self.rest[:, None, :] + AMPLITUDE * self.size * np.array(
            [[0, 0, 0], *np.eye(3), *-np.eye(3)]
        )
        flattened = reach.reshape(-1, 3) @ self.view
        self.low = flattened.min(axis=0)
        span = np.maximum(np.ptp(flattened, axis=0), 1e-9 * self.size)
        room = np.array([SHAPE_WIDTH, SHAPE_HEIGHT]) - 2 * MARGIN
        self.scale = float(np.min(room / span))
        self.offset = MARGIN + (room - span * self.scale) / 2
        self.top = float(span[1] * self.scale)

    def drawn(self, shape: Complex, label: str, moving: bool = False) -> str:
        """The structure at rest and at both extremes of a shape (ny,), or moving through it.

        The largest entry of the shape is 1; its real part is turned to be as large as it can be.
        """
        turned = shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))
        steps = np.exp(2j * np.pi * np.arange(FRAMES + 1) / FRAMES)
        places = [self._flat((turned * step).real) for step in steps]
        frames = [self._outline(flat) for flat in places]
        content = f'<path class="rest" d="{self._outline(self._flat(0 * shape.real))}"/>'
        front = f'<path class="front" d="{frames[0]}"'
        if moving:
            content += (
                f'{front}><animate attributeName="d" dur="{SECONDS:g}s" repeatCount="indefinite"'
                f' values="{";".join(frames)}"/></path>'
            )
        else:
            content += f'<path class="back" d="{frames[FRAMES // 2]}"/>{front}/>'
            for point in sorted({point for _, point, _ in self.channels}):
                x, y = places[0][point]
                content += f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="2.6">'
                content += f"<title>{escape(self.names[point])}</title></circle>"
        return (
            f'<svg class="shape" viewBox="0 0 {SHAPE_WIDTH:g} {SHAPE_HEIGHT:g}" role="img"'
            f' aria-label="{escape(label, quote=True)}">{content}</svg>'
        )

    def _flat(self, entries: Array) -> Array:
        """Points displaced in the directions of their channels, as they are drawn (points, 2)."""
        moved = self.rest.copy()
        for output, point, direction in self.channels:
            moved[point] += AMPLITUDE * self.size * entries[output] * direction
        flat = (moved @ self.view - self.low) * self.scale
        return np.asarray(np.column_stack([flat[:, 0], self.top - flat[:, 1]]) + self.offset)

    def _outline(self, flat: Array) -> str:
        words = [f"{x:.1f} {y:.1f}" for x, y in flat]
        if not self.lines:
            return "".join(f"M{word}h.1" for word in words)
        return "".join(f"M{words[start]}L{words[end]}" for start, end in self.lines)


def _view(flat: Flags) -> Array:
    """Projection to two dimensions, (3, 2): onto a plane that holds all, else from a corner."""
    if flat.any():
        return np.eye(3)[:, [axis for axis in range(3) if axis != int(np.flatnonzero(flat)[-1])]]
    across, down = np.cos(np.radians(30.0)), -np.sin(np.radians(30.0))
    return np.array([[across, down], [-across, down], [0.0, 1.0]])
