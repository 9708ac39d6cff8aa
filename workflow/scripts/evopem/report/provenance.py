"""What is needed to repeat a run, and how long its stages took."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from evopem.figures.view import PolynomialView, View
from evopem.report.numbers import count
from evopem.report.sentences.about_recording import uneven_stamps
from evopem.results.multichannel import MultichannelResults
from evopem.signals.recording_info import FileOrigin, RecordingInfo

# They draw and write the page; the libraries behind the numbers are listed in the model.
REPORT_LIBRARIES = ("pandas", "matplotlib", "jinja2", "snakemake")
PHASE_STAGES = {
    "delay": "Delay search",
    "joint": "Search of the joint order",
    "nc": "Search of nc",
    "nd": "Search of nd",
    "na": "Search of na",
    "nb": "Search of nb",
    "structures": "Search of all structures",
    "chosen": "Search of the chosen model",
}
# The folder of times of a phase, where it has another name.
TIMES = {"structures": "search_structure", "chosen": "estimate"}
# All stages where they ran as one job.
ONE_JOB = "identification"
BEFORE = (
    ("read_recording", "Reading"),
    ("prepare", "Preparation"),
    ("estimate_spectrum", "Spectrum"),
)
AFTER = (
    ("complete_model", "Model and covariance"),
    ("validate", "Validation"),
    ("draw_figures", "Figures"),
)


@dataclass(frozen=True)
class Stage:
    """Time and evaluations of one stage; None where they are not known or there are none."""

    name: str
    seconds: float | None
    candidates: int | None = None
    evaluations: int | None = None


def stages(view: View, wall_clock: Mapping[str, float]) -> list[Stage]:
    """Time of every stage in its order, from the start to the end of its jobs."""
    if not isinstance(view, PolynomialView):
        return [Stage(name.replace("_", " "), seconds) for name, seconds in wall_clock.items()]
    results = view.results
    rows = [Stage(name, wall_clock.get(stage)) for stage, name in BEFORE]
    for phase, selection in results.phases.items():
        tried = [candidate.diagnostics for candidate in selection.candidates]
        evaluations = sum(diagnostics.evaluations for diagnostics in tried)
        seconds = wall_clock.get(TIMES.get(phase, phase))
        rows.append(Stage(PHASE_STAGES[phase], seconds, len(tried), evaluations))
    rows += [Stage(name, wall_clock.get(stage)) for stage, name in AFTER]
    if ONE_JOB in wall_clock:
        rows.append(Stage("All stages, in one job", wall_clock[ONE_JOB]))
    return rows


def command(commit: str) -> str:
    """The commands that repeat the run from its configuration."""
    run = "snakemake --snakefile PATH/Snakefile --directory . --cores all"
    digest = commit.split(",")[0]
    return run if digest == "unknown" else f"git -C PATH checkout {digest}\n{run}"


def terms(view: View, commit: str) -> list[tuple[str, str]]:
    """Origin, seeds, evaluations and versions, as terms and values."""
    model = view.results.model
    rows = _of_polynomial(view) if isinstance(view, PolynomialView) else _of_channels(view.results)
    rows.append(("Commit of the workflow", commit))
    rows.append(("Versions behind the numbers", listed({"evopem": model.evopem} | model.versions)))
    rows.append(("Versions behind this page", listed(installed(REPORT_LIBRARIES))))
    return rows


def _of_polynomial(view: PolynomialView) -> list[tuple[str, str]]:
    results = view.results
    rows = _origin(results.recording_info, "")
    if results.validation_recording_info is not None:
        rows += _origin(results.validation_recording_info, " for validation")
    rows.append(("Seed of the search", str(results.model.search.settings.seed)))
    if results.truth is not None:
        rows.append(("Seed of the synthesis", str(results.truth.seed)))
    rows.append(("Objective evaluations", count(int(results.candidates["evaluations"].sum()))))
    return rows


def _of_channels(results: MultichannelResults) -> list[tuple[str, str]]:
    model, time = results.model, results.recording_info.time_told
    return [
        *(row for file in results.files for row in file_rows(file)),
        *([("Sampling rate", f"of the time stamps “{time}”, told by name")] if time else []),
        *(("Time stamps", each) for each in uneven_stamps(results.recording_info.uneven_times)),
        ("Objective of the search", model.search.settings.objective),
        ("Seed of the search", str(model.search.settings.seed)),
        ("Objective evaluations of the last search", count(model.search.diagnostics.evaluations)),
    ]


def _origin(recording: RecordingInfo, suffix: str) -> list[tuple[str, str]]:
    if not recording.files:
        return [(f"Recording{suffix}", "simulated, see the configuration")]
    return [row for file in recording.files for row in _file_rows(file, suffix)]


def file_rows(file: FileOrigin) -> list[tuple[str, str]]:
    """What is known of a recorded file, whatever its channels."""
    return [
        ("File", file.path),
        ("SHA-256", file.sha256),
        ("Size", f"{count(file.bytes)} bytes"),
        ("Format", file.format),
    ]


def _file_rows(file: FileOrigin, suffix: str) -> list[tuple[str, str]]:
    rows = [
        *file_rows(file),
        *(("Input channel", str(each)) for each in file.inputs),
        *(("Output channel", str(each)) for each in file.outputs),
    ]
    return [(f"{term}{suffix}", value) for term, value in rows]


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
