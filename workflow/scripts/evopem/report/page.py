"""The report of one data set as an HTML page."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pandas as pd

from evopem.report.figures import drawn_figures
from evopem.report.page_sections import PHASE_NAMES, SECTIONS
from evopem.report.templates import Context, environment, template_folder
from evopem.results.dataset import DatasetResults
from evopem.results.layout import IDENTIFICATION

# They draw and write the page; the libraries behind the numbers are listed in the model.
REPORT_LIBRARIES = ("pandas", "matplotlib", "jinja2", "snakemake")
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
        with suppress(OSError, ValueError, KeyError):
            taken = float(pd.read_csv(path, sep="\t")["s"].mean())
            seconds[stage] = seconds.get(stage, 0.0) + taken
    return seconds


def build_report(
    results: DatasetResults,
    drawings: Mapping[str, str],
    wall_clock: Mapping[str, float],
    config_text: str,
    commit: str = "unknown",
) -> str:
    """One HTML page that loads no other file; `drawings`: SVG texts by name; times in seconds."""
    templates = environment(template_folder())
    page, captions = map(templates.get_template, ("report.html.j2", "captions.html.j2"))
    return page.render(
        results=results,
        sections=[
            {
                "id": section.id,
                "title": section.title(results),
                "template": f"section_{section.id if section.content else 'figures'}.html.j2",
                "content": section.content(results) if section.content else {},
                "figures": drawn_figures(results, drawings, captions.module, section.id),
            }
            for section in SECTIONS
            if section.applies(results)
        ],
        stages=stages(results, wall_clock),
        versions=listed(installed(REPORT_LIBRARIES)),
        command=command(commit),
        commit=commit,
        config_text=config_text,
    )


def stages(results: DatasetResults, wall_clock: Mapping[str, float]) -> list[Context]:
    """Seconds of every stage from the start to the end of its jobs; the searches in their order."""
    tried = results.candidates.groupby("phase", sort=False)["evaluations"] if results.phases else ()
    searches = {
        phase: {
            "name": f"Search of {PHASE_NAMES.get(phase, phase)}",
            "candidates": len(evaluations),
            "evaluations": int(evaluations.sum()),
        }
        for phase, evaluations in tried
    }
    others = [name for name in wall_clock if name not in {*BEFORE, *searches, IDENTIFICATION}]
    names = [*BEFORE, *searches, *others, IDENTIFICATION]
    words = {name: {"name": name.replace("_", " ").capitalize()} for name in names}
    words[IDENTIFICATION] = {"name": "All stages, in one job"}
    return [
        {"seconds": wall_clock.get(name)} | (words | searches)[name]
        for name in names
        if name in {*wall_clock, *searches}
    ]


def command(commit: str) -> str:
    """The commands that repeat the run from its configuration."""
    run = "snakemake --snakefile PATH/Snakefile --directory . --cores all"
    digest = commit.split(",")[0]
    return run if digest == "unknown" else f"git -C PATH checkout {digest}\n{run}"


def installed(libraries: Iterable[str]) -> dict[str, str]:
    """Versions of those libraries that are installed."""
    versions = {}
    for library in libraries:
        with suppress(PackageNotFoundError):
            versions[library] = version(library)
    return versions


def listed(versions: Mapping[str, object]) -> str:
    """Names and versions in a line."""
    return ", ".join(f"{name} {value}" for name, value in versions.items())
