"""What is left in the residuals: correlations and spectra."""

from __future__ import annotations

from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, object]:
    return {"figures": material.figures_of("residual_tests")}


SECTION = Section("residual_tests", lambda _: "Residuals", _content)
