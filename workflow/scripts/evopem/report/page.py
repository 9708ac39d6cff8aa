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

    A missing or empty benchmark file is ignored, because times are not results.

    Parameters
    ----------
    directory : Path
        Folder of the benchmark files ``<stage>.tsv`` and ``<stage>/<wildcards>.tsv``. The times of
        the stages that search a phase count under its name.
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
    figures: Mapping[str, str],
    wall_clock: Mapping[str, float],
    config_text: str,
    template_directory: Path,
    commit: str = "unknown",
) -> str:
    """Build the report of one data set, of whatever channels.

    Parameters
    ----------
    results : results of a data set
    figures : mapping of str to str
        SVG texts by the names of the figures.
    wall_clock : mapping of str to float
        Seconds by stage, as :func:`.wall_clock.read_wall_clock` returns them.
    config_text : str
        The complete configuration of the data set.
    template_directory : Path
        Folder of ``report.html.j2`` and what it includes.
    commit : str
        Commit of the workflow that writes the report.

    Returns
    -------
    str
        One HTML page that loads no other file.
    """
    view = view_of(results)
    material = Material(view, figures, wall_clock, config_text, commit)
    sections = [
        {
            "id": section.id,
            "title": section.title(view),
            "template": section.template,
            "content": section.content(material),
        }
        for section in SECTIONS
        if section.applies(view)
    ]
    page = environment(template_directory).get_template("report.html.j2")
    return page.render(view=view, results=results, sections=sections)
