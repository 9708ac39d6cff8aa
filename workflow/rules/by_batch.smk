"""Several recordings a job, one after the other in one process, for fleets of short ones."""


# The results of the recordings are no outputs: Snakemake deletes those of a job that fails, and a
# bad recording would take its neighbours along. The job knows by itself which ones are finished.
rule identify_batch:
    """Take the recordings of a batch from their files to their results."""
    input:
        lambda wildcards: list(map(local, provider.batch_files(wildcards))),
    output:
        BATCH_CHECKSUMS,
    log:
        f"results/logs/{BATCH}.log",
    benchmark:
        f"results/benchmarks/{BATCH}.tsv"
    wildcard_constraints:
        batch=r"\d+",
    conda:
        "../envs/evopem.yaml"
    threads: estimation_cores
    resources:
        mem_mb=provider.batch_memory,
        runtime=provider.batch_time,
    params:
        settings=provider.batch_settings,
        code=BATCH_CODE,
    script:
        "../scripts/identify_batch.py"
