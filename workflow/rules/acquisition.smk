"""Acquisition: a recorded file or a synthetic record, in one fixed form."""


rule read_recording:
    """Read the input and output channels of a recorded file."""
    input:
        unpack(recorded_file("file")),
    output:
        recording="results/{dataset}/recording.npz",
        origin="results/{dataset}/recording.json",
    log:
        "results/{dataset}/logs/recording.log",
    benchmark:
        "results/{dataset}/benchmarks/recording.tsv"
    wildcard_constraints:
        dataset=one_of(RECORDED),
    priority: 10  # what cannot be read is said before any search begins
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        file=lambda wildcards: DATASETS[wildcards.dataset]["file"],
        channels=channels_of,
        code=code("read_recording"),
    script:
        "../scripts/read_recording.py"


use rule read_recording as read_validation_recording with:
    input:
        unpack(recorded_file("validation_file")),
    output:
        recording="results/{dataset}/validation_recording.npz",
        origin="results/{dataset}/validation_recording.json",
    log:
        "results/{dataset}/logs/validation_recording.log",
    benchmark:
        "results/{dataset}/benchmarks/validation_recording.tsv"
    params:
        file=lambda wildcards: DATASETS[wildcards.dataset]["validation_file"],
        channels=channels_of,
        code=code("read_recording"),


rule synthesize_recording:
    """Simulate a system whose truth is known."""
    output:
        recording="results/{dataset}/recording.npz",
        origin="results/{dataset}/recording.json",
        truth="results/{dataset}/truth.json",
    log:
        "results/{dataset}/logs/recording.log",
    benchmark:
        "results/{dataset}/benchmarks/recording.tsv"
    wildcard_constraints:
        dataset=one_of(SYNTHETIC),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        kind=lambda wildcards: DATASETS[wildcards.dataset]["synthesis"],
        settings=synthesis_settings,
        code=code("synthesize_recording"),
    script:
        "../scripts/synthesize_recording.py"
