"""Collect the candidates of one phase and choose one of them."""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.estimation.order_selection import continue_from, search_again, select
from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.signals.preparation import load_prepared

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(
    part_files: list[str],
    prepared_files: tuple[str, str],
    phase: str,
    params: dict[str, Any],
    phase_file: str,
    logger: "Logger",
) -> None:
    candidates = [
        candidate
        for part_file in part_files
        for candidate in json.loads(Path(part_file).read_text(encoding="utf-8"))
    ]
    candidates.sort(key=lambda candidate: [candidate[order] for order in ("na", "nb", "nc", "nk")])
    data = load_prepared(*prepared_files).estimation
    again = partial(search_again, data=data, **params, log=logger.info)
    continued = partial(continue_from, data=data, **params)
    selected, reason, candidates = select(candidates, phase, again, continued)
    logger.info("%s", reason)
    write_json(
        phase_file,
        {"phase": phase, "selected": selected, "reason": reason, "candidates": candidates},
    )


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output) as log:
        main(
            list(snakemake.input.parts),
            (snakemake.input.prepared, snakemake.input.transforms),
            snakemake.wildcards.phase,
            {key: snakemake.params[key] for key in ("search", "scoring_start")},
            snakemake.output.phase,
            log,
        )
