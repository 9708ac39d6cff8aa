"""Automatic recipe: each decision is a file, from the preparation to the chosen model."""


rule decide_preparation:
    """Decide start, clipping, decimation and objective from the estimation samples alone."""
    input:
        unpack(provider.validation_recording(files.validation_recording)),
        recording=files.recording,
    output:
        plan=files.decision("preparation"),
    log:
        files.log("decisions/preparation"),
    benchmark:
        files.benchmark("decisions/preparation")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    priority: 10
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        preparation=provider.settings("preparation"),
        given=provider.automatic_recipe.given_preparation,
        recorded=provider.recorded_names,
        code=code("decide_preparation"),
    script:
        "../scripts/decide_preparation.py"


rule apply_preparation:
    """Prepare both parts of the recording as it was decided."""
    input:
        unpack(provider.validation_recording(files.validation_recording)),
        recording=files.recording,
        plan=files.decision("preparation"),
    output:
        prepared=files.prepared,
        transforms=files.transforms,
        stretches=files.stretches,
    log:
        files.log("preparation"),
    benchmark:
        files.benchmark("preparation")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        preparation=provider.settings("preparation"),
        code=code("apply_preparation"),
    script:
        "../scripts/apply_preparation.py"


rule decide_folds:
    """Decide how held-out samples are divided."""
    input:
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        folds=files.decision("folds"),
    log:
        files.log("decisions/folds"),
    benchmark:
        files.benchmark("decisions/folds")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        code=code("decide_folds"),
    script:
        "../scripts/decide_folds.py"


rule decide_delay:
    """Decide the delay from which structures are searched."""
    input:
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        delay=files.decision("delay"),
    log:
        files.log("decisions/delay"),
    benchmark:
        files.benchmark("decisions/delay")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        limits=provider.automatic_recipe.settings("nk"),
        code=code("decide_delay"),
    script:
        "../scripts/decide_delay.py"


rule search_structure:
    """Search the orders of one structure, from the optima of those nested in it."""
    input:
        provider.automatic_recipe.nested_searches,
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
        folds=files.decision("folds"),
        delay=files.decision("delay"),
    output:
        search=files.search("{structure}"),
    log:
        files.log("decisions/search/{structure}"),
    benchmark:
        files.benchmark("decisions/search/{structure}")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        limits=provider.automatic_recipe.settings("nk", "joint", "nc", "nd", "nb"),
        code=code("search_structure"),
    script:
        "../scripts/search_structure.py"


rule compare_structures:
    """Choose a structure and orders for each purpose."""
    input:
        searches=provider.automatic_recipe.wanted_searches,
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
        folds=files.decision("folds"),
    output:
        comparison=files.decision("comparison"),
        phase=files.phase(AUTOMATIC_PHASES[0]),
    log:
        files.log("decisions/comparison"),
    benchmark:
        files.benchmark("decisions/comparison")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        structures=provider.automatic_recipe.wanted_structures,
        settings=provider.automatic_recipe.settings(
            "purpose", "structure", "nk", "joint", "nc", "nd", "nb"
        ),
        code=code("compare_structures"),
    script:
        "../scripts/compare_structures.py"


rule act_on_checks:
    """Apply remedies to the chosen model until its checks hold or nothing helps."""
    input:
        comparison=files.decision("comparison"),
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
        folds=files.decision("folds"),
    output:
        remedies=files.decision("remedies"),
    log:
        files.log("decisions/remedies"),
    benchmark:
        files.benchmark("decisions/remedies")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        settings=provider.automatic_recipe.settings(
            "purpose", "structure", "nk", "joint", "nc", "nd", "nb"
        ),
        code=code("act_on_checks"),
    script:
        "../scripts/act_on_checks.py"


rule estimate_chosen:
    """Search the chosen structure and orders once more, globally."""
    input:
        remedies=files.decision("remedies"),
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        phase=files.phase(AUTOMATIC_PHASES[1]),
    log:
        files.log("phases/chosen"),
    benchmark:
        files.benchmark("phases/chosen")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        search=provider.settings("search"),
        code=code("estimate_chosen"),
    script:
        "../scripts/estimate_chosen.py"


rule complete_other_model:
    """Keep the model for another purpose than that of the configuration."""
    input:
        comparison=files.decision("comparison"),
        stretches=files.stretches,
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        model=files.other_model("{purpose}"),
        errors=files.other_errors("{purpose}"),
    log:
        files.log("decisions/models/{purpose}"),
    benchmark:
        files.benchmark("decisions/models/{purpose}")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
        purpose="simulation|prediction",
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.estimation_memory,
        runtime=provider.resources.estimation_time,
    params:
        search=provider.settings("search"),
        code=code("complete_other_model"),
    script:
        "../scripts/complete_other_model.py"


rule collect_decisions:
    """Put all decisions of a data set into one file."""
    input:
        searches=provider.automatic_recipe.searches,
        info=files.recording_info,
        stretches=files.stretches,
        prepared=files.prepared,
        transforms=files.transforms,
        plan=files.decision("preparation"),
        folds=files.decision("folds"),
        delay=files.decision("delay"),
        comparison=files.decision("comparison"),
        remedies=files.decision("remedies"),
        other=provider.automatic_recipe.other_errors,
    output:
        decisions=files.decisions,
    log:
        files.log("decisions/collection"),
    benchmark:
        files.benchmark("decisions/collection")
    wildcard_constraints:
        dataset=provider.one_of(provider.automatic),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        structures=provider.automatic_recipe.structures,
        other=provider.automatic_recipe.other_purpose,
        code=code("collect_decisions"),
    script:
        "../scripts/collect_decisions.py"
