"""One job a recording: every stage of a data set in one process, for fleets of recordings."""

STEPS = [files.recording, files.prepared, *files.phases]
OUTPUTS = [*STEPS, *files.results, *(files.pages if WITH_REPORT else [])]


rule identify_recording:
    """Take one data set from its recording to its results."""
    input:
        unpack(recorded_file("file")),
    output:
        OUTPUTS,
    log:
        files.log("identification"),
    benchmark:
        files.benchmark("identification")
    wildcard_constraints:
        dataset=one_of([name for name in RECORDED if name not in VALIDATED]),
    conda:
        "../envs/evopem.yaml"
    threads: estimation_cores
    resources:
        mem_mb=estimation_memory,
        runtime=estimation_time,
    params:
        settings=settings(),
        with_report=WITH_REPORT,
        code=code("identify_recording", *TEMPLATES),
    script:
        "../scripts/identify_recording.py"


use rule identify_recording as identify_validated_recording with:
    input:
        unpack(recorded_file("file")),
        unpack(recorded_file("validation_file")),
    output:
        [*OUTPUTS, files.validation_recording, files.validation_recording_info],
    wildcard_constraints:
        dataset=one_of(VALIDATED),


use rule identify_recording as identify_synthetic_recording with:
    input:
        [],
    output:
        [*OUTPUTS, files.truth],
    wildcard_constraints:
        dataset=one_of(SYNTHETIC),
