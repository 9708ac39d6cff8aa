"""The checked configuration, and the functions with which rules read it."""

import re
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

WORKFLOW = Path(str(workflow.current_basedir)).parent
SCRIPTS = WORKFLOW / "scripts"
sys.path.insert(0, str(SCRIPTS))

from evopem.configuration import experiments, grids
from evopem.configuration.checking import check_yaml_files
from evopem.configuration.code import code_version
from evopem.configuration.completion import complete
from evopem.errors import InputError

CONFIG_FILES = ["config.yaml", *workflow.overwrite_configfiles]

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
SYNTHETIC = [name for name in DATASETS if name not in RECORDED]

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


def one_of(names):
    """A wildcard constraint that takes these names and no other; none at all if there is none."""
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
        return {"file": path} if read_before or Path(path).exists() else {}

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
    dataset = DATASETS[wildcards.dataset]
    if wildcards.phase == "delay":
        return {"delay": dataset["delay"]}
    return {"orders": {wildcards.phase: dataset["orders"][wildcards.phase]}}


def earlier_choice(wildcards):
    """What a phase must wait for: its predecessor's choice, and the peaks where they count."""
    folder = f"results/{wildcards.dataset}"
    inputs = {}
    if wildcards.phase != grids.PHASES[0]:
        previous = grids.previous_phase(wildcards.phase)
        inputs["previous"] = f"{folder}/phases/{previous}.json"
    if candidate_grid(wildcards) == {"orders": {"common": "auto"}}:
        inputs["spectrum"] = f"{folder}/spectrum.json"
    return inputs


def truth_of(wildcards):
    """The truth behind a synthetic data set."""
    if wildcards.dataset in SYNTHETIC:
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


def results_of(dataset):
    """The files of one data set that are there to be used."""
    names = [
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
        "report.html",
        *(f"figures/{figure}.svg" for figure in FIGURES),
    ]
    if dataset in SYNTHETIC:
        names.append("truth.json")
    return [f"results/{dataset}/{name}" for name in names]


wildcard_constraints:
    dataset=one_of(DATASETS),
    phase=one_of(grids.PHASES),
    part=r"\d+",
    comparison_part=one_of(experiments.PARTS),
    algorithm=one_of(sorted({*experiments.IN_TABLE, *experiments.AT_LARGEST})),
    instance=one_of(experiments.instances(COMPARISON)),
    block=r"\d+",
