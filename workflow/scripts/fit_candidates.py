"""Fit a part of the candidates of one phase of the order search."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.config.order_grid import candidate_orders
from evopem.estimation.parallel import estimate_side_by_side
from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.models.armax import Orders
from evopem.signals.preparation import load_prepared

if TYPE_CHECKING:
    from logging import Logger

    from snakemake.iocontainers import snakemake


def main(
    prepared_files: tuple[str, str],
    previous_file: str | None,
    spectrum_file: str | None,
    phase: str,
    part: int,
    params: dict[str, Any],
    candidates_file: str,
    logger: "Logger",
    cores: int,
) -> None:
    selected = _read(previous_file)["selected"] if previous_file else None
    resonances = _read(spectrum_file)["resonances"] if spectrum_file else None
    candidates = candidate_orders(phase, params["grid"], selected, resonances)
    own = [Orders(*orders) for orders in candidates[part - 1 :: params["parts"]]]
    fitted = estimate_side_by_side(
        load_prepared(*prepared_files).estimation,
        own,
        phase,
        params["search"],
        params["scoring_start"],
        log=logger.info,
        cores=cores,
    )
    write_json(candidates_file, fitted)


def _read(path: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output) as log:
        main(
            (snakemake.input.prepared, snakemake.input.transforms),
            snakemake.input.get("previous"),
            snakemake.input.get("spectrum"),
            snakemake.wildcards.phase,
            int(snakemake.wildcards.part),
            {key: snakemake.params[key] for key in ("grid", "parts", "search", "scoring_start")},
            snakemake.output.candidates,
            log,
            snakemake.threads,
        )
