"""The parts of the report: when each applies, what it is called, and what it shows.

The template ``section_<id>.html.j2`` of a part sets its content; parts of figures alone share one.
"""

from __future__ import annotations

from typing import Any

from evopem.report import chapter, provenance
from evopem.report.section import Material, Section
from evopem.report.sections import errors, model, modes, selection
from evopem.report.sentences.about_modes import mode_lines
from evopem.report.sentences.about_verdict import verdict
from evopem.validation.checks import failed_checks


def _summary(material: Material) -> dict[str, Any]:
    checks = material.view.checks
    return {
        "verdict": verdict(material.view),
        "evidence": mode_lines(material.view),
        "figures": material.figures_of("summary"),
        "failed": failed_checks(checks),
        "remarks": [check for check in checks if check.word in ("Caution", "Note")],
        "passed": [check for check in checks if check.passed is True],
        "not_judged": [check for check in checks if check.passed is None],
    }


def _provenance(material: Material) -> dict[str, Any]:
    return {
        "terms": provenance.terms(material.view, material.commit),
        "stages": provenance.stages(material.view, material.wall_clock),
        "command": provenance.command(material.commit),
        "config_text": material.config_text,
    }


SECTIONS = (
    Section("summary", lambda _: "Verdict", _summary),
    model.SECTION,
    modes.SECTION,
    Section("response", lambda view: "Response to the input" if view.has_input else "Noise filter"),
    errors.SECTION,
    Section("residual_tests", lambda _: "Residuals"),
    Section("recording", lambda _: "Recording"),
    selection.SECTION,
    Section(
        "chapter",
        lambda _: "Comparison with the chapter",
        lambda material: {"rows": chapter.compare_with_chapter(material.view.results)},
        lambda view: chapter.stands_in_for_the_chapter(view.results.settings),
    ),
    Section("provenance", lambda _: "Provenance", _provenance),
)
"""The parts in the order of the page."""
