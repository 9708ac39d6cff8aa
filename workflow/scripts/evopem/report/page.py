"""The report of one data set as an HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from evopem.figures.view import Results, view_of
from evopem.report.section import Material
from evopem.report.sections import SECTIONS
from evopem.report.templates import environment

PHASES = ("estimate_candidates", "select_candidate")


def read_wall_clock(directory: Path) -> dict[str, float]:
    """Seconds that each stage took: the times of its jobs, summed.

    The files are ``<stage>.tsv`` and ``<stage>/<wildcards>.tsv``; a phase of the search counts
    under its name. A missing or empty one is ignored, because times are not results."""
    seconds: dict[str, float] = {}
    for path in sorted(directory.rglob("*.tsv")):
        parts = path.relative_to(directory).with_suffix("").parts
        stage = parts[1] if parts[0] in PHASES else parts[0]
        try:
            taken = float(pd.read_csv(path, sep="\t")["s"].mean())
        except (OSError, ValueError, KeyError):
            continue
        seconds[stage] = seconds.get(stage, 0.0) + taken
    return seconds


def build_report(
    results: Results,
    figures: Mapping[str, str],
    wall_clock: Mapping[str, float],
    config_text: str,
    template_directory: Path,
    commit: str = "unknown",
) -> str:
    """One HTML page that loads no other file; `figures` are SVG texts by name, times in seconds."""
    view = view_of(results)
    material = Material(view, figures, wall_clock, config_text, commit)
    sections = [section.of(material) for section in SECTIONS if section.applies(view)]
    page = environment(template_directory).get_template("report.html.j2")
    return page.render(view=view, results=results, sections=sections)
