"""A rule for each stage, or for all stages of a data set in one process.

What a stage reads, writes and depends on stands in `evopem.pipeline.planning.stages`.
"""

for own in provider.rules:

    rule:
        """Run one stage, or all stages, of one data set."""
        name:
            own.name
        input:
            recorded=recorded_files(own),
            results=own.inputs,
        output:
            [shown(path) for path in own.outputs],
        log:
            FILES.log(own.stage.job),
        benchmark:
            FILES.benchmark(own.stage.job)
        wildcard_constraints:
            dataset=own.datasets,
        priority: own.priority
        conda:
            "../envs/evopem.yaml"
        threads: estimation_cores if own.is_parallel else 1
        resources:
            mem_mb=own.memory,
            runtime=own.time,
        params:
            function=own.stage.function,
            arguments=own.arguments,
            code=code_of(own),
        script:
            "../scripts/run_stage.py"
