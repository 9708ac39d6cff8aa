"""Order search: the delay and the phases of the orders, each divided into jobs of a few candidates."""


rule estimate_candidates:
    """Estimate every parts-th candidate of a phase, from its predecessor's selection on."""
    input:
        unpack(provider.order_search.earlier_results),
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        candidates=files.part("{phase}", "{part}"),
    log:
        files.log("phases/{phase}/part-{part}"),
    benchmark:
        files.benchmark("phases/{phase}/part-{part}")
    wildcard_constraints:
        dataset=provider.one_of(provider.by_chapter),
    conda:
        "../envs/evopem.yaml"
    threads: estimation_cores
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        grid=provider.order_search.phase_grid,
        parts=provider.order_search.part_count,
        window=provider.order_search.window,
        search=provider.settings("search"),
        code=code("estimate_candidates"),
    script:
        "../scripts/estimate_candidates.py"


rule select_candidate:
    """Collect the candidates of a phase, repeat doubtful searches, and select one candidate."""
    input:
        parts=provider.order_search.parts,
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        phase=files.phase("{phase}"),
    log:
        files.log("phases/{phase}"),
    benchmark:
        files.benchmark("phases/{phase}")
    wildcard_constraints:
        dataset=provider.one_of(provider.by_chapter),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        grid=provider.order_search.selection_grid,
        parts=provider.order_search.part_count,
        window=provider.order_search.window,
        search=provider.settings("search"),
        code=code("select_candidate"),
    script:
        "../scripts/select_candidate.py"
