"""What a run shows: a line for each job, the time left, and the results at its end.

A dry run shows what Snakemake shows. The log file of a run, and `--verbose`, keep every detail.
"""

import logging
import time

from snakemake_interface_logger_plugins.common import LogEvent

from evopem.pipeline.planning.stages import left_in_words, seconds_left


class JobLine(logging.Formatter):
    """Snakemake's messages, a job's in one line and those of progress with the time left."""

    def __init__(self, default):
        super().__init__()
        self.default = default
        self.began = time.time()
        self.finished = set()

    def format(self, record):
        event, text = getattr(record, "event", None), self.default.format(record)
        if event is LogEvent.JOB_FINISHED:
            self.finished.add(record.job_id)
        if event is LogEvent.PROGRESS and record.done < record.total:
            jobs = list(workflow.dag.needrun_jobs(exclude_finished=False))
            done, left = (
                [job.rule.name for job in jobs if (job.jobid in self.finished) is ended]
                for ended in (True, False)
            )
            words = left_in_words(seconds_left(time.time() - self.began, done, left))
            return f"{text}{words and f', {words}'}"
        if event is not LogEvent.JOB_INFO:
            return text
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
    from evopem.report.index_page import damage_sentences
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
