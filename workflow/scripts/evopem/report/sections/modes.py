"""The modes beside the truth, their shapes and how alike these are, poles, and stabilisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures.shapes import ShapeDrawing, assurance_matrix, shape_bars
from evopem.figures.view import ChannelsView, PolynomialView
from evopem.models.modes import Mode
from evopem.report import chapter
from evopem.report.mode_table import mode_rows
from evopem.report.numbers import hertz, number
from evopem.report.section import Material, Section
from evopem.report.sentences.about_model import modes as mode_remarks
from evopem.report.sentences.about_modes import ModeLine, mode_lines


@dataclass(frozen=True)
class ShapeRow:
    """A mode of a model of several outputs, with its shape."""

    line: ModeLine
    bars: Markup
    still: Markup | None  # over the geometry, where there is one
    moving: Markup | None

    @property
    def mode(self) -> Mode:
        """The mode itself."""
        return self.line.mode


def _content(material: Material) -> dict[str, Any]:
    view, figures = material.view, material.figures_of("modes")
    if isinstance(view, ChannelsView):
        rows = _shape_rows(view)
        return {
            "figures": figures,
            "shapes": rows,
            "has_shapes": len(view.outputs) > 1,
            "geometry": view.results.settings.geometry is not None,
            "assurance": _assurance(view) if len(rows) > 1 and len(view.outputs) > 1 else None,
        }
    assert isinstance(view, PolynomialView)
    stand_in = chapter.stands_in_for_the_chapter(view.results.settings)
    true_modes = view.truth.modes if view.truth else ()
    table = mode_rows(view.results.model.modes, true_modes, chapter.MODES if stand_in else ())
    return {
        "figures": figures,
        "shapes": None,
        "rows": table,
        "remarks": mode_remarks(view.results, table),
        "has_truth": bool(true_modes),
        "chapter_orders": chapter.ORDERS if stand_in else None,
    }


def _shape_rows(view: ChannelsView) -> list[ShapeRow]:
    geometry = view.results.settings.geometry
    outputs = tuple(each.name for each in view.outputs)
    drawing = None if geometry is None else ShapeDrawing(geometry, outputs)
    rows = []
    for place, line in enumerate(mode_lines(view), 1):
        mode = line.mode
        label = f"Shape of mode {place} at {hertz(mode.frequency_hz)}"
        rows.append(
            ShapeRow(
                line,
                Markup(shape_bars(outputs, mode.shape, mode.shape_se_real, label)),
                Markup(drawing.still(mode.shape, label)) if drawing else None,
                Markup(drawing.moving(mode.shape, f"{label}, moving")) if drawing else None,
            )
        )
    return rows


def _assurance(view: ChannelsView) -> Markup:
    names = [f"{k}: {number(mode.frequency_hz, 3)}" for k, mode in enumerate(view.modes, 1)]
    label = "Modal assurance criterion of all pairs of modes"
    return Markup(assurance_matrix(view.results.modes.assurance, names, label))


SECTION = Section(
    "modes",
    lambda view: "Modes beside the truth" if view.truth and view.truth.modes else "Modes",
    _content,
)
