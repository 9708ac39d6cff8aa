"""A rule for each stage: what it reads, writes and depends on stands in `evopem.pipeline.planning.stages`."""

for own in provider.rules:

    rule:
        """Run one stage of one data set."""
        name:
            own.name
        input:
            recorded=recorded_files(own),
            results=own.inputs,
        output:
            [shown(path) for path in own.outputs],
        log:
            own.log,
        benchmark:
            own.benchmark
        wildcard_constraints:
            dataset=own.datasets,
        priority: own.priority
        localrule: own.is_small
        conda:
            "../envs/evopem.yaml"
        threads: estimation_cores if own.any_stage.is_part else 1
        resources:
            mem_mb=own.memory,
            runtime=own.time,
        params:
            function=own.function,
            arguments=own.arguments,
            code=code_of(own, pages_of(own.name)),
        script:
            "../scripts/run_stage.py"
