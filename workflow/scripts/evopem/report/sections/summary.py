"""The verdict, the first figures, the modes that can be trusted, and the checks."""

from __future__ import annotations

from typing import Any

from evopem.report.section import Material, Section
from evopem.report.sentences.about_modes import mode_lines
from evopem.report.sentences.about_verdict import verdict
from evopem.validation.checks import failed_checks


def _content(material: Material) -> dict[str, Any]:
    view = material.view
    checks = view.checks
    return {
        "verdict": verdict(view),
        "evidence": mode_lines(view),
        "figures": material.figures_of("summary"),
        "failed": failed_checks(checks),
        "remarks": [check for check in checks if check.word in ("Caution", "Note")],
        "passed": [check for check in checks if check.passed is True],
        "not_judged": [check for check in checks if check.passed is None],
    }


SECTION = Section("summary", lambda _: "Verdict", _content)
