"""The recording: its signals, as recorded and as used, and the spectra of the outputs."""

from __future__ import annotations

from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, object]:
    return {"figures": material.figures_of("recording")}


SECTION = Section("recording", lambda _: "Recording", _content)
