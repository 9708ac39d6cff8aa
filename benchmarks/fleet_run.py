"""What a fleet costs beyond its estimates: the check of docs/planning.md.

    python benchmarks/fleet_run.py FOLDER RECORDINGS [CORES]

identifies so many synthetic recordings with small grids, one job a recording, then makes every
estimate again in one process, and prints the processor time of both, the wall clock and the bytes.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import yaml

from evopem.estimation.order_selection import estimate_candidates
from evopem.models.armax import Orders
from evopem.signals.preparation import load_prepared
from evopem.synthesis import synthesize

ROOT = Path(__file__).parents[1]
SAMPLES = 2_000
RECORD = {"samples": SAMPLES, "sampling_rate": 100, "noise": 0.1, "box_cox": None, "difference": 0}
CONFIG = {
    "one_job_per": "recording",
    "report": "none",
    "defaults": {
        "stationarity": {"box_cox": "none", "difference": 0},
        "split": {"discard": 0},
        "delay": {"orders": [5, 6], "delays": [2, 4]},
        "orders": {"common": [4, 8], "c": [2, 8], "b": [2, 8]},
    },
    "datasets": {"r*": {"file": "data/*.csv", "sampling_rate": 100}},
}


def estimation_seconds(results: Path) -> float:
    """Processor time of the estimates of one data set, once the kernels are loaded."""
    data = load_prepared(results / "prepared.npz", results / "transforms.json").estimation
    model = json.loads((results / "model.json").read_text())
    search = model["search"]["settings"]
    began = time.process_time()
    for file in sorted((results / "phases").glob("*.json")):
        phase = json.loads(file.read_text())
        orders = [
            Orders(*(each[key] for key in ("na", "nb", "nc", "nk"))) for each in phase["candidates"]
        ]
        estimate_candidates(data, orders, phase["phase"], search, model["scoring_start"])
    return time.process_time() - began


def main() -> None:
    folder, count = Path(sys.argv[1]), int(sys.argv[2])
    cores = sys.argv[3] if len(sys.argv) > 3 else "2"
    (folder / "data").mkdir(parents=True, exist_ok=True)
    for number in range(count):
        record, _ = synthesize("armax", seed=number, **RECORD)
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
