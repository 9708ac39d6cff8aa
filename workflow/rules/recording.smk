"""One job a recording: every stage of a data set in one process, for fleets of recordings."""

# Which phases there are depends on the structure of the model.
STEPS = [files.recording, files.prepared, directory(files.phases)]
OUTPUTS = [*STEPS, *files.results, *(files.pages if provider.with_report else [])]
DECISIONS = [files.decisions, directory(files.decisions_folder)]
RECORDED = provider.recorded - provider.validated


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
        dataset=provider.one_of(RECORDED & provider.by_chapter),
    conda:
        "../envs/evopem.yaml"
    threads: estimation_cores
    resources:
        mem_mb=provider.estimation_memory,
        runtime=provider.estimation_time,
    params:
        settings=provider.settings(),
        with_report=provider.with_report,
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
        dataset=provider.one_of(provider.validated & provider.by_chapter),


use rule identify_recording as identify_synthetic_recording with:
    input:
        [],
    output:
        [*OUTPUTS, files.truth],
    wildcard_constraints:
        dataset=provider.one_of(provider.synthetic & provider.by_chapter),


use rule identify_recording as identify_automatically with:
    output:
        [*OUTPUTS, *DECISIONS],
    wildcard_constraints:
        dataset=provider.one_of(RECORDED & provider.automatic),


use rule identify_validated_recording as identify_validated_automatically with:
    output:
        [
            *OUTPUTS,
            *DECISIONS,
            files.validation_recording,
            files.validation_recording_info,
        ],
    wildcard_constraints:
        dataset=provider.one_of(provider.validated & provider.automatic),


use rule identify_synthetic_recording as identify_synthetic_automatically with:
    output:
        [*OUTPUTS, *DECISIONS, files.truth],
    wildcard_constraints:
        dataset=provider.one_of(provider.synthetic & provider.automatic),
