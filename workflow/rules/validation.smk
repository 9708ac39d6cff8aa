"""Validation: residual tests, one-step prediction, and simulation."""


rule validate_model:
    """Validate the model on samples that it was not estimated from."""
    input:
        model=files.model,
        prepared=files.prepared,
        transforms=files.transforms,
        orders=provider.order_search.models_of_orders,
        spectrum=files.spectrum_summary,
    output:
        validation=report(
            files.validation,
            caption="../report/validation.rst",
            category="{dataset}",
            subcategory="Model",
            labels={"file": "validation.json"},
        ),
        residual_autocorrelation=files.residual_autocorrelation,
        cross_correlation=files.cross_correlation,
        simulation=files.simulation,
        horizons=files.horizons,
    log:
        files.log("validation"),
    benchmark:
        files.benchmark("validation")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        phase=provider.order_search.phase_of_orders,
        code=code("validate_model"),
    script:
        "../scripts/validate_model.py"


rule summarize_dataset:
    """Put the orders, modes, errors and checks of one data set into one small file."""
    input:
        info=files.recording_info,
        spectrum=files.spectrum_summary,
        phases=provider.order_search.selections,
        model=files.model,
        validation=files.validation,
    output:
        summary=files.summary,
    log:
        files.log("summary"),
    benchmark:
        files.benchmark("summary")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        phases=provider.order_search.phases,
        code=code("summarize_dataset"),
    script:
        "../scripts/summarize_dataset.py"
