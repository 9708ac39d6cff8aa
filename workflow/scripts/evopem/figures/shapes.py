"""Mode shapes over a geometry as SVG text, still and moving."""

from html import escape

import numpy as np

from evopem.arrays import Array, Complex, Flags
from evopem.config.channels import Geometry

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
        room = np.array([WIDTH, HEIGHT]) - 2 * MARGIN
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
            f'<svg class="shape" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img"'
            f' aria-label="{escape(label, quote=True)}">{content}</svg>'
        )

    def _flat(self, entries: Array) -> Array:
        """Points displaced in the directions of their channels, as they are drawn (points, 2)."""
        moved = self.rest.copy()
        for output, point, direction in self.channels:
            moved[point] += AMPLITUDE * self.size * entries[output] * direction
        flat = (moved @ self.view - self.low) * self.scale
        placed: Array = np.column_stack([flat[:, 0], self.top - flat[:, 1]]) + self.offset
        return placed

    def _outline(self, flat: Array) -> str:
        words = [f"{x:.1f} {y:.1f}" for x, y in flat]
        if not self.lines:
            return "".join(f"M{word}h.1" for word in words)
        return "".join(f"M{words[start]}L{words[end]}" for start, end in self.lines)


def _view(flat: Flags) -> Array:
    """Projection to two dimensions, (3, 2): onto a plane that holds all, else from a corner."""
    if flat.any():
        kept = [axis for axis in range(3) if axis != int(np.flatnonzero(flat)[-1])]
        return np.eye(3)[:, kept]
    across, down = np.cos(np.radians(30.0)), -np.sin(np.radians(30.0))
    return np.array([[across, down], [-across, down], [0.0, 1.0]])
