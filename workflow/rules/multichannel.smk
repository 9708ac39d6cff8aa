"""Several channels: a state-space model, each decision a file, from the recording to the report."""


rule read_channels:
    """Read the input and output channels of a recorded file."""
    input:
        unpack(recorded_files("file")),
    output:
        recording=files.recording,
        info=files.recording_info,
    log:
        files.log("recording"),
    benchmark:
        files.benchmark("recording")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    priority: 10  # what cannot be read is said before any search begins
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        recorded=provider.settings("source.files"),
        channels=provider.settings("source.channels"),
        geometry=provider.settings("geometry"),
        code=code("read_channels"),
    script:
        "../scripts/read_channels.py"


use rule read_channels as read_validation_channels with:
    input:
        unpack(recorded_files("validation_file")),
    output:
        recording=files.validation_recording,
        info=files.validation_recording_info,
    log:
        files.log("validation_recording"),
    benchmark:
        files.benchmark("validation_recording")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel & provider.validated),
    params:
        recorded=provider.settings("source.validation_files"),
        channels=provider.settings("source.channels"),
        geometry=provider.settings("geometry"),
        code=code("read_channels"),


rule write_channels_configuration:
    """Keep the complete configuration of a data set beside its results."""
    output:
        config=files.config,
    log:
        files.log("configuration"),
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    localrule: True
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        settings=provider.settings(),
        code=code("write_channels_configuration"),
    script:
        "../scripts/write_channels_configuration.py"


rule prepare_channels:
    """Decide start and decimation from the estimation samples, and prepare both parts."""
    input:
        unpack(provider.validation_recording(files.validation_recording)),
        recording=files.recording,
    output:
        plan=files.decision("preparation"),
        prepared=files.prepared,
        transforms=files.transforms,
    log:
        files.log("preparation"),
    benchmark:
        files.benchmark("preparation")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    priority: 10
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.state_space_memory,
        runtime=provider.resources.state_space_time,
    params:
        source=provider.settings("source"),
        split=provider.settings("split"),
        resample=provider.settings("resample"),
        given=provider.several_channels.start_and_rate_given,
        code=code("prepare_channels"),
    script:
        "../scripts/prepare_channels.py"


rule decide_input_delays:
    """Decide the delay of each input."""
    input:
        prepared=files.prepared,
        transforms=files.transforms,
    output:
        delays=files.decision("delays"),
    log:
        files.log("decisions/delays"),
    benchmark:
        files.benchmark("decisions/delays")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.state_space_memory,
        runtime=provider.resources.reading_time,
    params:
        ranges=provider.settings("choices.orders.nk"),
        code=code("decide_input_delays"),
    script:
        "../scripts/decide_input_delays.py"


rule search_state_space:
    """Estimate all orders of a form with a weighting, and score them on held-out samples."""
    input:
        prepared=files.prepared,
        transforms=files.transforms,
        delays=files.decision("delays"),
    output:
        search=files.search("{variant}"),
        models=files.models_of_orders("{variant}"),
    log:
        files.log("decisions/search/{variant}"),
    benchmark:
        files.benchmark("decisions/search/{variant}")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
        variant="|".join(sorted(provider.variants)) or "(?!)",
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.state_space_memory,
        runtime=provider.resources.state_space_time,
    params:
        ranges=provider.several_channels.order_ranges,
        search=provider.settings("search"),
        code=code("search_state_space"),
    script:
        "../scripts/search_state_space.py"


rule choose_state_space:
    """Choose form, weighting and order by the errors on held-out samples."""
    input:
        searches=provider.several_channels.variant_searches,
    output:
        comparison=files.decision("comparison"),
    log:
        files.log("decisions/comparison"),
    benchmark:
        files.benchmark("decisions/comparison")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        variants=provider.several_channels.searched_variants,
        choices=provider.settings("choices"),
        code=code("choose_state_space"),
    script:
        "../scripts/choose_state_space.py"


rule estimate_state_space:
    """Search the chosen model globally, add its noise model, and write what follows from it."""
    input:
        prepared=files.prepared,
        transforms=files.transforms,
        delays=files.decision("delays"),
        comparison=files.decision("comparison"),
        orders=provider.several_channels.models_of_orders,
        searches=provider.several_channels.variant_searches,
    output:
        candidates=report(
            files.candidates,
            caption="../report/candidates.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "candidates"},
        ),
        model=report(
            files.model,
            caption="../report/state_space_model.rst",
            category="{dataset}",
            subcategory="Model",
            labels={"file": "model.json"},
        ),
        remedies=files.decision("remedies"),
        matlab=files.model_mat,
        frequency_response=files.frequency_response,
    log:
        files.log("model"),
    benchmark:
        files.benchmark("model")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.state_space_memory,
        runtime=provider.resources.state_space_time,
    params:
        variants=provider.several_channels.searched_variants,
        ranges=provider.settings("choices.orders"),
        search=provider.settings("search"),
        constraints=provider.settings("constraints"),
        code=code("estimate_state_space"),
    script:
        "../scripts/estimate_state_space.py"


rule complete_other_state_space:
    """Keep the model for another purpose than that of the configuration."""
    input:
        prepared=files.prepared,
        transforms=files.transforms,
        delays=files.decision("delays"),
        comparison=files.decision("comparison"),
        orders=provider.several_channels.models_of_orders,
    output:
        model=files.other_model("{purpose}"),
        errors=files.other_errors("{purpose}"),
    log:
        files.log("decisions/models/{purpose}"),
    benchmark:
        files.benchmark("decisions/models/{purpose}")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
        purpose="simulation|prediction",
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.state_space_memory,
        runtime=provider.resources.state_space_time,
    params:
        ranges=provider.settings("choices.orders"),
        search=provider.settings("search"),
        constraints=provider.settings("constraints"),
        code=code("complete_other_state_space"),
    script:
        "../scripts/complete_other_state_space.py"


rule validate_state_space:
    """Validate the model and its modes on samples that no choice has seen."""
    input:
        orders=provider.several_channels.models_of_orders,
        remedies=files.decision("remedies"),
        prepared=files.prepared,
        transforms=files.transforms,
        model=files.model,
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
        modes=report(
            files.modes,
            caption="../report/shapes.rst",
            category="{dataset}",
            subcategory="Tables",
            labels={"table": "modes"},
        ),
        modes_json=files.modes_json,
    log:
        files.log("validation"),
    benchmark:
        files.benchmark("validation")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        code=code("validate_state_space"),
    script:
        "../scripts/validate_state_space.py"


rule collect_state_space_decisions:
    """Put all decisions of a data set into one file."""
    input:
        plan=files.decision("preparation"),
        delays=files.decision("delays"),
        comparison=files.decision("comparison"),
        remedies=files.decision("remedies"),
        other=provider.several_channels.other_state_space,
    output:
        decisions=files.decisions,
    log:
        files.log("decisions/collection"),
    benchmark:
        files.benchmark("decisions/collection")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    localrule: True
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code("collect_state_space_decisions"),
    script:
        "../scripts/collect_state_space_decisions.py"


rule summarize_state_space:
    """Put order, errors, modes and checks of one data set into one small file."""
    input:
        searches=provider.several_channels.variant_searches,
        remedies=files.decision("remedies"),
        info=files.recording_info,
        model=files.model,
        modes=files.modes_json,
        validation=files.validation,
    output:
        summary=files.summary,
    log:
        files.log("summary"),
    benchmark:
        files.benchmark("summary")
    wildcard_constraints:
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code("summarize_state_space"),
    script:
        "../scripts/summarize_state_space.py"


rule write_state_space_report:
    """Set the results of one data set into one HTML file."""
    input:
        searches=provider.several_channels.variant_searches,
        config=files.config,
        info=files.recording_info,
        prepared=files.prepared,
        transforms=files.transforms,
        comparison=files.decision("comparison"),
        remedies=files.decision("remedies"),
        decisions=files.decisions,
        model=files.model,
        modes=files.modes_json,
        frequency_response=files.frequency_response,
        validation=files.validation,
        simulation=files.simulation,
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
        dataset=provider.one_of(provider.multichannel),
    conda:
        "../envs/evopem.yaml"
    threads: 1
    resources:
        mem_mb=provider.resources.reading_memory,
        runtime=provider.resources.reading_time,
    params:
        settings=provider.settings(),
        variants=provider.several_channels.searched_variants,
        code=code("write_state_space_report", *TEMPLATES),
    script:
        "../scripts/write_state_space_report.py"
