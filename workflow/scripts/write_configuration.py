"""Keep the complete configuration of a data set, once its record can carry every model."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from evopem.configuration.grids import check_samples
from evopem.console import job
from evopem.writing import write_text

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(name: str, dataset: dict[str, Any], transforms_file: str, config_file: str) -> None:
    prepared = json.loads(Path(transforms_file).read_text(encoding="utf-8"))
    counts = (prepared["estimation_samples"], prepared["validation_samples"])
    check_samples(dataset, *counts, f"datasets.{name}")
    given = {key: value for key, value in dataset.items() if value is not None}
    text = yaml.safe_dump(
        {"datasets": {name: given}}, sort_keys=False, allow_unicode=True, default_flow_style=None
    )
    write_text(config_file, text)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.wildcards.dataset,
            snakemake.params.dataset,
            snakemake.input.transforms,
            snakemake.output.config,
        )
