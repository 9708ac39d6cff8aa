"""Validate the model on the samples it never saw."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_json, write_table
from evopem.files.job import job
from evopem.models.files import load
from evopem.signals.preparation import load_prepared
from evopem.validation import validate

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(model_file: str, prepared_files: tuple[str, str], outputs: dict[str, str]) -> None:
    scoring_start = json.loads(Path(model_file).read_text(encoding="utf-8"))["scoring_start"]
    validation = validate(
        load(model_file), load_prepared(*prepared_files), scoring_start=scoring_start
    )
    write_json(outputs["validation"], validation.scalars())
    write_table(outputs["residual_autocorrelation"], validation.residual_autocorrelation)
    write_table(outputs["cross_correlation"], validation.cross_correlation)
    write_table(outputs["simulation"], validation.simulation)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.input.model,
            (snakemake.input.prepared, snakemake.input.transforms),
            dict(snakemake.output.items()),
        )
