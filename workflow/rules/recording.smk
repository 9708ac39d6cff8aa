"""One job a recording: every stage of a data set in one process, for fleets of recordings."""


rule identify_recording:
    """Take one data set from its recording to its results."""
    input:
        unpack(recorded_file("file")),
    output:
        results_of_one_job(),
    log:
        "results/{dataset}/logs/identification.log",
    benchmark:
        "results/{dataset}/benchmarks/identification.tsv"
    wildcard_constraints:
        dataset=one_of([name for name in RECORDED if name not in VALIDATED]),
    conda:
        "../envs/evopem.yaml"
    threads: fitting_cores
    resources:
        mem_mb=fitting_memory,
        runtime=fitting_time,
    params:
        settings=settings_of,
        code=code("identify_recording", *TEMPLATES),
    script:
        "../scripts/identify_recording.py"


use rule identify_recording as identify_validated_recording with:
    input:
        unpack(recorded_file("file")),
        unpack(recorded_file("validation_file")),
    output:
        results_of_one_job("validation_recording.npz", "validation_recording.json"),
    wildcard_constraints:
        dataset=one_of(VALIDATED),


use rule identify_recording as identify_synthetic_recording with:
    input:
        [],
    output:
        results_of_one_job("truth.json"),
    wildcard_constraints:
        dataset=one_of(SYNTHETIC),
