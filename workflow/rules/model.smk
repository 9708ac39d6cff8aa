"""Model: the selected candidate as a complete model, and every candidate in one table."""


rule complete_model:
    """Give the selected candidate its covariance, modes and responses, after its focus and constraints."""
    input:
        unpack(provider.automatic_recipe.chosen),
        phase=provider.order_search.last_selection,
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        model=report(
            files.model,
            caption="../report/model.rst",
            category="{dataset}",
            subcategory="Model",
            labels={"file": "model.json"},
        ),
        matlab=files.model_mat,
        modes=report(
            files.modes,
            caption="../report/modes.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "modes"},
        ),
        frequency_response=files.frequency_response,
        time_response=files.time_response,
    log:
        files.log("model"),
    benchmark:
        files.benchmark("model")
    wildcard_constraints:
        dataset=provider.one_of(provider.single_channel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.model_memory,
        runtime=provider.resources.model_time,
    params:
        window=provider.order_search.window,
        search=provider.settings("search"),
        phases=provider.order_search.phases,
        fit=provider.settings("fit"),
        code=code("complete_model"),
    script:
        "../scripts/complete_model.py"


rule tabulate_candidates:
    """List every candidate of every phase in one table."""
    input:
        phases=provider.order_search.selections,
    output:
        candidates=report(
            files.candidates,
            caption="../report/candidates.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "candidates"},
        ),
    log:
        files.log("candidates"),
    benchmark:
        files.benchmark("candidates")
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
        phases=provider.order_search.phases,
        code=code("tabulate_candidates"),
    script:
        "../scripts/tabulate_candidates.py"
