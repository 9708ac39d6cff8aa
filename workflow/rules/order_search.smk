"""Order search: the delay and the three phases, each cut into jobs of a few candidates."""


rule fit_candidates:
    """Fit every parts-th candidate of a phase; the grid starts at the choice of the one before."""
    input:
        unpack(earlier_choice),
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    output:
        candidates="results/{dataset}/phases/{phase}/part-{part}.json",
    log:
        "results/{dataset}/logs/phases/{phase}/part-{part}.log",
    benchmark:
        "results/{dataset}/benchmarks/phases/{phase}/part-{part}.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: fitting_cores
    resources:
        mem_mb=fitting_memory,
        runtime=fitting_time,
    params:
        grid=candidate_grid,
        parts=lambda wildcards: part_count(wildcards.dataset, wildcards.phase),
        scoring_start=lambda wildcards: grids.scoring_start(DATASETS[wildcards.dataset]),
        search=lambda wildcards: DATASETS[wildcards.dataset]["search"],
        code=code("fit_candidates"),
    script:
        "../scripts/fit_candidates.py"


rule select_candidate:
    """Collect the candidates of a phase, search again where in doubt, and choose one of them."""
    input:
        parts=parts_of,
        prepared="results/{dataset}/prepared.npz",
        transforms="results/{dataset}/transforms.json",
    output:
        phase="results/{dataset}/phases/{phase}.json",
    log:
        "results/{dataset}/logs/phases/{phase}.log",
    benchmark:
        "results/{dataset}/benchmarks/phases/{phase}.tsv"
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=fitting_memory,
        runtime=fitting_time,
    params:
        scoring_start=lambda wildcards: grids.scoring_start(DATASETS[wildcards.dataset]),
        search=lambda wildcards: DATASETS[wildcards.dataset]["search"],
        code=code("select_candidate"),
    script:
        "../scripts/select_candidate.py"
