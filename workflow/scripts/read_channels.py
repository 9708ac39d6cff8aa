"""Read the input and output channels of recorded files."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import ChannelLists, Geometry
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.acquisition import read_channels
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    geometry = snakemake.params.geometry
    read_channels(
        snakemake.params.recorded,
        from_json(ChannelLists, snakemake.params.channels),
        from_json(Geometry, geometry) if geometry else None,
        f"datasets.{DatasetFiles.of_log(snakemake.log[0]).name}",
        snakemake.output.recording,
        snakemake.output.info,
    )
