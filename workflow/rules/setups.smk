"""Structures with several set-ups, which are data sets: their modes merged, on a page each."""


rule merge_setups:
    """Merge the modes of the set-ups of a structure."""
    input:
        lambda wildcards: [
            result
            for name in provider.setups[wildcards.structure]
            for result in provider.results(name)
        ],
    output:
        page=report(
            SETUPS,
            caption="../report/setups.rst",
            category="All data sets",
            labels={"file": "set-ups of {structure}"},
        ),
        modes=SETUPS.replace("html", "csv"),
    log:
        "results/logs/setups/{structure}.log",
    benchmark:
        "results/benchmarks/setups/{structure}.tsv"
    wildcard_constraints:
        structure="|".join(provider.setups),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        function="report:merge_setups",
        arguments=lambda wildcards: {
            "names": list(provider.setups[wildcards.structure])
        },
        code=code([module_of("report:merge_setups")], TEMPLATES),
    script:
        "../scripts/run_stage.py"
