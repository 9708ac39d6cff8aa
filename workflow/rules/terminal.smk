"""What a run shows: a line for each job while it works, and the results at its end.

A dry run shows what Snakemake shows. The log file of a run, and `--verbose`, keep every detail.
"""

import logging

from snakemake_interface_logger_plugins.common import LogEvent


class JobLine(logging.Formatter):
    """Snakemake's messages, with one line in place of a job's lists of files."""

    def __init__(self, default):
        super().__init__()
        self.default = default

    def format(self, record):
        if getattr(record, "event", None) is not LogEvent.JOB_INFO:
            return self.default.format(record)
        values = ", ".join((record.wildcards or {}).values())
        return f"Job {record.jobid}: {record.rule_name} {values}".rstrip()


def shorten_job_messages():
    """Show one line for each job on the terminal, where nothing else was asked for."""
    if workflow.output_settings.verbose or workflow.output_settings.printshellcmds:
        return
    for handler in logging.getLogger("snakemake.logging").handlers:
        if handler.name == "DefaultStreamHandler":
            handler.setFormatter(JobLine(handler.formatter))


def print_results():
    """Print what came out for the data sets that had jobs in this run."""
    if workflow.touch:
        return
    names = datasets_of(list(workflow.dag.needrun_jobs(exclude_finished=False)))
    if not names:
        return
    import pandas as pd
    from evopem.report.control_chart import damage_sentences
    from evopem.results.fleet import read_entry
    from evopem.report.results_text import run_text, show

    left = left_of(workflow.dag.needrun_jobs())
    entries = {
        name: read_entry(
            DatasetFiles.of_dataset(name), provider.results(name), pending=name in left
        )
        for name in provider.config.datasets
        if name in names
    }
    show(f"\n{run_text(entries, provider.page, provider.lists)}\n")
    if DAMAGE in provider.lists and os.path.exists(DAMAGE):
        table, limit = pd.read_csv(DAMAGE), provider.config.following.false_alarms
        show("\n".join(damage_sentences(table, limit)) + "\n")
    for page in filter(os.path.exists, expand(SETUPS, structure=provider.setups)):
        show(f"Merged set-ups: {page}\n")
