"""Take the recordings of a batch through all stages, one after the other, in one process."""

from typing import TYPE_CHECKING

from evopem.config.settings import DatasetSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.identification import identify_batch
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

results = DatasetFiles.of_log(snakemake.log[0]).folder
recordings = {
    name: from_json(DatasetSettings, keys) for name, keys in snakemake.params.settings.items()
}
finished = [DatasetFiles(f"{results}/{name}").checksums for name in recordings]
# The output of the rule is the file of checksums that every job writes about what it has made.
with job(snakemake.log[0], (), finished) as logger:
    identify_batch(results, recordings, snakemake.params.code, logger.info, cores=snakemake.threads)
