"""The report of one data set as an HTML page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pandas as pd

from evopem.figures.view import View, view_of
from evopem.report import sentences
from evopem.report.figures import drawn_figures
from evopem.report.sections import SECTIONS
from evopem.report.templates import environment
from evopem.results.dataset import DatasetResults

# They draw and write the page; the libraries behind the numbers are listed in the model.
REPORT_LIBRARIES = ("pandas", "matplotlib", "jinja2", "snakemake")
PHASE_STAGES = {
    "delay": "Delay search",
    "joint": "Search of the plant order",
    "nc": "Search of nc",
    "nd": "Search of nd",
    "na": "Search of na",
    "nb": "Search of nb",
    "structures": "Search of all structures",
    "chosen": "Search of the chosen model",
}
# The folder of times of a phase, where it has another name.
TIMES = {"structures": "search_structure", "chosen": "complete_model"}
# All stages where they ran as one job.
ONE_JOB = "identification"
BEFORE = ("read_recording", "prepare", "estimate_spectrum")
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
    results: DatasetResults,
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
        stages=stages(view, wall_clock),
        versions=listed(installed(REPORT_LIBRARIES)),
        command=command(commit),
        commit=commit,
        config_text=config_text,
    )


@dataclass(frozen=True)
class Stage:
    """Time and evaluations of one stage; None where they are not known or there are none."""

    name: str
    seconds: float | None
    candidates: int | None = None
    evaluations: int | None = None


def stages(view: View, wall_clock: Mapping[str, float]) -> list[Stage]:
    """Seconds of every stage from the start to the end of its jobs; the searches in their order."""
    left = dict(wall_clock)
    rows = [_stage(name, left.pop(name)) for name in BEFORE if name in left]
    if view.candidates is not None:
        for phase, tried in view.candidates.groupby("phase", sort=False):
            seconds = left.pop(TIMES.get(phase, phase), None)
            evaluations = int(tried["evaluations"].sum())
            rows.append(Stage(PHASE_STAGES.get(phase, phase), seconds, len(tried), evaluations))
    whole = left.pop(ONE_JOB, None)
    rows += [_stage(name, seconds) for name, seconds in left.items()]
    return rows if whole is None else [*rows, Stage("All stages, in one job", whole)]


def _stage(name: str, seconds: float) -> Stage:
    return Stage(name.replace("_", " ").capitalize(), seconds)


def command(commit: str) -> str:
    """The commands that repeat the run from its configuration."""
    run = "snakemake --snakefile PATH/Snakefile --directory . --cores all"
    digest = commit.split(",")[0]
    return run if digest == "unknown" else f"git -C PATH checkout {digest}\n{run}"


def installed(libraries: Iterable[str]) -> dict[str, str]:
    """Versions of those libraries that are installed."""
    found = {}
    for library in libraries:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            continue
    return found


def listed(versions: Mapping[str, object]) -> str:
    """Names and versions in a line."""
    return ", ".join(f"{name} {value}" for name, value in versions.items())
