"""The responses of the model: over frequency, over time, in the complex plane."""

from __future__ import annotations

from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, object]:
    return {"figures": material.figures_of("response")}


SECTION = Section(
    "response",
    lambda view: "Response to the input" if view.has_input else "Noise filter",
    _content,
)
