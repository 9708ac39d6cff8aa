"""One job a recording: every stage of a data set in one process, for fleets of recordings."""

# The outputs of a rule may not depend on the data set: results that differ have a rule each.
for own in provider.recording_rules:

    rule:
        """Take one data set from its recording to its results."""
        name:
            own.name
        input:
            recorded=recorded_files(own),
        output:
            [shown(path) for path in own.outputs],
        log:
            files.log("identification"),
        benchmark:
            files.benchmark("identification")
        wildcard_constraints:
            dataset=own.datasets,
        conda:
            "../envs/evopem.yaml"
        threads: estimation_cores
        resources:
            mem_mb=own.memory,
            runtime=own.time,
        params:
            function=IDENTIFY,
            arguments=own.arguments,
            code=code_of(own, TEMPLATES),
        script:
            "../scripts/run_stage.py"
