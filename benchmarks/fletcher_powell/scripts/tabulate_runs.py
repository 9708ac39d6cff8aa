"""Collect the runs into tables, and test the hypotheses."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import product_path  # noqa: F401
from evopem.files.atomic import write_table
from evopem.files.job import job
from evopem.files.json_form import load, save
from fletcher_powell.hypotheses import evaluate_hypotheses
from fletcher_powell.runs import Run
from fletcher_powell.statistics import (
    convergence_table,
    landscape_table,
    minima_table,
    runs_table,
    summary_table,
)

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(run_files: Sequence[str], instance: str, outputs: Mapping[str, str]) -> None:
    made = [run for file in run_files for run in load(tuple[Run, ...], file)]
    runs = runs_table(made)
    summary = summary_table(runs)
    write_table(outputs["table"], summary)
    write_table(outputs["runs"], runs)
    write_table(outputs["convergence"], convergence_table(made))
    write_table(outputs["landscape"], landscape_table(instance))
    write_table(outputs["minima"], minima_table(instance))
    save(evaluate_hypotheses(summary, runs), outputs["hypotheses"])


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), snakemake.params.instance, dict(snakemake.output.items()))
