"""Spectrum: Thomson's multitaper estimate, its peaks, and a first frequency response."""


rule estimate_spectrum:
    """Estimate the spectrum of the estimation samples, with its band and its peaks."""
    input:
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    output:
        spectrum=report(
            "results/{dataset}/spectrum.csv",
            caption="../report/spectrum.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "multitaper spectrum"},
        ),
        peaks="results/{dataset}/spectrum.json",
    log:
        "results/{dataset}/logs/spectrum.log",
    benchmark:
        "results/{dataset}/benchmarks/spectrum.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        spectrum=lambda wildcards: DATASETS[wildcards.dataset]["spectrum"],
        code=code("estimate_spectrum"),
    script:
        "../scripts/estimate_spectrum.py"
