"""The processor time of a fleet beyond its estimates: the check of docs/planning.md.

    python benchmarks/fleet_run.py FOLDER RECORDINGS [CORES]

identifies so many synthetic recordings with small grids, one job a recording, then makes every
estimate again in one process, and prints the processor time of both, the wall clock and the bytes.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import yaml

from evopem.config.structures import phases_of
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import estimate_candidates
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import load_prepared
from evopem.synthesis.armax import armax

PHASES = phases_of("armax")

ROOT = Path(__file__).parents[1]
SAMPLES = 2_000
CONFIG = {
    "one_job_per": "recording",
    "report": "none",
    "defaults": {
        "recipe": "chapter",
        "transforms": {"box_cox": "none", "difference": 0},
        "split": {"discard": 0},
        "delay": {"orders": [5, 6], "nk": [2, 4]},
        "orders": {"joint": [4, 8], "nc": [2, 8], "nb": [2, 8]},
    },
    "datasets": {"r*": {"file": "data/*.csv", "sampling_rate": 100}},
}


def estimation_seconds(results: Path) -> float:
    """Processor time of the estimates of one data set, once the kernels are loaded."""
    files = DatasetFiles(str(results))
    data = load_prepared(files.prepared, files.transforms).estimation
    record = load(ModelRecord, files.model)
    began = time.process_time()
    for phase in PHASES:
        orders = [each.orders for each in load(PhaseSelection, files.phase(phase)).candidates]
        estimate_candidates(data, orders, phase, record.search.settings, record.window)
    return time.process_time() - began


def main() -> None:
    folder, count = Path(sys.argv[1]), int(sys.argv[2])
    cores = sys.argv[3] if len(sys.argv) > 3 else "2"
    (folder / "data").mkdir(parents=True, exist_ok=True)
    for number in range(count):
        record, _ = armax(seed=number, samples=SAMPLES)
        columns = np.column_stack([record.input, record.output])
        np.savetxt(folder / "data" / f"{number:05d}.csv", columns, delimiter=",")
    (folder / "config.yaml").write_text(yaml.safe_dump(CONFIG))
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    began = time.monotonic()
    run = subprocess.Popen([*command, "--cores", cores, "--quiet", "all"], cwd=folder)
    _, status, used = os.wait4(run.pid, 0)
    wall, total = time.monotonic() - began, used.ru_utime + used.ru_stime
    assert status == 0, "the run failed"
    own = sorted((folder / "results").glob("r*"))
    estimation_seconds(own[0])  # loads the kernels
    estimating = sum(map(estimation_seconds, own))
    size = sum(file.stat().st_size for file in own[0].rglob("*") if file.is_file())
    files = sum(1 for file in own[0].rglob("*") if file.is_file())
    print(f"{count} recordings of {SAMPLES} samples on {cores} cores: {wall:.0f} s wall clock,")
    print(f"{total:.0f} s of processor time, {estimating:.0f} s of them for estimates:")
    print(f"an overhead of {(total - estimating) / count:.1f} s a recording,")
    print(f"{100 * (total - estimating) / estimating:.0f} % of the estimation time.")
    print(f"A recording's results: {size / 1e6:.2f} MB in {files} files.")


if __name__ == "__main__":
    main()
