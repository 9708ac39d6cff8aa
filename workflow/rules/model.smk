"""Model: the chosen candidate as a complete model, and every candidate in one table."""


rule complete_model:
    """Give the chosen candidate its covariance, modes and frequency response."""
    input:
        phase="results/{dataset}/phases/b.json",
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    output:
        model=report(
            "results/{dataset}/model.json",
            caption="../report/model.rst",
            category="{dataset}",
            subcategory="Model",
            labels={"file": "model.json"},
        ),
        matlab="results/{dataset}/model.mat",
        modes=report(
            "results/{dataset}/modes.csv",
            caption="../report/modes.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "modes"},
        ),
        frequency_response="results/{dataset}/frequency_response.csv",
    log:
        "results/{dataset}/logs/model.log",
    benchmark:
        "results/{dataset}/benchmarks/model.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        scoring_start=lambda wildcards: grids.scoring_start(DATASETS[wildcards.dataset]),
        search=lambda wildcards: DATASETS[wildcards.dataset]["search"],
        code=code("complete_model"),
    script:
        "../scripts/complete_model.py"


rule tabulate_candidates:
    """List every candidate of every phase in one table."""
    input:
        phases=expand("results/{{dataset}}/phases/{phase}.json", phase=grids.PHASES),
    output:
        candidates=report(
            "results/{dataset}/candidates.csv",
            caption="../report/candidates.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "candidates"},
        ),
    log:
        "results/{dataset}/logs/candidates.log",
    benchmark:
        "results/{dataset}/benchmarks/candidates.tsv"
    localrule: True
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code("tabulate_candidates"),
    script:
        "../scripts/tabulate_candidates.py"
