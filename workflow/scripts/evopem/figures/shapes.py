"""Mode shapes as SVG text: entries, assurance criterion, and over a geometry, still and moving."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from evopem.config.channels import Geometry

Array = NDArray[np.float64]

WIDTH, HEIGHT, MARGIN = 300.0, 220.0, 16.0
FRAMES = 16
SECONDS = 2.0
# Largest displacement, as a share of the size of the structure.
AMPLITUDE = 0.15


class ShapeDrawing:
    """The shapes of one structure, drawn from one point of view."""

    def __init__(self, geometry: Geometry, output_names: tuple[str, ...]) -> None:
        self.names = list(geometry.points)
        self.rest = np.array([geometry.points[name] for name in self.names])
        index = {name: place for place, name in enumerate(self.names)}
        self.lines = [(index[one], index[other]) for one, other in geometry.lines]
        self.channels = [
            (output_names.index(name), index[each.point], _unit(np.array(each.direction)))
            for name, each in geometry.channels.items()
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
        room = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
        self.scale = float(np.min(room / span))
        self.offset = np.array([MARGIN, MARGIN]) + (room - span * self.scale) / 2
        self.top = float(span[1] * self.scale)

    def still(self, shape: NDArray[np.complex128], label: str) -> str:
        """The structure at rest and at both extremes of a shape (ny,) whose largest entry is 1."""
        content = f'<path class="rest" d="{self._outline(self.rest)}"/>'
        content += f'<path class="back" d="{self._outline(self._moved(-_in_phase(shape).real))}"/>'
        front = self._moved(_in_phase(shape).real)
        content += f'<path class="front" d="{self._outline(front)}"/>{self._dots(front)}'
        return _svg(WIDTH, HEIGHT, label, content, "shape")

    def moving(self, shape: NDArray[np.complex128], label: str) -> str:
        """The structure moving through a period of a shape, again and again."""
        turned = _in_phase(shape)
        frames = [
            self._outline(self._moved((turned * np.exp(2j * np.pi * k / FRAMES)).real))
            for k in range(FRAMES)
        ]
        frames.append(frames[0])
        content = f'<path class="rest" d="{self._outline(self.rest)}"/>'
        content += (
            f'<path class="front" d="{frames[0]}"><animate attributeName="d" dur="{SECONDS:g}s"'
            f' repeatCount="indefinite" values="{";".join(frames)}"/></path>'
        )
        return _svg(WIDTH, HEIGHT, label, content, "shape")

    def _moved(self, entries: Array) -> Array:
        """Points displaced in the directions of their channels, (points, 3)."""
        moved = self.rest.copy()
        for output, point, direction in self.channels:
            moved[point] += AMPLITUDE * self.size * entries[output] * direction
        return moved

    def _flat(self, points: Array) -> Array:
        flat = (points @ self.view - self.low) * self.scale
        placed: Array = np.column_stack([flat[:, 0], self.top - flat[:, 1]]) + self.offset
        return placed

    def _outline(self, points: Array) -> str:
        flat = self._flat(points)
        if not self.lines:
            return "".join(f"M{x:.1f} {y:.1f}h.1" for x, y in flat)
        return "".join(
            f"M{flat[one][0]:.1f} {flat[one][1]:.1f}L{flat[other][0]:.1f} {flat[other][1]:.1f}"
            for one, other in self.lines
        )

    def _dots(self, points: Array) -> str:
        flat = self._flat(points)
        measured = sorted({point for _, point, _ in self.channels})
        return "".join(
            f'<circle class="dot" cx="{flat[point][0]:.1f}" cy="{flat[point][1]:.1f}" r="2.6">'
            f"<title>{escape(self.names[point])}</title></circle>"
            for point in measured
        )


def _in_phase(shape: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """A shape turned so that its real part is as large as it can be."""
    turned: NDArray[np.complex128] = shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))
    return turned


def _unit(direction: Array) -> Array:
    unit: Array = direction / np.linalg.norm(direction)
    return unit


def _view(flat: NDArray[np.bool_]) -> Array:
    """Projection to two dimensions, (3, 2): onto a plane that holds all, else from a corner."""
    if flat.any():
        kept = [axis for axis in range(3) if axis != int(np.flatnonzero(flat)[-1])]
        return np.eye(3)[:, kept]
    slope = np.radians(30.0)
    return np.array(
        [
            [np.cos(slope), -np.sin(slope)],
            [-np.cos(slope), -np.sin(slope)],
            [0.0, 1.0],
        ]
    )


def _svg(width: float, height: float, label: str, content: str, kind: str) -> str:
    return (
        f'<svg class="{kind}" viewBox="0 0 {width:g} {height:g}" role="img"'
        f' aria-label="{escape(label, quote=True)}">{content}</svg>'
    )


def _short(value: float) -> str:
    """A number of a drawing, to a tenth of a unit."""
    return f"{value:.1f}".removesuffix(".0")


ROW = 15.0
NAME_WIDTH, BAR_WIDTH = 96.0, 190.0


def shape_bars(
    names: Sequence[str], shape: NDArray[np.complex128], errors: Array, label: str
) -> str:
    """The entries of a shape: real parts as bars with 95 % intervals, imaginary parts as marks.

    `shape`, complex (ny,), has a largest entry of 1; `errors` are of its real parts.
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
    """Modal assurance criterion of all pairs of shapes, as shades with their values."""
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
