"""Small drawings of many channels as SVG text, in the colours of the page that they stand in.

Dozens of panels stand side by side in a page, so that each is written as few paths, without fonts
of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PANEL_WIDTH, PANEL_HEIGHT = 300.0, 96.0
# Of a panel that has the page's width for itself, so that its numbers keep their size.
WIDE_PANEL = 640.0
LEFT, BOTTOM, TOP, RIGHT = 44.0, 16.0, 4.0, 4.0


def _svg(width: float, height: float, label: str, content: str, kind: str) -> str:
    return (
        f'<svg class="{kind}" viewBox="0 0 {width:g} {height:g}" role="img"'
        f' aria-label="{escape(label, quote=True)}">{content}</svg>'
    )


def _short(value: float) -> str:
    """A number of a drawing, to a tenth of a unit."""
    return f"{value:.1f}".removesuffix(".0")


def _path(xs: Array, ys: Array) -> str:
    """A polyline; it breaks where a value is not finite."""
    parts, pen = [], False
    for x, y in zip(xs, ys, strict=True):
        if not math.isfinite(y):
            pen = False
            continue
        parts.append(f"{'L' if pen else 'M'}{_short(x)} {_short(y)}")
        pen = True
    return "".join(parts)


def _tick(value: float) -> str:
    text = f"{value:.3g}"
    return text.replace("e-0", "e-").replace("e+0", "e").replace("-", "−")


def _ends(low: float, high: float) -> tuple[float, float]:
    """A range that is not empty."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return 0.0, 1.0
    if high > low:
        return low, high
    size = abs(low) or 1.0
    return low - size, high + size


def series_panel(
    times: Array,
    series: Sequence[tuple[str, Array]],
    unit: str,
    label: str,
    width: float = PANEL_WIDTH,
) -> str:
    """Signals over time.

    Parameters
    ----------
    times : (N,) array
        Seconds.
    series : sequence of (class, (N,) array)
        Each with the CSS class of its line.
    unit : str
        Of time.
    label : str
        Description for screen readers.
    width : float
    """
    first = series[0][1]
    finite = np.concatenate([values[np.isfinite(values)] for _, values in series])
    # A simulation that leaves the range of the measured samples is cut at twice that range.
    top, bottom = np.nanmax(first), np.nanmin(first)
    middle, half = (top + bottom) / 2, (top - bottom) or 1.0
    low = max(float(np.min(finite)), float(middle - half))
    high = min(float(np.max(finite)), float(middle + half))
    low, high = _ends(low, high)
    scale_x = (width - LEFT - RIGHT) / max(float(times[-1] - times[0]), 1e-300)
    scale_y = (PANEL_HEIGHT - TOP - BOTTOM) / (high - low)
    xs = LEFT + (times - times[0]) * scale_x
    lines = "".join(
        f'<path class="{kind}" d="'
        f'{_path(xs, TOP + (high - np.clip(values, low, high)) * scale_y)}"/>'
        for kind, values in series
    )
    axis = _frame(
        (_tick(low), _tick(high)),
        (f"{_tick(float(times[0]))}", f"{_tick(float(times[-1]))} {unit}"),
        width,
    )
    return _svg(width, PANEL_HEIGHT, label, axis + lines, "panel")


def response_panel(
    frequencies: Array,
    gain: Array,
    band: tuple[Array, Array],
    measured: Array,
    limits: tuple[float, float],
    label: str,
) -> str:
    """Gain of one pair of output and input over frequency, in decibels.

    Parameters
    ----------
    frequencies : (m,) array
        Hz.
    gain : (m,) array
    band : pair of (m,) arrays
        Ends of its 95 % interval.
    measured : (m,) array
        Empirical gain.
    limits : (low, high)
        Of the axis, in decibels.
    label : str
    """
    low, high = limits
    span = (PANEL_WIDTH - LEFT - RIGHT) / max(float(frequencies[-1] - frequencies[0]), 1e-300)
    xs = LEFT + (frequencies - frequencies[0]) * span
    scale = (PANEL_HEIGHT - TOP - BOTTOM) / (high - low)

    def heights(values: Array) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            decibels = 20.0 * np.log10(values)
        found: Array = TOP + (high - np.clip(decibels, low, high)) * scale
        return found

    lower, upper = heights(band[0]), heights(band[1])
    known = np.isfinite(lower) & np.isfinite(upper)
    outline = ""
    if known.any():
        around = np.concatenate([xs[known], xs[known][::-1]])
        edge = np.concatenate([upper[known], lower[known][::-1]])
        outline = f'<path class="band" d="{_path(around, edge)}Z"/>'
    axis = _frame(
        (f"{low:.0f}".replace("-", "−"), f"{high:.0f} dB".replace("-", "−")),
        (_tick(float(frequencies[0])), f"{_tick(float(frequencies[-1]))} Hz"),
    )
    lines = f'<path class="measured" d="{_path(xs, heights(measured))}"/>'
    lines += f'<path class="model" d="{_path(xs, heights(gain))}"/>'
    return _svg(PANEL_WIDTH, PANEL_HEIGHT, label, axis + outline + lines, "panel")


def _frame(y: tuple[str, str], x: tuple[str, str], width: float = PANEL_WIDTH) -> str:
    """Axes with the numbers at their ends."""
    right, floor = width - RIGHT, PANEL_HEIGHT - BOTTOM
    return (
        f'<path class="axis" d="M{LEFT:g} {TOP:g}V{floor:g}H{right:g}"/>'
        f'<text x="{LEFT - 4:g}" y="{floor:g}" text-anchor="end">{y[0]}</text>'
        f'<text x="{LEFT - 4:g}" y="{TOP + 8:g}" text-anchor="end">{y[1]}</text>'
        f'<text x="{LEFT:g}" y="{PANEL_HEIGHT - 3:g}">{x[0]}</text>'
        f'<text x="{right:g}" y="{PANEL_HEIGHT - 3:g}" text-anchor="end">{x[1]}</text>'
    )


ROW = 15.0
NAME_WIDTH, BAR_WIDTH = 96.0, 190.0


def shape_bars(
    names: Sequence[str], shape: NDArray[np.complex128], errors: Array, label: str
) -> str:
    """The entries of a shape: real parts as bars with 95 % intervals, imaginary parts as marks.

    Parameters
    ----------
    names : sequence of str
    shape : (ny,) complex array
        Its largest entry is 1.
    errors : (ny,) array
        Standard errors of the real parts.
    label : str
    """
    middle = NAME_WIDTH + BAR_WIDTH / 2
    half = BAR_WIDTH / 2 - 6
    height = ROW * len(names) + 16
    parts = [f'<path class="axis" d="M{middle:g} 0V{height - 16:g}"/>']
    for row, (name, entry, error) in enumerate(zip(names, shape, errors, strict=True)):
        y = ROW * (row + 0.5)
        shown = name if len(name) <= 14 else f"{name[:13]}…"
        parts.append(
            f'<text x="{NAME_WIDTH - 6:g}" y="{y + 3.5:g}" text-anchor="end">{escape(shown)}</text>'
        )
        end = middle + half * float(np.clip(entry.real, -1.0, 1.0))
        parts.append(f'<path class="bar" d="M{middle:g} {y:g}H{_short(end)}"/>')
        if math.isfinite(error) and error > 0.0:
            reach = half * min(1.96 * float(error), 1.0)
            parts.append(
                f'<path class="error" d="M{_short(end - reach)} {y:g}h{_short(2 * reach)}"/>'
            )
        imaginary = middle + half * float(np.clip(entry.imag, -1.0, 1.0))
        parts.append(f'<circle class="imaginary" cx="{_short(imaginary)}" cy="{y:g}" r="2.6"/>')
    foot = height - 3
    for x, text in ((middle - half, "−1"), (middle, "0"), (middle + half, "1")):
        parts.append(f'<text x="{x:g}" y="{foot:g}" text-anchor="middle">{text}</text>')
    width = NAME_WIDTH + BAR_WIDTH
    return _svg(width, height, label, "".join(parts), "bars")


CELL, HEAD = 34.0, 58.0


def assurance_matrix(assurance: Sequence[Sequence[float]], names: Sequence[str], label: str) -> str:
    """Modal assurance criterion of all pairs of shapes, as shades with their values.

    Parameters
    ----------
    assurance : square matrix
    names : sequence of str
        Of the modes, short.
    label : str
    """
    width, height = HEAD + CELL * len(names), 24 + CELL * len(names)
    parts = []
    for row, (name, values) in enumerate(zip(names, assurance, strict=True)):
        y = 20 + CELL * row
        parts.append(
            f'<text x="{HEAD - 6:g}" y="{y + CELL / 2 + 4:g}" text-anchor="end">'
            f"{escape(name)}</text>"
            f'<text x="{HEAD + CELL * (row + 0.5):g}" y="14" text-anchor="middle">{row + 1}</text>'
        )
        for column, value in enumerate(values):
            known = value if math.isfinite(value) else 0.0
            x = HEAD + CELL * column
            text = f"{value:.2f}" if math.isfinite(value) else "–"
            parts.append(
                f'<rect class="cell" x="{x + 0.5:g}" y="{y + 0.5:g}" width="{CELL - 1:g}"'
                f' height="{CELL - 1:g}" fill-opacity="{0.06 + 0.74 * known:.2f}"/>'
                f'<text class="{"strong" if known > 0.55 else ""}" x="{x + CELL / 2:g}"'
                f' y="{y + CELL / 2 + 4:g}" text-anchor="middle">{text}</text>'
            )
    drawn = _svg(width, height, label, "".join(parts), "assurance")
    # In its own size: a matrix of few modes would fill the page.
    return drawn.replace("<svg ", f'<svg width="{width:g}" ', 1)


CHART_WIDTH, CHART_HEIGHT = 420.0, 200.0


def scores_chart(
    curves: Sequence[tuple[str, Sequence[int], Sequence[float]]],
    chosen: tuple[int, float],
    label: str,
) -> str:
    """Errors over the order, one line for each variant, with a mark at the choice.

    Parameters
    ----------
    curves : sequence of (class, orders, errors)
    chosen : (order, error)
    label : str
    """
    orders = [order for _, tried, _ in curves for order in tried]
    errors = [error for _, _, found in curves for error in found if math.isfinite(error)]
    low, high = _ends(0.0, min(max(errors, default=1.0), 4.0 * min(errors, default=1.0)))
    left, right = _ends(float(min(orders)), float(max(orders)))
    floor, width = CHART_HEIGHT - 26, CHART_WIDTH - LEFT - 10

    def place(order: float, error: float) -> tuple[float, float]:
        x = LEFT + width * (order - left) / (right - left)
        return x, 8 + (floor - 8) * (high - min(error, high)) / (high - low)

    parts = [f'<path class="axis" d="M{LEFT:g} 8V{floor:g}H{CHART_WIDTH - 10:g}"/>']
    for share in (0.0, 0.5, 1.0):
        y = place(left, low + share * (high - low))[1]
        text = _tick(low + share * (high - low))
        parts.append(f'<text x="{LEFT - 5:g}" y="{y + 4:g}" text-anchor="end">{text}</text>')
    step = max(1, math.ceil(len(set(orders)) / 10))
    for order in sorted(set(orders))[::step]:
        x = place(order, low)[0]
        parts.append(
            f'<text x="{_short(x)}" y="{floor + 15:g}" text-anchor="middle">{order}</text>'
        )
    for kind, tried, found in curves:
        points = [
            place(o, e) if math.isfinite(e) else (0.0, math.nan)
            for o, e in zip(tried, found, strict=True)
        ]
        xs, ys = np.array([p[0] for p in points]), np.array([p[1] for p in points])
        parts.append(f'<path class="{kind}" d="{_path(xs, ys)}"/>')
        parts += [
            f'<circle class="{kind}" cx="{_short(x)}" cy="{_short(y)}" r="2.5"/>'
            for x, y in points
            if math.isfinite(y)
        ]
    if math.isfinite(chosen[1]):
        x, y = place(*chosen)
        parts.append(f'<circle class="choice" cx="{_short(x)}" cy="{_short(y)}" r="6.5"/>')
    return _svg(CHART_WIDTH, CHART_HEIGHT, label, "".join(parts), "scores")
