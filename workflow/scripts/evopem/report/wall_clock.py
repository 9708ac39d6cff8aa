"""Wall-clock time of the stages, from the benchmark files of Snakemake."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

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
