"""Collect the runs on the Fletcher-Powell function into tables, and judge what is claimed."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_json, write_table
from evopem.files.job import job
from evopem.fletcher_powell.claims import claims
from evopem.fletcher_powell.statistics import (
    convergence_table,
    landscape_table,
    minima_table,
    runs_table,
    summary_table,
)

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(run_files: list[str], instance: str, outputs: dict[str, str]) -> None:
    records = [
        record
        for run_file in run_files
        for record in json.loads(Path(run_file).read_text(encoding="utf-8"))
    ]
    runs = runs_table(records)
    summary = summary_table(runs)
    write_table(outputs["table"], summary)
    write_table(outputs["runs"], runs)
    write_table(outputs["convergence"], convergence_table(records))
    write_table(outputs["landscape"], landscape_table(instance))
    write_table(outputs["minima"], minima_table(instance))
    write_json(outputs["claims"], [asdict(claim) for claim in claims(summary, runs)])


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), snakemake.params.instance, dict(snakemake.output.items()))
