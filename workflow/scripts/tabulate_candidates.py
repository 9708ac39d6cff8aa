"""List every candidate of every phase in one table."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_table
from evopem.files.job import job

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

ORDERS = ["na", "nb", "nc", "nk"]
COLUMNS = [
    "phase",
    *ORDERS,
    "rss",
    "bic",
    "objective",
    "evaluations",
    "max_pole_radius",
    "selected",
    "max_zero_radius",
    "populations",
    "agreement",
    "basins",
    "at_margin",
    "checked",
    "unseen",
]


def main(phase_files: list[str], candidates_file: str) -> None:
    rows = []
    for phase_file in phase_files:
        phase = json.loads(Path(phase_file).read_text(encoding="utf-8"))
        for candidate in phase["candidates"]:
            selected = all(candidate[order] == phase["selected"][order] for order in ORDERS)
            rows.append(candidate | {"phase": phase["phase"], "selected": selected})
    write_table(candidates_file, {name: [row[name] for row in rows] for name in COLUMNS})


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input.phases), snakemake.output.candidates)
