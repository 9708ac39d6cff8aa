"""Failed checks and processor time of both recipes on the same recordings, without figures.

    PYTHONPATH=workflow/scripts python benchmarks/recipe_cost.py --data ../shared/data

All stages of the workflow run in this process, one after the other, so that the time is that of the
computation and not of starting jobs.  Both recipes have the file, its channels and its rate; the
chapter's has no transforms and discards nothing, which its built-in settings would not survive on
these recordings.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from evopem.config.defaults import complete
from evopem.config.schema import schema_file
from evopem.config.settings import DatasetSettings
from evopem.pipeline.identification import identify_dataset
from evopem.results.dataset import read_dataset_results
from evopem.results.layout import DatasetFiles

CHAPTER = {
    "recipe": "chapter",
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}
ARM = {"synthesis": "flexible_arm", "seed": 1, "samples": 5000}


def datasets(data: Path) -> dict[str, tuple[dict[str, object], dict[str, object]]]:
    """Keys of the source, and keys of the chapter's recipe."""
    daisy = data / "daisy"
    channels = {"input": 1, "output": 2}
    robot = {"file": str(daisy / "robot_arm.dat"), **channels, "sampling_rate": 125}
    dryer = {"file": str(daisy / "dryer.dat"), **channels, "sampling_rate": 12.5}
    return {
        "arm": (ARM, {"recipe": "chapter"}),
        "robot": (robot, CHAPTER),
        "dryer": (dryer, CHAPTER),
    }


def measured(settings: DatasetSettings) -> tuple[float, list[str], float]:
    """Processor seconds, failed checks, and the simulation error in percent."""
    with tempfile.TemporaryDirectory() as folder:
        files = DatasetFiles(str(Path(folder) / "results" / settings.name))
        began = time.process_time()
        identify_dataset(files, settings, with_report=False)
        spent = time.process_time() - began
        results = read_dataset_results(files, settings)
        failed = [each.name for each in results.checks if each.passed is False]
        return spent, failed, results.validation.simulation_error_percent


def main() -> None:
    """Print a row for each recording and recipe."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the recordings")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    print("| recording | recipe | simulation, % | failed checks | CPU s |")
    print("|---|---|---|---|---|")
    for name, (source, keys) in datasets(arguments.data).items():
        if arguments.only not in name:
            continue
        for recipe, own in (("chapter", keys), ("auto", {})):
            config = complete({"datasets": {name: source | own}}, schema_file())
            settings = config.datasets[name]
            assert isinstance(settings, DatasetSettings)
            spent, failed, error = measured(settings)
            listed = ", ".join(failed) or "none"
            print(f"| {name} | {recipe} | {error:.2f} | {listed} | {spent:.0f} |", flush=True)


if __name__ == "__main__":
    main()
