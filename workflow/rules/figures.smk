"""Figures: one SVG file for each figure of the report."""


rule draw_figures:
    """Draw every figure of one data set from its results."""
    input:
        unpack(truth_of),
        recording="results/{dataset}/recording.npz",
        origin="results/{dataset}/recording.json",
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
        spectrum="results/{dataset}/spectrum.csv",
        peaks="results/{dataset}/spectrum.json",
        phases=expand("results/{{dataset}}/phases/{phase}.json", phase=grids.PHASES),
        candidates="results/{dataset}/candidates.csv",
        model="results/{dataset}/model.json",
        frequency_response="results/{dataset}/frequency_response.csv",
        validation="results/{dataset}/validation.json",
        residual_autocorrelation="results/{dataset}/residual_autocorrelation.csv",
        cross_correlation="results/{dataset}/cross_correlation.csv",
        simulation="results/{dataset}/simulation.csv",
    output:
        [
            report(
                f"results/{{dataset}}/figures/{figure}.svg",
                caption=f"../report/figures/{figure}.rst",
                category="{dataset}",
                subcategory="Figures",
                labels={"figure": figure.replace("_", " ")},
            )
            for figure in FIGURES
        ],
    log:
        "results/{dataset}/logs/figures.log",
    benchmark:
        "results/{dataset}/benchmarks/figures.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=light_memory,
        runtime=light_time,
    params:
        code=code("draw_figures"),
    script:
        "../scripts/draw_figures.py"
