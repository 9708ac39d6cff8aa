"""The errors of prediction and simulation, of every output and of every recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from evopem.figures.view import ChannelsView, OutputErrors, View
from evopem.report.recording_table import recording_rows
from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, Any]:
    view = material.view
    several = isinstance(view, ChannelsView)
    return {
        "figures": material.figures_of("errors"),
        "outputs": _worst_first(view) if several else None,
        "recordings": recording_rows(view.results) if several else [],
    }


def _worst_first(view: View) -> list[OutputErrors]:
    """The outputs by decreasing error, unknown errors before all others."""

    def error(each: OutputErrors) -> float:
        value = each.simulation if view.has_input else each.prediction
        return value if np.isfinite(value) else np.inf

    return sorted(view.errors, key=error, reverse=True)


SECTION = Section(
    "errors",
    lambda view: "Prediction and simulation" if view.has_input else "Prediction",
    _content,
)
