"""Run one algorithm on one instance of the Fletcher-Powell function."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import product_path  # noqa: F401
from evopem.files.job import job
from fletcher_powell.experiments import Case
from fletcher_powell.runs import run_cases, write_runs

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(
    algorithm: str,
    instance: str,
    cases: Sequence[Case],
    seed: int,
    runs_file: str,
    logger: "Logger",
) -> None:
    write_runs(runs_file, run_cases(algorithm, instance, cases, seed, logger.info))


if __name__ == "__main__":
    with job(snakemake.log[0], outputs=snakemake.output) as log:
        main(
            snakemake.wildcards.algorithm,
            snakemake.wildcards.instance,
            [Case.from_json(case) for case in snakemake.params.cases],
            snakemake.params.seed,
            snakemake.output.runs,
            log,
        )
