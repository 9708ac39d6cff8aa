"""The processor time of a fleet, and what of it is not the search: the check of docs/fleets.md.

    python benchmarks/fleet_run.py FOLDER RECORDINGS [--per-job auto] [--cores 2] [--bad]
        [--recipe auto]

identifies so many synthetic recordings with the built-in grids of the chapter, several a job, or
by the automatic recipe from three keys, whose times docs/evidence/fleets.md is given, and
runs the stages of a few of them again in this process to see what the searches take. Prints both,
the wall clock, the share of the rest, the memory of Snakemake, and the files and bytes of a
recording. With ``--bad`` three recordings cannot be used. A folder with results is continued, and
what it finds finished is not counted.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
import yaml
from evidence import write_section

from evopem.config.defaults import complete
from evopem.config.settings import DatasetSettings
from evopem.pipeline.identification import jobs
from evopem.results.layout import DatasetFiles
from evopem.synthesis import armax

ROOT = Path(__file__).parents[1]
SAMPLES = 2_000
AGAIN = 12
DEFAULTS = {
    "recipe": "chapter",
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}


# What a recording is given, by recipe.
KEYS = {
    "chapter": {"file": "data/*.csv", "sampling_rate": 100},
    "auto": {"file": "data/*.csv", "input": 1, "output": 2, "sampling_rate": 100},
}
SEARCHES = (
    *("estimate_candidates", "select_candidate"),
    *("search_polynomials", "search_state_space", "choose"),
)

# Where in the fleet recordings cannot be used, as shares of it, and what is done to their samples.
BAD = {0.05: "a text cell", 0.45: "a constant output", 0.85: "too few samples"}


def write_recordings(
    folder: Path, count: int, per_job: int | str, bad: bool = False, recipe: str = "chapter"
) -> dict[str, object]:
    """Recordings of one system by different seeds, and the configuration that identifies them."""
    (folder / "data").mkdir(parents=True, exist_ok=True)
    spoiled = {int(share * count): how for share, how in BAD.items()} if bad else {}
    for number in range(count):
        file = folder / "data" / f"{number:05d}.csv"
        if file.exists():
            continue
        record, _ = armax(seed=number, samples=SAMPLES)
        columns = np.column_stack([record.input, record.output])
        if number in spoiled:
            _write_spoiled(file, columns, spoiled[number])
        else:
            np.savetxt(file, columns, delimiter=",")
    config = {
        "one_job_per": "recording",
        "recordings_per_job": per_job,
        "report": "none",
        "defaults": DEFAULTS if recipe == "chapter" else {},
        "datasets": {"r*": KEYS[recipe]},
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return config


def _write_spoiled(file: Path, columns: np.ndarray, how: str) -> None:
    """A recording that cannot be used."""
    if how == "a constant output":
        columns[:, 1] = 1.0
    np.savetxt(file, columns[:20] if how == "too few samples" else columns, delimiter=",")
    if how == "a text cell":
        lines = file.read_text().splitlines()
        lines[SAMPLES // 2] = "0.1,oops"
        file.write_text("\n".join(lines) + "\n")


class PeakMemory(threading.Thread):
    """The largest resident memory of a process, without its children, in MB."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.status = Path(f"/proc/{pid}/status")
        self.megabytes = 0.0

    def run(self) -> None:
        """Read it every second, until the process has ended."""
        while True:
            try:
                lines = dict(line.split(":", 1) for line in self.status.read_text().splitlines())
                self.megabytes = int(lines["VmHWM"].split()[0]) / 1024
            except (OSError, KeyError):
                return
            time.sleep(1.0)


def listed(folder: Path) -> dict[str, tuple[str, str]]:
    """Status and problem of each recording in the list of all of them."""
    with (folder / "results" / "fleet.csv").open(newline="") as file:
        return {row["dataset"]: (row["status"], row["problem"]) for row in csv.DictReader(file)}


def seconds_of_stages(settings: DatasetSettings, folder: Path) -> tuple[float, float]:
    """Processor time of the searches and of all other stages of a recording."""
    searching = others = 0.0
    with tempfile.TemporaryDirectory() as results:
        files = DatasetFiles(f"{results}/{settings.name}")
        for job in jobs(settings, files, with_report=False):
            began = time.process_time()
            job.run(folder=folder)
            taken = time.process_time() - began
            if job.stage.name in SEARCHES:
                searching += taken
            else:
                others += taken
    return searching, others


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("recordings", type=int)
    parser.add_argument("--per-job", default="auto")
    parser.add_argument("--cores", default="2")
    parser.add_argument("--bad", action="store_true")
    parser.add_argument("--recipe", choices=list(KEYS), default="chapter")
    given = parser.parse_args()
    folder, count = given.folder.resolve(), given.recordings
    per_job = given.per_job if given.per_job == "auto" else int(given.per_job)
    config = write_recordings(folder, count, per_job, given.bad, given.recipe)
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    began = time.monotonic()
    run = subprocess.Popen([*command, "--cores", given.cores, "--quiet", "all"], cwd=folder)
    memory = PeakMemory(run.pid)
    memory.start()
    _, status, used = os.wait4(run.pid, 0)
    wall, total = time.monotonic() - began, used.ru_utime + used.ru_stime
    assert (status == 0) != given.bad, f"the run ended with {status}"
    print(
        f"{count} recordings of {SAMPLES} samples on {given.cores} cores: {wall:.0f} s wall clock,"
    )
    print(f"{total:.0f} s of processor time, {total / count:.2f} s a recording.")
    print(f"Snakemake itself took up to {memory.megabytes:.0f} MB.", flush=True)
    rows = listed(folder)
    print(f"In the list: {dict(Counter(status for status, _ in rows.values()))}.")
    for name, (status, problem) in rows.items():
        if status != "complete":
            print(f"{name}: {status}, {problem}")
    os.chdir(folder)
    names = list(complete(config).datasets.values())
    seconds_of_stages(names[0], folder)  # loads what the jobs have loaded
    taken = np.array([seconds_of_stages(each, folder) for each in names[:: count // AGAIN]])
    searching, others = taken.mean(axis=0)
    rest = total / count - searching
    print(f"In one process the searches take {searching:.2f} s, all other stages {others:.2f} s;")
    print(f"beside the searches {rest:.2f} s a recording, {100 * rest * count / total:.0f} %.")
    files = [file for file in (folder / "results" / "r00000").rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    print(f"A recording's results: {size / 1e6:.2f} MB in {len(files)} files.")

    if given.recipe == "auto":
        write_section(
            "fleets",
            "Automatic recipe",
            f"{count} recordings of {SAMPLES} samples simulated by one system, three keys (input, "
            "output, rate), no reports, kernels compiled before; two shared cores.",
            f"benchmarks/fleet_run.py FOLDER {count} --recipe auto",
            ("processor time of a recording", "s"),
            [
                ("all, with Snakemake and the start of each job", f"{total / count:.1f}"),
                (f"searches and choice, mean of {len(taken)} in one process", f"{searching:.1f}"),
                ("other stages of these", f"{others:.1f}"),
            ],
        )


if __name__ == "__main__":
    main()
