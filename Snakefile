"""Identify every data set of config.yaml: from its recording to a report."""

from snakemake.utils import min_version

# Older ones rerun every job of a script that is younger than its results, as in a fresh clone.
min_version("9.11")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"


rule all:
    input:
        provider.targets,
        provider.lists,
        expand(SETUPS, structure=provider.setups),


include: "workflow/rules/stages.smk"
