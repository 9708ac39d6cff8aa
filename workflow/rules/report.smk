"""Report: one self-contained HTML file for each data set."""


rule write_report:
    """Set the results and figures of one data set into one HTML file."""
    input:
        unpack(truth_of),
        unpack(validation_record_of),
        config="results/{dataset}/config.yaml",
        origin="results/{dataset}/recording.json",
        recording="results/{dataset}/recording.npz",
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
        spectrum="results/{dataset}/spectrum.csv",
        peaks="results/{dataset}/spectrum.json",
        candidates="results/{dataset}/candidates.csv",
        phases=expand("results/{{dataset}}/phases/{phase}.json", phase=grids.PHASES),
        model="results/{dataset}/model.json",
        frequency_response="results/{dataset}/frequency_response.csv",
        validation="results/{dataset}/validation.json",
        residual_autocorrelation="results/{dataset}/residual_autocorrelation.csv",
        cross_correlation="results/{dataset}/cross_correlation.csv",
        simulation="results/{dataset}/simulation.csv",
        figures=[f"results/{{dataset}}/figures/{figure}.svg" for figure in FIGURES],
    output:
        report=report(
            "results/{dataset}/report.html",
            caption="../report/report.rst",
            category="{dataset}",
            subcategory="Report",
            labels={"file": "report.html"},
        ),
    log:
        "results/{dataset}/logs/report.log",
    benchmark:
        "results/{dataset}/benchmarks/report.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        code=code("write_report", *TEMPLATES),
    script:
        "../scripts/write_report.py"


rule summarize_data_set:
    """Put the modes, errors and checks of one data set into one small file."""
    input:
        origin="results/{dataset}/recording.json",
        transforms="results/{dataset}/transforms.json",
        peaks="results/{dataset}/spectrum.json",
        candidates="results/{dataset}/candidates.csv",
        model="results/{dataset}/model.json",
        validation="results/{dataset}/validation.json",
    output:
        summary="results/{dataset}/summary.json",
    log:
        "results/{dataset}/logs/summary.log",
    benchmark:
        "results/{dataset}/benchmarks/summary.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code("summarize_data_set"),
    script:
        "../scripts/summarize_data_set.py"
