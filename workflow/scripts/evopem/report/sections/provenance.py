"""What is needed to repeat the run, and how long it took."""

from __future__ import annotations

from typing import Any

from evopem.report import provenance
from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, Any]:
    return {
        "terms": provenance.terms(material.view, material.commit),
        "stages": provenance.stages(material.view, material.wall_clock),
        "command": provenance.command(material.commit),
        "config_text": material.config_text,
    }


SECTION = Section("provenance", lambda _: "Provenance", _content)
