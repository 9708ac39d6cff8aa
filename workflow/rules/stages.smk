"""The hooks of a run, and the rules of all stages in their order."""


include: "terminal.smk"


onstart:
    shorten_job_messages()
    schedule_when_jobs_end()
    mark_unfinished()


onsuccess:
    list_other_targets()
    print_results()


onerror:
    collect_unfinished()
    print_results()


if provider.config.batches:

    include: "by_batch.smk"

else:

    include: "by_stage.smk"


include: "lists.smk"


if provider.setups:

    include: "setups.smk"


# A benchmark beside the workflow: `snakemake fletcher_powell` runs it, a plain `snakemake` does not.
# It runs from its own folder, so that there is none where the workflow is used from a repository.
if IN_CHECKOUT:

    module fletcher_powell:
        snakefile:
            "../../benchmarks/fletcher_powell/Snakefile"

    use rule * from fletcher_powell exclude all as fletcher_powell_*

    use rule all from fletcher_powell as fletcher_powell
