"""Identify every data set of config.yaml: from its recording to a report."""

from snakemake.utils import min_version

# Older ones rerun every job of a script that is younger than its results, as in a fresh clone.
min_version("9.11")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"


rule all:
    input:
        [provider.results(dataset) for dataset in provider.config.datasets],
        provider.lists,


onstart:
    mark_unfinished()


onsuccess:
    list_other_targets()


onerror:
    collect_unfinished()


if provider.config.run.one_job_per == "recording":

    include: "workflow/rules/recording.smk"

else:

    include: "workflow/rules/acquisition.smk"
    include: "workflow/rules/preparation.smk"
    include: "workflow/rules/spectrum.smk"
    include: "workflow/rules/order_search.smk"
    include: "workflow/rules/automatic.smk"
    include: "workflow/rules/model.smk"
    include: "workflow/rules/validation.smk"
    include: "workflow/rules/report.smk"


include: "workflow/rules/fleet.smk"


# A benchmark beside the workflow: `snakemake fletcher_powell` runs it, a plain `snakemake` does not.
module fletcher_powell:
    snakefile:
        "benchmarks/fletcher_powell/Snakefile"


use rule * from fletcher_powell exclude all as fletcher_powell_*


use rule all from fletcher_powell as fletcher_powell
