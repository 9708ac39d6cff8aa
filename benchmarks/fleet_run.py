"""The processor time of a fleet, and what of it is not the search: the check of docs/planning.md.

    python benchmarks/fleet_run.py FOLDER RECORDINGS [PER_JOB] [CORES]

identifies so many synthetic recordings with the built-in grids of the chapter, several a job, and
runs the stages of a few of them again in this process to see what the searches take. Prints both,
the wall clock, the share of the rest, and the files and bytes of a recording. A folder with results
is continued, and what it finds finished is not counted.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from evopem.config.defaults import complete
from evopem.config.schema import schema_file
from evopem.config.settings import DatasetSettings
from evopem.config.structures import phases_of
from evopem.pipeline.identification import stages
from evopem.results.layout import DatasetFiles
from evopem.synthesis.armax import armax

ROOT = Path(__file__).parents[1]
SAMPLES = 2_000
AGAIN = 4
DEFAULTS = {
    "recipe": "chapter",
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}


def write_recordings(folder: Path, count: int, per_job: int | str) -> dict[str, object]:
    """Recordings of different systems, and the configuration that identifies them."""
    (folder / "data").mkdir(parents=True, exist_ok=True)
    for number in range(count):
        record, _ = armax(seed=number, samples=SAMPLES)
        columns = np.column_stack([record.input, record.output])
        np.savetxt(folder / "data" / f"{number:05d}.csv", columns, delimiter=",")
    config = {
        "one_job_per": "recording",
        "recordings_per_job": per_job,
        "report": "none",
        "defaults": DEFAULTS,
        "datasets": {"r*": {"file": "data/*.csv", "sampling_rate": 100}},
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return config


def seconds_of_stages(settings: DatasetSettings, folder: Path) -> tuple[float, float]:
    """Processor time of the searches and of all other stages of a recording."""
    searching = others = 0.0
    with tempfile.TemporaryDirectory() as results:
        listed = stages(DatasetFiles(f"{results}/{settings.name}"), settings, folder=folder)
        for name, stage in listed.items():
            if name in ("figures", "report"):
                continue
            began = time.process_time()
            stage()
            taken = time.process_time() - began
            if name in phases_of(settings.order_grid.structure):
                searching += taken
            else:
                others += taken
    return searching, others


def main() -> None:
    folder, count = Path(sys.argv[1]).resolve(), int(sys.argv[2])
    per_job = sys.argv[3] if len(sys.argv) > 3 else "auto"
    cores = sys.argv[4] if len(sys.argv) > 4 else "2"
    config = write_recordings(folder, count, per_job if per_job == "auto" else int(per_job))
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    began = time.monotonic()
    run = subprocess.Popen([*command, "--cores", cores, "--quiet", "all"], cwd=folder)
    _, status, used = os.wait4(run.pid, 0)
    wall, total = time.monotonic() - began, used.ru_utime + used.ru_stime
    assert status == 0, "the run failed"
    print(f"{count} recordings of {SAMPLES} samples on {cores} cores: {wall:.0f} s wall clock,")
    print(f"{total:.0f} s of processor time, {total / count:.2f} s a recording.", flush=True)
    os.chdir(folder)
    names = list(complete(config, schema_file()).datasets.values())
    seconds_of_stages(names[0], folder)  # loads what the jobs have loaded
    taken = np.array([seconds_of_stages(each, folder) for each in names[:: count // AGAIN]])
    searching, others = taken.mean(axis=0)
    rest = total / count - searching
    print(f"In one process the searches take {searching:.2f} s, all other stages {others:.2f} s;")
    print(f"beside the searches {rest:.2f} s a recording, {100 * rest * count / total:.0f} %.")
    files = [file for file in (folder / "results" / "r00000").rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    print(f"A recording's results: {size / 1e6:.2f} MB in {len(files)} files.")


if __name__ == "__main__":
    main()
