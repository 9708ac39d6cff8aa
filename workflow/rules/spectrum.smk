"""Spectrum: Thomson's multitaper estimate, its peaks, and an empirical frequency response."""


rule estimate_spectrum:
    """Estimate the spectrum of the estimation samples, with its confidence band and its peaks."""
    input:
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        spectrum=report(
            files.spectrum,
            caption="../report/spectrum.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "multitaper spectrum"},
        ),
        summary=files.spectrum_summary,
    log:
        files.log("spectrum"),
    benchmark:
        files.benchmark("spectrum")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        spectrum=provider.settings("spectrum"),
        code=code("estimate_spectrum"),
    script:
        "../scripts/estimate_spectrum.py"
