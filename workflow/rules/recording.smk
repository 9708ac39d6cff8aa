"""One job a recording: every stage of a data set in one process, for fleets of recordings."""


def shown(result):
    """A result as Snakemake's own report holds it: the report of a data set and its figures."""
    pages = {files.figure(figure): figure for figure in FIGURES} | {files.report: None}
    if result not in pages:
        return result
    figure = pages[result]
    return report(
        result,
        caption=f"../report/figures/{figure}.rst" if figure else "../report/report.rst",
        category="{dataset}",
        subcategory="Figures" if figure else "Report",
        labels=(
            {"figure": figure.replace("_", " ")} if figure else {"file": "report.html"}
        ),
    )


# Recorded files and results of a data set depend on its source and structure, and the outputs of
# a rule may not: each kind of data sets has a rule of its own.
for kind in provider.kinds:

    rule:
        """Take one data set from its recording to its results."""
        name:
            f"identify_{kind.name}"
        input:
            *[unpack(recorded_files(key)) for key in kind.recorded],
        output:
            [shown(result) for result in kind.results],
        log:
            files.log("identification"),
        benchmark:
            files.benchmark("identification")
        wildcard_constraints:
            dataset=provider.one_of(kind.members),
        conda:
            "../envs/evopem.yaml"
        threads: estimation_cores
        resources:
            mem_mb=provider.resources.estimation_memory,
            runtime=provider.resources.estimation_time,
        params:
            settings=provider.settings(),
            with_report=provider.with_report,
            code=code(kind.script, *TEMPLATES),
        script:
            f"../scripts/{kind.script}.py"
