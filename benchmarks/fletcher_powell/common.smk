"""The settings of the comparison, and the functions with which the rules read them."""

import os
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

BENCHMARK = Path(str(workflow.current_basedir))
PRODUCT = BENCHMARK.parents[1] / "workflow"
SCRIPTS = BENCHMARK / "scripts"
for folder in (PRODUCT / "scripts", SCRIPTS):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from evopem.config.configuration import blas_code
from evopem.config.rule_digest import code_version
from evopem.errors import InputError
from evopem.files.json_form import to_json
from fletcher_powell import experiments
from fletcher_powell.packages import check_packages
from fletcher_powell.settings import read_settings

# Jobs inherit it.
for name, value in blas_code().items():
    os.environ.setdefault(name, value)

try:
    SETTINGS = read_settings("fletcher_powell.yaml")
except InputError as error:
    raise WorkflowError(str(error)) from None

RESULTS = "results/fletcher_powell"
TABLES = {
    name: f"{RESULTS}/{name}.csv"
    for name in ("table", "runs", "convergence", "landscape", "minima")
}
FIGURES = [f"{RESULTS}/figures/{figure}.svg" for figure in experiments.FIGURES]
TEMPLATES = sorted(
    path
    for folder in (BENCHMARK / "templates", PRODUCT / "templates")
    for path in folder.rglob("*")
    if path.is_file()
)


def code(script, *templates):
    """Digest of a script and the code that it imports: a rule reruns when it changes."""
    return code_version(SCRIPTS / f"{script}.py", templates, [PRODUCT / "scripts"])


def run_files(wildcards):
    """Outputs of all jobs; ends Snakemake with a sentence if a package that they need is missing.

    With conda or containers the jobs have environments of their own, and say it themselves.
    """
    if not workflow.deployment_settings.deployment_method:
        try:
            check_packages(SETTINGS)
        except InputError as error:
            # An exception here would be printed with a traceback.
            sys.exit(str(error))
    return [f"{RESULTS}/runs/{file}" for file in experiments.run_files(SETTINGS)]


def cases(wildcards):
    """What one job runs."""
    part, block = wildcards.comparison_part, int(wildcards.block)
    return to_json(experiments.cases(part, wildcards.algorithm, block, SETTINGS))


wildcard_constraints:
    comparison_part="|".join(experiments.PARTS),
    algorithm="|".join(SETTINGS.algorithms),
    instance="|".join(experiments.instances(SETTINGS)),
    block=r"\d+",
