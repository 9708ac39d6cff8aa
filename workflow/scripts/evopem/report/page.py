"""The report of one data set as an HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from evopem.figures.view import Results, view_of
from evopem.report import provenance, sentences
from evopem.report.figures import drawn_figures
from evopem.report.sections import SECTIONS
from evopem.report.templates import environment

PHASES = ("estimate_candidates", "select_candidate")


def read_wall_clock(directory: Path) -> dict[str, float]:
    """Seconds that each stage took: the times of its jobs, summed.

    The files are ``<stage>.tsv`` and ``<stage>/<wildcards>.tsv``; a phase of the search counts
    under its name. A missing or empty one is ignored, because times are not results.
    """
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
    drawings: Mapping[str, str],
    wall_clock: Mapping[str, float],
    config_text: str,
    template_directory: Path,
    commit: str = "unknown",
) -> str:
    """One HTML page that loads no other file; `drawings`: SVG texts by name; times in seconds."""
    view = view_of(results)
    page = environment(template_directory).get_template(
        "report.html.j2", globals=sentences.IN_TEMPLATES
    )
    return page.render(
        view=view,
        results=results,
        sections=[
            {
                "id": section.id,
                "title": section.title(view),
                "template": f"section_{section.id if section.content else 'figures'}.html.j2",
                "content": section.content(view) if section.content else {},
                "figures": drawn_figures(view, drawings, section.id),
            }
            for section in SECTIONS
            if section.applies(view)
        ],
        stages=provenance.stages(view, wall_clock),
        versions=provenance.listed(provenance.installed(provenance.REPORT_LIBRARIES)),
        command=provenance.command(commit),
        commit=commit,
        config_text=config_text,
    )
