"""Collect the candidates of one phase and choose one of them."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.console import job
from evopem.estimation.order_search import select_delay, select_order
from evopem.writing import write_json

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(part_files: list[str], phase: str, phase_file: str, logger: "Logger") -> None:
    candidates = [
        candidate
        for part_file in part_files
        for candidate in json.loads(Path(part_file).read_text(encoding="utf-8"))
    ]
    candidates.sort(key=lambda candidate: [candidate[order] for order in ("na", "nb", "nc", "nk")])
    selected, reason = (select_delay if phase == "delay" else select_order)(candidates)
    logger.info("%s", reason)
    write_json(
        phase_file,
        {"phase": phase, "selected": selected, "reason": reason, "candidates": candidates},
    )


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output) as log:
        main(list(snakemake.input.parts), snakemake.wildcards.phase, snakemake.output.phase, log)
