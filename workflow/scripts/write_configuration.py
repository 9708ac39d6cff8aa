"""Keep the complete configuration of a data set, ready to be run again."""

from typing import TYPE_CHECKING, Any

import yaml

from evopem.files.atomic import write_text
from evopem.files.job import job

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(name: str, dataset: dict[str, Any], config_file: str) -> None:
    given = {key: value for key, value in dataset.items() if value is not None}
    text = yaml.safe_dump(
        {"datasets": {name: given}}, sort_keys=False, allow_unicode=True, default_flow_style=None
    )
    write_text(config_file, text)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(snakemake.wildcards.dataset, snakemake.params.dataset, snakemake.output.config)
