"""Run one algorithm on one instance of the Fletcher-Powell function."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import product_path  # noqa: F401
from evopem.files.job import job
from evopem.files.json_form import from_json, save
from fletcher_powell.experiments import Case
from fletcher_powell.runs import run_cases

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
    save(run_cases(algorithm, instance, cases, seed, logger.info), runs_file)


if __name__ == "__main__":
    with job(snakemake.log[0], outputs=snakemake.output) as log:
        main(
            snakemake.wildcards.algorithm,
            snakemake.wildcards.instance,
            from_json(tuple[Case, ...], snakemake.params.cases),
            snakemake.params.seed,
            snakemake.output.runs,
            log,
        )
