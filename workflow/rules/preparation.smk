"""Preparation: resampling, Box-Cox, differences, the cut into two sets, zero means."""


rule prepare_signals:
    """Make both signals stationary, each transform with what is needed to undo it."""
    input:
        unpack(recordings_of),
    output:
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    log:
        "results/{dataset}/logs/prepared.log",
    benchmark:
        "results/{dataset}/benchmarks/prepared.tsv"
    priority: 10
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        stationarity=lambda wildcards: DATASETS[wildcards.dataset]["stationarity"],
        split=lambda wildcards: DATASETS[wildcards.dataset]["split"],
        resample=lambda wildcards: DATASETS[wildcards.dataset]["resample"],
        needs=lambda wildcards: grids.sample_needs(DATASETS[wildcards.dataset]),
        code=code("prepare_signals"),
    script:
        "../scripts/prepare_signals.py"


rule write_configuration:
    """Keep the complete configuration of a data set beside its results."""
    output:
        config="results/{dataset}/config.yaml",
    log:
        "results/{dataset}/logs/config.log",
    localrule: True
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        dataset=lambda wildcards: DATASETS[wildcards.dataset],
        code=code("write_configuration"),
    script:
        "../scripts/write_configuration.py"
