"""The modes beside the truth, their shapes and how alike these are, poles, and stabilisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures.shapes import ShapeDrawing, assurance_matrix, shape_bars
from evopem.figures.view import View
from evopem.models.mode_shapes import assurance
from evopem.report import chapter
from evopem.report.mode_table import mode_rows
from evopem.report.numbers import hertz, number
from evopem.report.section import Material, Section
from evopem.report.sentences.about_model import modes as mode_remarks
from evopem.report.sentences.about_modes import mode_lines


@dataclass(frozen=True)
class ShapeDrawings:
    """The shape of a mode over several outputs, as SVG."""

    caption: str
    bars: Markup
    still: Markup | None  # over the geometry, where there is one
    moving: Markup | None


def _content(material: Material) -> dict[str, Any]:
    view = material.view
    stand_in = chapter.stands_in_for_the_chapter(view.results.settings)
    true_modes = view.truth.modes if view.truth else ()
    rows = mode_rows(view.modes, true_modes, chapter.MODES if stand_in else ())
    return {
        "figures": material.figures_of("modes"),
        "rows": rows,
        "lines": {line.mode.pole: line for line in mode_lines(view)},
        "shapes": _shapes(view) if len(view.outputs) > 1 else [],
        "geometry": view.results.settings.geometry is not None,
        "assurance": _assurance(view) if len(view.modes) > 1 and len(view.outputs) > 1 else None,
        "remarks": mode_remarks(view, rows),
        "has_truth": bool(true_modes),
        "chapter_orders": chapter.ORDERS if stand_in else None,
    }


def _shapes(view: View) -> list[ShapeDrawings]:
    geometry = view.results.settings.geometry
    outputs = tuple(each.name for each in view.outputs)
    drawing = None if geometry is None else ShapeDrawing(geometry, outputs)
    drawn = []
    for place, mode in enumerate(view.modes, 1):
        label = f"Shape of mode {place} at {hertz(mode.frequency_hz)}"
        drawn.append(
            ShapeDrawings(
                hertz(mode.frequency_hz),
                Markup(shape_bars(outputs, mode.shape, mode.shape_se_real, label)),
                Markup(drawing.still(mode.shape, label)) if drawing else None,
                Markup(drawing.moving(mode.shape, f"{label}, moving")) if drawing else None,
            )
        )
    return drawn


def _assurance(view: View) -> Markup:
    shapes = [mode.shape for mode in view.modes]
    matrix = [[assurance(one, other) for other in shapes] for one in shapes]
    names = [f"{k}: {number(mode.frequency_hz, 3)}" for k, mode in enumerate(view.modes, 1)]
    label = "Modal assurance criterion of all pairs of modes"
    return Markup(assurance_matrix(matrix, names, label))


SECTION = Section(
    "modes",
    lambda view: "Modes beside the truth" if view.truth and view.truth.modes else "Modes",
    _content,
)
