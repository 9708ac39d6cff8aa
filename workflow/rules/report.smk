"""Figures and report: what one data set shows to people."""


rule draw_figures:
    """Draw every figure of one data set from its results."""
    input:
        unpack(provider.truth),
        unpack(provider.automatic_recipe.decisions),
        config=files.config,
        recording=files.recording,
        info=files.recording_info,
        prepared=files.prepared,
        transforms=files.transforms,
        spectrum=files.spectrum,
        spectrum_summary=files.spectrum_summary,
        phases=provider.order_search.selections,
        candidates=files.candidates,
        model=files.model,
        frequency_response=files.frequency_response,
        time_response=files.time_response,
        validation=files.validation,
        residual_autocorrelation=files.residual_autocorrelation,
        cross_correlation=files.cross_correlation,
        simulation=files.simulation,
        horizons=files.horizons,
    output:
        [
            report(
                files.figure(figure),
                caption=f"../report/figures/{figure}.rst",
                category="{dataset}",
                subcategory="Figures",
                labels={"figure": figure.replace("_", " ")},
            )
            for figure in FIGURES
        ],
    log:
        files.log("figures"),
    benchmark:
        files.benchmark("figures")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        code=code("draw_figures"),
    script:
        "../scripts/draw_figures.py"


rule write_report:
    """Set the results and figures of one data set into one HTML file."""
    input:
        unpack(provider.automatic_recipe.decisions),
        unpack(provider.validation_recording(files.validation_recording_info)),
        **{**rules.draw_figures.input},
        figures=files.figures,
    output:
        report=report(
            files.report,
            caption="../report/report.rst",
            category="{dataset}",
            subcategory="Report",
            labels={"file": "report.html"},
        ),
    log:
        files.log("report"),
    benchmark:
        files.benchmark("report")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        code=code("write_report", *TEMPLATES),
    script:
        "../scripts/write_report.py"
