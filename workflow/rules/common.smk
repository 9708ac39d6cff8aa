"""The checked configuration, and the functions with which rules read it."""

import os
import re
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

WORKFLOW = Path(str(workflow.current_basedir)).parent
SCRIPTS = WORKFLOW / "scripts"
sys.path.insert(0, str(SCRIPTS))

from evopem.config import order_grid as grids
from evopem.fletcher_powell import experiments
from evopem.config.schema import check_yaml_files
from evopem.config.rule_digest import code_version
from evopem.config.defaults import complete
from evopem.config.blas import blas_code
from evopem.errors import InputError

# Jobs inherit it.
for name, value in blas_code().items():
    os.environ.setdefault(name, value)

# A module is given its configuration by the project that uses it.
IS_MODULE = workflow.modifier.skip_configfile
CONFIG_FILES = (
    ["config of the module"]
    if IS_MODULE
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

DATASETS = CONFIG["datasets"]
COMPARISON = CONFIG["fletcher_powell"]
RECORDED = [name for name, dataset in DATASETS.items() if "file" in dataset]
VALIDATED = [name for name in RECORDED if DATASETS[name]["validation_file"]]
SYNTHETIC = [name for name, dataset in DATASETS.items() if "synthesis" in dataset]
# What lists all data sets: not for one of them, nor for a share.
OVERVIEW = (
    ["results/index.html", "results/fleet.csv", "results/fleet.parquet"]
    if len(DATASETS) > 1 and not CONFIG["share"]
    else []
)

TEMPLATES = sorted(
    path for path in (WORKFLOW / "templates").rglob("*") if path.is_file()
)
FIGURES = (
    "record",
    "spectrum",
    "delay",
    "phases",
    "poles_zeros",
    "frequency_response",
    "residuals",
    "simulation",
    "stabilization",
    "convergence",
)
RESULTS = (
    "config.yaml",
    "recording.json",
    "transforms.json",
    "spectrum.csv",
    "spectrum.json",
    "candidates.csv",
    "model.json",
    "model.mat",
    "modes.csv",
    "frequency_response.csv",
    "validation.json",
    "residual_autocorrelation.csv",
    "cross_correlation.csv",
    "simulation.csv",
    "summary.json",
)
# What each row of a list of all data sets leads to.
PAGE = "report.html" if CONFIG["report"] == "html" else "modes.csv"
PAGES = (
    ["report.html", *(f"figures/{figure}.svg" for figure in FIGURES)]
    if CONFIG["report"] == "html"
    else []
)


def one_of(names):
    """A wildcard constraint that takes these names and no other of the data sets.

    None if there is none, and a name's form alone where there are no others: a list of thousands
    would be tried for each of thousands of files.
    """
    if len(names) == len(DATASETS):
        return r"[A-Za-z0-9][A-Za-z0-9_.-]*"
    return "|".join(map(re.escape, names)) or "(?!)"


def recorded_file(key):
    """The recorded file that a data set names under a key.

    One that is missing is no input before its first reading: its job then says so in a sentence,
    and the other data sets go on, where Snakemake would stop them all. Later it stays an input, so
    that nothing made from it is lost.
    """

    def existing(wildcards):
        path = DATASETS[wildcards.dataset][key]
        read_before = Path(f"results/{wildcards.dataset}/recording.npz").exists()
        # It is the user's own: a module's prefix is for results.
        return {"file": local(path)} if read_before or Path(path).exists() else {}

    return existing


def channels_of(wildcards):
    """Which channels of a recorded file are read, and in which units."""
    keys = ("input", "output", "sampling_rate", "time", "input_unit", "output_unit")
    return {key: DATASETS[wildcards.dataset][key] for key in keys}


def synthesis_settings(wildcards):
    """What a synthetic record is made with.

    An ARMAX record is made non-stationary in the way that the data set's own preparation undoes.
    """
    dataset = DATASETS[wildcards.dataset]
    keys = ("seed", "samples", "sampling_rate", "noise")
    settings = {key: dataset[key] for key in keys if key in dataset}
    if dataset["synthesis"] == "armax":
        stationarity = dataset["stationarity"]
        known = not isinstance(stationarity["box_cox"], str)
        settings["box_cox"] = stationarity["box_cox"] if known else None
        settings["difference"] = stationarity["difference"]
    return settings


def recordings_of(wildcards):
    """The recording of a data set, and the independent one for validation if it has one."""
    folder = f"results/{wildcards.dataset}"
    inputs = {"recording": f"{folder}/recording.npz"}
    if DATASETS[wildcards.dataset].get("validation_file"):
        inputs["validation_recording"] = f"{folder}/validation_recording.npz"
    return inputs


def validation_record_of(wildcards):
    """Where the independent validation recording came from, if there is one."""
    if DATASETS[wildcards.dataset].get("validation_file"):
        folder = f"results/{wildcards.dataset}"
        return {"validation_recording": f"{folder}/validation_recording.json"}
    return {}


def fitting_cores(wildcards):
    """The cores that one job's candidates share: with `auto` all of them, over all data sets.

    On a cluster a profile's `set-threads` says how many a job asks for; a node that a job came to
    may have others.
    """
    if CONFIG["candidates_per_job"] != "auto" or workflow.remote_exec:
        return 1
    try:
        return max(1, workflow.cores // len(DATASETS))
    except WorkflowError:
        return 1


def record_size(wildcards):
    """Bytes of a data set's recordings, known before any job has run."""
    dataset = DATASETS[wildcards.dataset]
    if "samples" in dataset:
        return 16 * dataset["samples"]
    files = [dataset[key] for key in ("file", "validation_file") if dataset[key]]
    return sum(Path(file).stat().st_size for file in files if Path(file).is_file())


def light_memory(wildcards, attempt):
    """MB of a job that reads a record once, more at each attempt (docs/planning.md)."""
    return int(attempt * (800 + 40e-6 * record_size(wildcards)))


def light_time(wildcards, attempt):
    """Minutes of such a job."""
    return int(attempt * (5 + 0.25e-6 * record_size(wildcards)))


def most_samples(wildcards):
    """What a data set's recordings can hold at most; a sample has at least 8 bytes."""
    return DATASETS[wildcards.dataset].get("samples", record_size(wildcards) / 8)


def largest_fit(wildcards):
    """Samples times parameters of a data set's largest model."""
    parameters = grids.sample_needs(DATASETS[wildcards.dataset])["parameters"]
    return most_samples(wildcards) * parameters


def fitting_memory(wildcards, threads, attempt):
    """MB of Snakemake and of the processes that fit, more at each attempt (docs/planning.md)."""
    processes = threads + 1 if threads > 1 else 1
    # The least squares of many parameters work in stretches: long records need no more for them.
    each = min(
        250 + 80e-6 * largest_fit(wildcards), 400 + 400e-6 * most_samples(wildcards)
    )
    return int(attempt * (400 + processes * each))


def fitting_time(wildcards, threads, attempt):
    """Minutes of a job's fits, more at each attempt (docs/planning.md)."""
    dataset = DATASETS[wildcards.dataset]
    phases = [wildcards.phase] if "phase" in wildcards.keys() else grids.PHASES
    per_job = CONFIG["candidates_per_job"]
    count = sum(grids.candidates_in_part(each, dataset, per_job) for each in phases)
    evaluations = dataset["search"]["evaluations"]
    each = 2 + 2e-9 * evaluations * largest_fit(wildcards)
    return int(attempt * (10 + 3 * count * each / threads / 60))


def code(script, *templates):
    """A digest of a script and of all code behind it: a rule reruns when it changes."""
    return code_version(SCRIPTS / f"{script}.py", templates)


def parts_of(wildcards):
    """The outputs of all jobs of one phase."""
    parts = part_count(wildcards.dataset, wildcards.phase)
    folder = f"results/{wildcards.dataset}/phases/{wildcards.phase}"
    return [f"{folder}/part-{part}.json" for part in range(1, parts + 1)]


def part_count(dataset, phase):
    """The number of jobs of one phase."""
    return grids.part_count(phase, DATASETS[dataset], CONFIG["candidates_per_job"])


def candidate_grid(wildcards):
    """The part of the configuration that says which candidates a phase has."""
    return grids.part_for(wildcards.phase, DATASETS[wildcards.dataset])


def earlier_choice(wildcards):
    """What a phase must wait for: its predecessor's choice, and the peaks where they count."""
    folder = f"results/{wildcards.dataset}"
    inputs = {}
    if wildcards.phase != grids.PHASES[0]:
        previous = grids.previous_phase(wildcards.phase)
        inputs["previous"] = f"{folder}/phases/{previous}.json"
    if grids.needs_peaks(candidate_grid(wildcards)):
        inputs["spectrum"] = f"{folder}/spectrum.json"
    return inputs


def truth_of(wildcards):
    """The truth behind a synthetic data set."""
    if "synthesis" in DATASETS[wildcards.dataset]:
        return {"truth": f"results/{wildcards.dataset}/truth.json"}
    return {}


def comparison_runs(wildcards):
    """The outputs of all jobs of the comparison on the Fletcher-Powell function."""
    return [
        f"results/fletcher_powell/runs/{part}/{algorithm}/{instance}/{block}.json"
        for part in experiments.PARTS
        for algorithm in experiments.algorithms(part, COMPARISON)
        for instance in experiments.instances(COMPARISON)
        for block in range(1, experiments.block_count(part, algorithm, COMPARISON) + 1)
    ]


def comparison_cases(wildcards):
    """What one job of the comparison runs."""
    return experiments.cases(
        wildcards.comparison_part,
        wildcards.algorithm,
        int(wildcards.block),
        COMPARISON,
    )


def settings_of(wildcards):
    """Everything about a data set that its results depend on, for the one job that makes them."""
    dataset = DATASETS[wildcards.dataset]
    source = (
        {"channels": channels_of(wildcards)}
        if "file" in dataset
        else {"synthesis": synthesis_settings(wildcards)}
    )
    return source | {
        "dataset": dataset,
        "needs": grids.sample_needs(dataset),
        "scoring_start": grids.scoring_start(dataset),
        "grids": {phase: grids.part_for(phase, dataset) for phase in grids.PHASES},
    }


def results_of(dataset):
    """The files of one data set that are there to be used."""
    truth = ["truth.json"] if "synthesis" in DATASETS[dataset] else []
    names = [*RESULTS, *PAGES, *truth]
    return [f"results/{dataset}/{name}" for name in names]


def results_of_one_job(*others):
    """The files that one job makes of a recording, those on the way to its results among them."""
    phases = [f"phases/{phase}.json" for phase in grids.PHASES]
    names = ["recording.npz", "prepared.npz", *phases, *RESULTS, *PAGES, *others]
    return [f"results/{{dataset}}/{name}" for name in names]


def collect_unfinished():
    """List all data sets after a run in which some failed, and say what these said last.

    The lists are older than any result, so that the next run makes them again.
    """
    from collect_fleet import main

    if OVERVIEW and any(Path(f"results/{dataset}").is_dir() for dataset in DATASETS):
        main(DATASETS, WORKFLOW / "templates", PAGE, OVERVIEW)
        for file in OVERVIEW:
            os.utime(file, (0, 0))


wildcard_constraints:
    dataset=one_of(DATASETS),
    phase=one_of(grids.PHASES),
    part=r"\d+",
    comparison_part=one_of(experiments.PARTS),
    algorithm=one_of(sorted({*experiments.IN_TABLE, *experiments.AT_LARGEST})),
    instance=one_of(experiments.instances(COMPARISON)),
    block=r"\d+",
