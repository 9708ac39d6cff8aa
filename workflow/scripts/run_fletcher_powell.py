"""Run one algorithm on one instance of the Fletcher-Powell function."""

from typing import TYPE_CHECKING, Any

from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.fletcher_powell.runs import run_cases

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(
    algorithm: str,
    instance: str,
    cases: list[dict[str, Any]],
    seed: int,
    runs_file: str,
    logger: "Logger",
) -> None:
    write_json(runs_file, run_cases(algorithm, instance, cases, seed, logger.info))


if __name__ == "__main__":
    with job(snakemake.log[0], outputs=snakemake.output) as log:
        main(
            snakemake.wildcards.algorithm,
            snakemake.wildcards.instance,
            snakemake.params.cases,
            snakemake.params.seed,
            snakemake.output.runs,
            log,
        )
