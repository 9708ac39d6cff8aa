"""The checked configuration, and the functions with which rules read it."""

import os
import re
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

WORKFLOW = Path(str(workflow.current_basedir)).parent
SCRIPTS = WORKFLOW / "scripts"
sys.path.insert(0, str(SCRIPTS))

from evopem.config import order_grid, resources
from evopem.config.blas import blas_code
from evopem.config.defaults import complete
from evopem.config.rule_digest import code_version
from evopem.config.schema import check_yaml_files
from evopem.config.settings import RecordedSource
from evopem.errors import InputError
from evopem.files.json_form import to_json
from evopem.results.layout import FIGURES, OVERVIEW, PHASES, DatasetFiles

# Jobs inherit it.
for name, value in blas_code().items():
    os.environ.setdefault(name, value)

# A module is given its configuration by the project that uses it.
CONFIG_FILES = (
    ["config of the module"]
    if workflow.modifier.skip_configfile
    else ["config.yaml", *workflow.overwrite_configfiles]
)

try:
    check_yaml_files(CONFIG_FILES)
except InputError as error:
    raise WorkflowError(str(error)) from None


configfile: "config.yaml"


try:
    CONFIG = complete(
        config,
        WORKFLOW / "schemas" / "config.schema.yaml",
        source=" and ".join(map(str, CONFIG_FILES)),
    )
except InputError as error:
    raise WorkflowError(str(error)) from None

DATASETS, RUN = CONFIG.datasets, CONFIG.run
RECORDED = [
    name
    for name, dataset in DATASETS.items()
    if isinstance(dataset.source, RecordedSource)
]
VALIDATED = [name for name in RECORDED if DATASETS[name].source.validation_file]
SYNTHETIC = [name for name in DATASETS if name not in set(RECORDED)]
WITH_REPORT = RUN.report == "html"
# The file that each row of the list of all data sets links to.
PAGE = "report.html" if WITH_REPORT else "modes.csv"
# A shard lists no data sets, and one data set needs no list.
LISTS = [*OVERVIEW] if len(DATASETS) > 1 and not RUN.shard else []
TEMPLATES = sorted(
    path for path in (WORKFLOW / "templates").rglob("*") if path.is_file()
)
# The files of a data set, with the wildcard in their paths.
files = DatasetFiles.of_dataset("{dataset}")


def one_of(names):
    """A wildcard constraint that matches these names and no other data set's.

    A list of thousands would be tried for each of thousands of files: where it holds all data
    sets, the form of a name suffices.
    """
    if len(names) == len(DATASETS):
        return r"[A-Za-z0-9][A-Za-z0-9_.-]*"
    return "|".join(map(re.escape, names)) or "(?!)"


def settings(part=None):
    """A function that gives a rule a part of the settings of its data set, or all of them."""

    def provide(wildcards):
        provided = DATASETS[wildcards.dataset]
        for name in part.split(".") if part else []:
            provided = getattr(provided, name)
        return to_json(provided)

    return provide


def recorded_file(key):
    """A function that gives a rule the recorded file that a data set names under a key.

    A missing file is no input before its first reading: its job then says so in a sentence, and
    the other data sets go on, where Snakemake would stop them all. Later it stays an input, so
    that nothing made from it is lost.
    """

    def existing(wildcards):
        path = getattr(DATASETS[wildcards.dataset].source, key)
        own = DatasetFiles.of_dataset(wildcards.dataset)
        # It is the user's own: a module's prefix is for results.
        used = Path(own.recording).exists() or resources.is_file(path)
        return {"file": local(path)} if used else {}

    return existing


def validation_recording(file):
    """A function that gives a rule a file of the validation recording, where there is one."""

    def existing(wildcards):
        return {"validation_recording": file} if wildcards.dataset in VALIDATED else {}

    return existing


def truth(wildcards):
    """The truth behind a synthetic data set."""
    return {"truth": files.truth} if wildcards.dataset in SYNTHETIC else {}


def window(wildcards):
    """The samples on which the candidates of a data set are compared."""
    return to_json(order_grid.scoring_window(DATASETS[wildcards.dataset]))


def requirements(wildcards):
    """What a record must have for the largest candidate of its data set."""
    return to_json(order_grid.sample_requirements(DATASETS[wildcards.dataset]))


def phase_grid(wildcards):
    """The part of the order grid that a phase uses."""
    grid = DATASETS[wildcards.dataset].order_grid
    return to_json(order_grid.grid_of_phase(wildcards.phase, grid))


def part_count(wildcards):
    """The number of jobs of a phase."""
    grid = DATASETS[wildcards.dataset].order_grid
    return order_grid.part_count(wildcards.phase, grid, RUN.candidates_per_job)


def parts(wildcards):
    """The outputs of all jobs of a phase."""
    count = part_count(wildcards)
    return [files.part(wildcards.phase, part) for part in range(1, count + 1)]


def earlier_results(wildcards):
    """What a phase waits for: its predecessor's selection, and the spectrum where it counts."""
    previous = order_grid.previous_phase(wildcards.phase)
    grid = DATASETS[wildcards.dataset].order_grid
    inputs = {"previous": files.phase(previous)} if previous else {}
    if order_grid.needs_resonances(wildcards.phase, grid):
        inputs["spectrum"] = files.spectrum_summary
    return inputs


def estimation_cores(wildcards):
    """The cores that one job's candidates share: with `auto` all of them, over all data sets.

    On a cluster a profile's `set-threads` says how many a job asks for.
    """
    if RUN.candidates_per_job != "auto" or workflow.remote_exec:
        return 1
    try:
        return max(1, workflow.cores // len(DATASETS))
    except WorkflowError:
        return 1


def reading_memory(wildcards, attempt):
    return resources.reading_memory(DATASETS[wildcards.dataset], attempt)


def reading_time(wildcards, attempt):
    return resources.reading_time(DATASETS[wildcards.dataset], attempt)


def estimation_memory(wildcards, threads, attempt):
    return resources.estimation_memory(DATASETS[wildcards.dataset], threads, attempt)


def estimation_time(wildcards, threads, attempt):
    dataset, phase = DATASETS[wildcards.dataset], wildcards.get("phase")
    per_job = RUN.candidates_per_job
    return resources.estimation_time(dataset, phase, per_job, threads, attempt)


def code(script, *templates):
    """A digest of a script and of all code behind it: a rule reruns when it changes."""
    return code_version(SCRIPTS / f"{script}.py", templates)


def results_of(dataset):
    """The results of one data set."""
    own = DatasetFiles.of_dataset(dataset)
    truths = [own.truth] if dataset in SYNTHETIC else []
    return [*own.results, *(own.pages if WITH_REPORT else []), *truths]


wildcard_constraints:
    dataset=one_of(DATASETS),
    phase="|".join(PHASES),
    part=r"\d+",
