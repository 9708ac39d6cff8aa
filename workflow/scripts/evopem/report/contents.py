"""The result files a report is made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from evopem.results.dataset import (
    candidate_of,
    read_json,
    read_optional,
    read_phases,
    read_table,
    require,
)
from evopem.validation.checks import Check, checks

REQUIRED = (
    "recording.json",
    "transforms.json",
    "spectrum.json",
    "candidates.csv",
    "model.json",
    "validation.json",
)


@dataclass(frozen=True)
class Contents:
    """What the result files of one data set hold."""

    dataset: str
    config: Mapping[str, Any]
    config_text: str
    recording: Mapping[str, Any]
    transforms: Mapping[str, Any]
    spectrum: Mapping[str, Any]
    candidates: pd.DataFrame
    phases: Mapping[str, Mapping[str, Any]]
    model: Mapping[str, Any]
    validation: Mapping[str, Any]
    truth: Mapping[str, Any] | None
    figures: Mapping[str, str]
    validation_recording: Mapping[str, Any] | None
    wall_clock: Mapping[str, float]

    @property
    def checks(self) -> list[Check]:
        """The checks on the model."""
        return checks(self.model, self.validation, self.spectrum, self.candidates, self.recording)

    @property
    def chosen(self) -> Mapping[str, Any] | None:
        """Record of the candidate that became the model."""
        return candidate_of(self.model["orders"], self.phases)

    @property
    def is_stand_in(self) -> bool:
        """Whether the data set stands in for the chapter's flexible arm."""
        return self.config.get("synthesis") == "flexible_arm"


def read_contents(paths: Mapping[str, Path], dataset: str | None = None) -> Contents:
    """Read the result files of one data set.

    Parameters
    ----------
    paths : mapping of str to Path
        Files by their names relative to the data set's directory, such as ``model.json``,
        ``phases/delay.json`` or ``figures/record.svg``; others are passed over.
    dataset : str, optional
        The data set's name; by default its key in ``config.yaml``, or else the name of its
        directory.

    Raises
    ------
    InputError
        When a required file is missing or damaged.
    """
    require(REQUIRED, paths)
    config_text, named, config = _configuration(paths.get("config.yaml"))
    return Contents(
        dataset=dataset or named or paths["model.json"].resolve().parent.name,
        config=config,
        config_text=config_text,
        recording=read_json(paths["recording.json"]),
        transforms=read_json(paths["transforms.json"]),
        spectrum=read_json(paths["spectrum.json"]),
        candidates=read_table(paths["candidates.csv"]),
        phases=read_phases(paths),
        model=read_json(paths["model.json"]),
        validation=read_json(paths["validation.json"]),
        truth=read_optional(paths, "truth.json"),
        figures={
            Path(name).stem: path.read_text(encoding="utf-8")
            for name, path in paths.items()
            if name.startswith("figures/") and name.endswith(".svg")
        },
        validation_recording=read_optional(paths, "validation_recording.json"),
        wall_clock=_wall_clock(paths),
    )


def _wall_clock(paths: Mapping[str, Path]) -> dict[str, float]:
    """Seconds from start to end of the jobs of each stage, summed, as Snakemake measured them.

    The jobs of a phase of the order search stand in a folder of its name.  Benchmark files are
    records and no results: one that is missing or empty is passed over.
    """
    seconds: dict[str, float] = {}
    for name, path in paths.items():
        if not (name.startswith("benchmarks/") and name.endswith(".tsv")):
            continue
        stage = name.removeprefix("benchmarks/").removesuffix(".tsv").removeprefix("phases/")
        stage = stage.partition("/")[0]
        try:
            taken = float(pd.read_csv(path, sep="\t")["s"].mean())
        except (OSError, ValueError, KeyError):
            continue
        seconds[stage] = seconds.get(stage, 0.0) + taken
    return seconds


def _configuration(path: Path | None) -> tuple[str, str, Mapping[str, Any]]:
    """Text of the configuration, the data set's name in it, and the data set's keys."""
    if path is None:
        return "", "", {}
    import yaml

    text = path.read_text(encoding="utf-8")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError:
        content = None
    datasets = content.get("datasets") if isinstance(content, dict) else None
    if not isinstance(datasets, dict) or len(datasets) != 1:
        return text, "", {}
    name, keys = next(iter(datasets.items()))
    return text, str(name), keys if isinstance(keys, dict) else {}
