"""Preparation: resampling, transforms, the division into two sets, zero means."""


rule prepare_signals:
    """Make both signals stationary, and keep what undoes each transform."""
    input:
        unpack(provider.validation_recording(files.validation_recording)),
        recording=files.recording,
    output:
        prepared=files.prepared,
        transforms=files.transforms,
    log:
        files.log("preparation"),
    benchmark:
        files.benchmark("preparation")
    wildcard_constraints:
        dataset=provider.one_of(provider.by_chapter),
    priority: 10
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        preparation=provider.settings("preparation"),
        requirements=provider.order_search.requirements,
        fit=provider.order_search.fit_to_check,
        recorded=provider.recorded_names,
        code=code("prepare_signals"),
    script:
        "../scripts/prepare_signals.py"


rule write_configuration:
    """Keep the complete configuration of a data set beside its results."""
    output:
        config=files.config,
    log:
        files.log("configuration"),
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    localrule: True
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        settings=provider.settings(),
        code=code("write_configuration"),
    script:
        "../scripts/write_configuration.py"
