"""Give the chosen candidate its covariance, modes and frequency response."""

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem import __version__
from evopem.estimation.order_selection import evidence_of, recall
from evopem.files.atomic import write_table
from evopem.files.job import job
from evopem.models.files import save_model_json, save_model_mat
from evopem.models.response_tables import frequency_response_table, modes_table
from evopem.signals.preparation import load_prepared

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

LIBRARIES = ("numpy", "scipy", "numba")


def main(
    phase_file: str,
    prepared_files: tuple[str, str],
    search: dict[str, Any],
    scoring_start: int,
    outputs: dict[str, str],
) -> None:
    phase = json.loads(Path(phase_file).read_text(encoding="utf-8"))
    chosen = next(
        candidate
        for candidate in phase["candidates"]
        if all(candidate[order] == value for order, value in phase["selected"].items())
    )
    estimate = recall(chosen, load_prepared(*prepared_files).estimation, search, scoring_start)
    evidence = evidence_of(estimate, search) | {
        "transforms": json.loads(Path(prepared_files[1]).read_text(encoding="utf-8")),
        "evopem": __version__,
        "versions": {"python": platform.python_version()}
        | {library: version(library) for library in LIBRARIES},
    }
    save_model_json(estimate.model, outputs["model"], evidence)
    save_model_mat(estimate.model, outputs["matlab"])
    write_table(outputs["modes"], modes_table(estimate.model))
    write_table(outputs["frequency_response"], frequency_response_table(estimate.model))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.input.phase,
            (snakemake.input.prepared, snakemake.input.transforms),
            snakemake.params.search,
            snakemake.params.scoring_start,
            dict(snakemake.output.items()),
        )
