"""Read the input and output channels of the recorded files of a data set."""

from typing import TYPE_CHECKING

from evopem.config.settings import ChannelSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.acquisition import read_recording

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    read_recording(
        snakemake.params.recorded,
        from_json(ChannelSettings, snakemake.params.channels),
        snakemake.output.recording,
        snakemake.output.info,
        told=snakemake.params.told,
        told_in=snakemake.input.get("info", ""),
    )
