"""What is needed to repeat a run, and what the run took."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from evopem.report.contents import Contents
from evopem.report.numbers import count

# Beside those of the model's numbers: they draw and write, and are those of the report's making.
REPORT_LIBRARIES = ("pandas", "matplotlib", "jinja2", "snakemake")
PHASES = {
    "delay": "Fits of the delay search",
    "common": "Fits of phase one, common order",
    "c": "Fits of phase two, nc",
    "b": "Fits of phase three, nb",
}
BEFORE = (("recording", "Reading"), ("prepared", "Preparation"), ("spectrum", "Spectrum"))
AFTER = (("model", "Model and covariance"), ("validation", "Validation"), ("figures", "Figures"))


@dataclass(frozen=True)
class Stage:
    """What one stage took; ``candidates`` and ``evaluations`` are None where it has none."""

    name: str
    seconds: float | None
    candidates: int | None = None
    evaluations: int | None = None


def stages(contents: Contents) -> list[Stage]:
    """Time of every stage in its order.

    From start to end of its jobs, which may run side by side; None where it was not kept.
    """
    clock = contents.wall_clock
    rows = [Stage(name, clock.get(stage)) for stage, name in BEFORE]
    for phase, name in PHASES.items():
        tried = contents.candidates[contents.candidates["phase"] == phase]
        if not tried.empty:
            evaluations = int(tried["evaluations"].fillna(0).sum())
            rows.append(Stage(name, clock.get(phase), len(tried), evaluations))
    return rows + [Stage(name, clock.get(stage)) for stage, name in AFTER]


def command(commit: str) -> str:
    """The commands that repeat the run from its configuration."""
    run = "snakemake --snakefile PATH/Snakefile --directory . --cores all"
    digest = commit.split(",")[0]
    return run if digest == "unknown" else f"git -C PATH checkout {digest}\n{run}"


def terms(contents: Contents, commit: str) -> list[tuple[str, str]]:
    """Origin, seeds, amounts and versions, as terms and values."""
    recording, model = contents.recording, contents.model
    rows = _origin(recording, "")
    if contents.validation_recording:
        rows += _origin(contents.validation_recording, " for validation")
    rows.append(("Seed of the search", str(model.get("seed", "–"))))
    if contents.truth and contents.truth.get("seed") is not None:
        rows.append(("Seed of the synthesis", str(contents.truth["seed"])))
    evaluations = contents.candidates["evaluations"].fillna(0).sum()
    rows.append(("Objective evaluations in all", count(int(evaluations))))
    rows.append(("Commit of the workflow", commit))
    versions = {"evopem": model.get("evopem", "unknown"), **(model.get("versions") or {})}
    rows.append(("Versions behind the numbers", listed(versions)))
    rows.append(("Versions behind this page", listed(installed(REPORT_LIBRARIES))))
    return rows


def _origin(recording: Mapping[str, Any], suffix: str) -> list[tuple[str, str]]:
    if recording.get("kind") == "synthesis":
        return [(f"Recording{suffix}", "simulated, see the configuration")]
    rows = [(f"File{suffix}", str(recording.get("path") or "unknown"))]
    rows.append((f"SHA-256{suffix}", str(recording.get("sha256") or "unknown")))
    if recording.get("bytes"):
        rows.append((f"Size{suffix}", f"{count(recording['bytes'])} bytes"))
    named = (
        ("format", "Format"),
        ("input_channel", "Input channel"),
        ("output_channel", "Output channel"),
    )
    rows += [
        (f"{term}{suffix}", str(recording[key]))
        for key, term in named
        if recording.get(key) is not None
    ]
    return rows


def installed(libraries: Iterable[str]) -> dict[str, str]:
    """Versions of those of the libraries that are there."""
    found = {}
    for library in libraries:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            continue
    return found


def listed(versions: Mapping[str, Any]) -> str:
    """Names and versions in a line."""
    return ", ".join(f"{name} {value}" for name, value in versions.items())
