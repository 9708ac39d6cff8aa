"""Acquisition: a recorded file or a simulated recording, in one fixed form."""


rule read_recording:
    """Read the input and output channels of a recorded file."""
    input:
        unpack(recorded_files("file")),
    output:
        recording=files.recording,
        info=files.recording_info,
    log:
        files.log("recording"),
    benchmark:
        files.benchmark("recording")
    wildcard_constraints:
        dataset=provider.one_of(provider.recorded & provider.single_channel),
    priority: 10  # what cannot be read is said before any search begins
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        recorded=provider.settings("source.files"),
        channels=provider.settings("source.channels"),
        told=provider.settings("source.channels_from_file"),
        code=code("read_recording"),
    script:
        "../scripts/read_recording.py"


use rule read_recording as read_validation_recording with:
    input:
        unpack(recorded_files("validation_file")),
        unpack(provider.told_channels),
    output:
        recording=files.validation_recording,
        info=files.validation_recording_info,
    log:
        files.log("validation_recording"),
    benchmark:
        files.benchmark("validation_recording")
    wildcard_constraints:
        dataset=provider.one_of(provider.validated & provider.single_channel),
    params:
        recorded=provider.settings("source.validation_files"),
        channels=provider.settings("source.channels"),
        told=provider.settings("source.channels_from_file"),
        code=code("read_recording"),


rule synthesize_recording:
    """Simulate a system whose truth is known."""
    output:
        recording=files.recording,
        info=files.recording_info,
        truth=files.truth,
    log:
        files.log("recording"),
    benchmark:
        files.benchmark("recording")
    wildcard_constraints:
        dataset=provider.one_of(provider.synthetic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        source=provider.settings("source"),
        transforms=provider.settings("preparation.transforms"),
        code=code("synthesize_recording"),
    script:
        "../scripts/synthesize_recording.py"
