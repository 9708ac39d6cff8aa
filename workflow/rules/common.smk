"""The checked configuration, and the functions with which rules read it."""

import importlib.util
import os
import re
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.io import IOFile

SCRIPTS = Path(str(workflow.current_basedir)).parent / "scripts"
IN_CHECKOUT = SCRIPTS.is_dir()
if IN_CHECKOUT:
    sys.path.insert(0, str(SCRIPTS))
elif importlib.util.find_spec("evopem") is None:
    sys.exit(
        f"{workflow.current_basedir}: this workflow is used from a repository, and its package evopem"
        " is not installed; install the same version of it beside Snakemake"
        " (pip install 'evopem[workflow]'), or use a checkout."
    )

from evopem.config.defaults import complete
from evopem.config.configuration import check_environment, job_environment
from evopem.config.rule_digest import code_version
from evopem.config.schema import schema_file
from evopem.config.strict_yaml import check_yaml_files
from evopem.errors import InputError
from evopem.files.checksums import changed_results
from evopem.files.job import interrupt_on_hangup
from evopem.files.json_form import to_json
from evopem.pipeline.planning.constraint_plan import check_planned_fits
from evopem.pipeline.planning.provider import FILES, LIST, Provider, modules_of
from evopem.pipeline.planning.stages import WHOLE
from evopem.pipeline.planning.stage import module_of
from evopem.config.structures import PHASES, STATE_SPACE_FORMS
from evopem.results.layout import BATCH, BATCH_CHECKSUMS, DAMAGE, FOLDER
from evopem.results.layout import OVERVIEW, SETUPS
from evopem.results.layout import DatasetFiles, check_folders, lists_of
from evopem.results.identity import forget_incomplete_batches
from evopem.results.identity import mark_replaced_recordings
from evopem.version import __version__

os.environ.update(job_environment(os.environ, Path.cwd()))

# A module is given its configuration by the project that uses it.
CONFIG_FILES = (
    ["config of the module"]
    if workflow.modifier.skip_configfile
    else ["config.yaml", *workflow.overwrite_configfiles]
)

if CONFIG_FILES == ["config.yaml"] and not Path("config.yaml").exists():
    sys.exit(
        f"{Path.cwd()}: there is no config.yaml in this folder; write one by `evopem init`, or name"
        " another folder with --directory."
    )

try:
    check_environment(os.environ)
    check_yaml_files(CONFIG_FILES)
except InputError as error:
    # A WorkflowError would add the line of this file to the sentence.
    sys.exit(str(error))


configfile: "config.yaml"


try:
    provider = Provider(
        complete(
            config,
            source=" and ".join(map(str, CONFIG_FILES)),
        )
    )
    check_folders(
        [
            FOLDER,
            *(
                DatasetFiles.of_dataset(each).folder
                for each in provider.config.datasets
            ),
        ]
    )
    check_planned_fits(provider.config.datasets, " and ".join(map(str, CONFIG_FILES)))
except InputError as error:
    sys.exit(str(error))

# Of a call that only packs Snakemake's own report, which ends at the first file that is not there.
OPTIONS = {argument.partition("=")[0] for argument in sys.argv}
if "--report" in OPTIONS and "--report-after-run" not in OPTIONS:
    provider = provider.with_whole_results()

# Jobs parse this file as well, while the results of other jobs change.
if workflow.is_main_process:
    interrupt_on_hangup()
    if provider.config.batches:
        forget_incomplete_batches(provider.config.batches, provider.config.datasets)
    else:
        mark_replaced_recordings(provider.config.datasets)

# Beside the schema: in a checkout below `workflow`, else in the installed package.
TEMPLATE_FOLDER = schema_file().parents[1] / "templates"
TEMPLATES = sorted(path for path in TEMPLATE_FOLDER.rglob("*") if path.is_file())


def recorded_files(rule):
    """The recorded files of a job: the user's own, which no module's prefix applies to."""

    def existing(wildcards):
        return list(map(local, rule.recorded(wildcards)))

    return existing


def figure_caption(figure):
    """What a figure of a model with an input shows, as its page says it, in Snakemake's report."""
    if not OPTIONS & {"--report", "--report-after-run"}:
        return ""
    from jinja2 import ChainableUndefined, Environment

    environment = Environment(
        undefined=ChainableUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = (TEMPLATE_FOLDER / "captions.html.j2").read_text(encoding="utf-8")
    macro = getattr(environment.from_string(text).module, figure)
    return str(macro({"model": {"has_input": True}})).strip().partition("\n")[2]


def shown(path):
    """A result as Snakemake's own report holds it, where it does."""
    name = path.rpartition("/")[2]
    if "/figures/" in path:
        stem = name.removesuffix(".svg")
        caption, group = "figure", "Figures"
        labels = {"figure": stem.replace("_", " "), "shows": figure_caption(stem)}
    elif name in SHOWN:
        caption, group = SHOWN[name]
        labels = {"file": name}
    else:
        return path
    return report(
        path,
        caption=f"../report/{caption}.rst",
        category="{dataset}",
        subcategory=group,
        labels=labels,
    )


SHOWN = {
    "report.html": ("report", "Report"),
    "model.json": ("model", "Model"),
    "validation.json": ("validation", "Model"),
    "modes.csv": ("modes", "Tables"),
    "candidates.csv": ("candidates", "Tables"),
    "spectrum.csv": ("spectrum", "Tables"),
}


def estimation_cores(wildcards):
    """The cores that one job's candidates share: with `auto` all of them, over all data sets.

    On a cluster a profile's `set-threads` says how many a job asks for.
    """
    if provider.config.run.candidates_per_job != "auto" or workflow.remote_exec:
        return 1
    try:
        jobs = provider.config.batches or provider.config.datasets
        return max(1, workflow.cores // len(jobs))
    except WorkflowError:
        return 1


def code(modules, templates=(), script="run_stage"):
    """A digest of a script, of modules and of all code behind them: a rule reruns when it changes.

    Of an installed package it is the version.
    """
    if not IN_CHECKOUT:
        return __version__
    return code_version(SCRIPTS / f"{script}.py", templates, modules=modules)


def code_of(rule):
    """The digest of the code and templates behind a job, which may depend on its data set."""
    digests = {}
    templates = TEMPLATES if rule.stage.is_page or rule.stage is WHOLE else ()

    def digest(wildcards):
        modules = tuple(rule.modules(wildcards))
        if modules not in digests:
            digests[modules] = code(modules, templates)
        return digests[modules]

    return digest


BATCH_CODE = (
    code(
        modules_of(provider.config.datasets.values(), with_report=False),
        script="identify_batch",
    )
    if provider.config.batches
    else ""
)


def schedule_when_jobs_end():
    """Before the first job of a local run, look for the next jobs when one has ended, and then only.

    To start at most 100 jobs a second, Snakemake would look at the recorded files of all waiting
    jobs each second: with a thousand recordings that takes a seventh of a core.
    """
    limiter = workflow.scheduler.job_rate_limiter
    if (
        workflow.local_exec
        and limiter
        and (limiter.max_jobs, limiter.timespan) == (100, 1)
    ):
        workflow.scheduler.job_rate_limiter = None


def mark_unfinished():
    """Before the first job, list the data sets with jobs to run as unfinished.

    A run that is killed cannot correct the lists any more.
    """
    exist = any(map(os.path.exists, provider.lists))
    if exist and left_of(workflow.dag.needrun_jobs()):
        collect_unfinished()


def list_other_targets():
    """List the data sets again after a run that had jobs of them but did not make the lists."""
    jobs = list(workflow.dag.needrun_jobs(exclude_finished=False))
    if datasets_of(jobs) and not any(OVERVIEW[0] in job.output for job in jobs):
        collect_unfinished()


def datasets_of(jobs):
    """The names of the data sets that jobs belong to."""
    names = {getattr(job.wildcards, "dataset", None) for job in jobs}
    batches = batches_of(jobs)
    names.update(name for batch in batches for name in provider.config.batches[batch])
    return names & provider.config.datasets.keys()


def batches_of(jobs):
    """The batches that jobs belong to."""
    batches = {getattr(job.wildcards, "batch", None) for job in jobs}
    return batches & provider.config.batches.keys()


def changed_in(datasets):
    """The results of data sets that were edited or damaged after they were written, in a text."""
    folders = [DatasetFiles.of_dataset(name).folder for name in datasets]
    return " ".join(path for folder in folders for path in changed_results(folder))


def left_of(jobs):
    """The names of the data sets that jobs have left to do: of a batch, its unfinished ones."""
    jobs = list(jobs)
    if not provider.config.batches:
        return datasets_of(jobs)
    return provider.unfinished(batches_of(jobs), BATCH_CODE)


def collect_unfinished():
    """List all data sets while results are missing; the next run makes the lists again."""
    from evopem.pipeline.report import collect_unfinished as list_unfinished

    if workflow.touch or not provider.lists:
        return
    left = left_of(workflow.dag.needrun_jobs())
    required = {name: provider.results(name) for name in provider.config.datasets}
    list_unfinished(required, provider.page, left, provider.config.following)
    # Older than all results and without Snakemake's record of their inputs, they are made again
    # even if the contents of these inputs stay the same. (Snakemake ignores a time of 0, and its
    # report packs nothing from before 1980.)
    for file in filter(os.path.exists, provider.lists):
        os.utime(file, (320_000_000, 320_000_000))
        workflow.persistence.cleanup_metadata(IOFile(file))


wildcard_constraints:
    dataset=provider.one_of(provider.config.datasets),
    phase="|".join(PHASES),
    structure="|".join(STATE_SPACE_FORMS),
    part=r"\d+",
