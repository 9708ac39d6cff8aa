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


rule tabulate_fletcher_powell:
    """Collect all runs into tables, and judge every claim by them."""
    input:
        runs=comparison_runs,
    output:
        table=report(
            "results/fletcher_powell/table.csv",
            caption="../report/fletcher_powell/table.rst",
            category="Fletcher-Powell",
            labels={"file": "table.csv"},
        ),
        runs="results/fletcher_powell/runs.csv",
        convergence="results/fletcher_powell/convergence.csv",
        landscape="results/fletcher_powell/landscape.csv",
        minima="results/fletcher_powell/minima.csv",
        claims="results/fletcher_powell/claims.json",
    log:
        "results/fletcher_powell/logs/table.log",
    benchmark:
        "results/fletcher_powell/benchmarks/table.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        instance=experiments.instances(COMPARISON)[0],
        code=code("tabulate_fletcher_powell"),
    script:
        "../scripts/tabulate_fletcher_powell.py"


rule draw_fletcher_powell:
    """Draw the function, the runs' ends, convergence, and evaluations to success."""
    input:
        table="results/fletcher_powell/table.csv",
        runs="results/fletcher_powell/runs.csv",
        convergence="results/fletcher_powell/convergence.csv",
        landscape="results/fletcher_powell/landscape.csv",
        minima="results/fletcher_powell/minima.csv",
    output:
        [
            f"results/fletcher_powell/figures/{figure}.svg"
            for figure in experiments.FIGURES
        ],
    log:
        "results/fletcher_powell/logs/figures.log",
    benchmark:
        "results/fletcher_powell/benchmarks/figures.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=code("draw_fletcher_powell"),
    script:
        "../scripts/draw_fletcher_powell.py"


rule report_fletcher_powell:
    """Set tables, claims and figures into one HTML file."""
    input:
        table="results/fletcher_powell/table.csv",
        runs="results/fletcher_powell/runs.csv",
        convergence="results/fletcher_powell/convergence.csv",
        landscape="results/fletcher_powell/landscape.csv",
        minima="results/fletcher_powell/minima.csv",
        claims="results/fletcher_powell/claims.json",
        figures=[
            f"results/fletcher_powell/figures/{figure}.svg"
            for figure in experiments.FIGURES
        ],
    output:
        report=report(
            "results/fletcher_powell/report.html",
            caption="../report/fletcher_powell/report.rst",
            category="Fletcher-Powell",
            labels={"file": "report.html"},
        ),
        text="results/fletcher_powell/table.md",
    log:
        "results/fletcher_powell/logs/report.log",
    benchmark:
        "results/fletcher_powell/benchmarks/report.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        settings=COMPARISON,
        code=code("report_fletcher_powell", *TEMPLATES),
    script:
        "../scripts/report_fletcher_powell.py"


rule fletcher_powell:
    """Compare the hybrid with other algorithms on the chapter's test function: asked for by name."""
    input:
        "results/fletcher_powell/report.html",
        "results/fletcher_powell/table.csv",
