"""Fletcher-Powell: the hybrid beside other algorithms on the chapter's test function (table 1)."""


rule run_fletcher_powell:
    """Run one algorithm a few times on one instance of the function."""
    output:
        runs="results/fletcher_powell/runs/{comparison_part}/{algorithm}/{instance}/{block}.json",
    log:
        "results/fletcher_powell/logs/runs/{comparison_part}/{algorithm}/{instance}/{block}.log",
    benchmark:
        "results/fletcher_powell/benchmarks/runs/{comparison_part}/{algorithm}/{instance}/{block}.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        cases=comparison_cases,
        seed=COMPARISON["seed"],
        code=code("run_fletcher_powell"),
    script:
        "../scripts/run_fletcher_powell.py"
