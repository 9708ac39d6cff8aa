"""The lists of all data sets: one page, and tables of their modes and checks."""


rule list_datasets:
    """List all data sets, put all their modes and checks into one table, and follow modes."""
    input:
        # Every other job of a data set is behind one of these: the lists come last.
        provider.last_results,
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
        # The damage index, where a reference is named.
        damage=lists_of(provider.config.following)[len(OVERVIEW) :],
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
        function=LIST,
        arguments={
            "names": list(provider.config.datasets),
            "page": provider.page,
            "following": to_json(provider.config.following),
            "setups": list(provider.setups),
        },
        # An edited result is no input of the lists, which then call its data set failed.
        changed=lambda wildcards: changed_in(provider.config.datasets),
        code=code([module_of(LIST)], TEMPLATES),
    script:
        "../scripts/run_stage.py"
