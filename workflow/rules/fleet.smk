"""Fleet: all data sets in one page and one table."""


rule collect_fleet:
    """List all data sets, put all their modes and checks into one table, and follow modes."""
    input:
        # Every other job of a data set is behind one of these: the lists come last.
        provider.last_results,
        # Those of a batch are no outputs of Snakemake's jobs.
        summaries=[
            DatasetFiles.of_dataset(dataset).summary
            for dataset in provider.config.datasets
            if not provider.config.batches
        ],
    output:
        index=report(
            OVERVIEW[0],
            caption="../report/index.rst",
            category="All data sets",
            labels={"file": "index.html"},
        ),
        csv=OVERVIEW[1],
        parquet=OVERVIEW[2],
        modes=OVERVIEW[3],
    log:
        "results/logs/fleet.log",
    benchmark:
        "results/benchmarks/fleet.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        names=list(provider.config.datasets),
        page=provider.page,
        order=provider.order,
        code=code("collect_fleet", *TEMPLATES),
    script:
        "../scripts/collect_fleet.py"
