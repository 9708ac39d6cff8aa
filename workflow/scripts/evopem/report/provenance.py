"""What is needed to repeat a run, and how long its stages took."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from evopem.figures.view import View

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
