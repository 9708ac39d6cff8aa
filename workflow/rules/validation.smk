"""Validation: residual tests, one-step prediction, and pure simulation."""


rule validate_model:
    """Validate the model on the samples it never saw."""
    input:
        model="results/{dataset}/model.json",
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    output:
        validation=report(
            "results/{dataset}/validation.json",
            caption="../report/validation.rst",
            category="{dataset}",
            subcategory="Model",
            labels={"file": "validation.json"},
        ),
        residual_autocorrelation="results/{dataset}/residual_autocorrelation.csv",
        cross_correlation="results/{dataset}/cross_correlation.csv",
        simulation="results/{dataset}/simulation.csv",
    log:
        "results/{dataset}/logs/validation.log",
    benchmark:
        "results/{dataset}/benchmarks/validation.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        code=code("validate_model"),
    script:
        "../scripts/validate_model.py"
