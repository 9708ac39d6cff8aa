"""Compare state-space estimates with Octave's n4sid and SIPPY's on the same records.

    python benchmarks/state_space_peers.py records FOLDER [--records 5]
    octave benchmarks/state_space_peers.m   (in FOLDER)
    PYTHON_WITH_SIPPY benchmarks/state_space_peers.py sippy FOLDER
    python benchmarks/state_space_peers.py own FOLDER
    python benchmarks/state_space_peers.py table FOLDER

Records of the truths of ``state_space.py`` in innovations form: 1000 samples for estimation, 1000
for validation, noise of 20 %.  All get the true order and are scored by the same functions.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

KEPT = 1000
METHODS = ("N4SID", "MOESP", "CVA")


def write_records(folder: Path, count: int) -> None:
    from state_space import TRUTHS, recorded, truth

    folder.mkdir(parents=True, exist_ok=True)
    for number, (nu, ny, modes) in enumerate(TRUTHS):
        model = truth(nu, ny, modes, "innovations")
        for seed in range(count):
            u, y = recorded(model, 2 * KEPT, 0.2, 500 + seed)
            savemat(
                folder / f"record_{number}_{seed}.mat",
                {"u": u, "y": y, "order": 2 * modes, "kept": KEPT, "clean": model.simulate(u)},
            )


def run_sippy(folder: Path) -> None:
    from sippy_unipi import system_identification

    for file in sorted(folder.glob("record_?_*.mat")):
        record = loadmat(file)
        u, y, order = record["u"][:KEPT], record["y"][:KEPT], int(record["order"][0, 0])
        for method in METHODS:
            begun = time.process_time()
            found = system_identification(
                y.T - y.mean(axis=0)[:, None], u.T, method, SS_fixed_order=order, SS_f=25, SS_p=25
            )
            seconds = time.process_time() - begun
            savemat(
                file.with_name(file.name.replace("record", f"SIPPY {method}")),
                {
                    "A": found.A,
                    "B": found.B,
                    "C": found.C,
                    "D": found.D,
                    "K": found.K,
                    "seconds": seconds,
                },
            )


def run_own(folder: Path) -> None:
    from evopem.estimation.state_space.estimate import sweep_state_space_orders

    for file in sorted(folder.glob("record_?_*.mat")):
        record = loadmat(file)
        u, y, order = record["u"][:KEPT], record["y"][:KEPT], int(record["order"][0, 0])
        begun = time.process_time()
        scores = sweep_state_space_orders(u, y, [order], 100.0, folds=False)
        seconds = time.process_time() - begun
        model = scores.estimates[0].model
        savemat(
            file.with_name(file.name.replace("record", "evopem")),
            {
                "A": model.A,
                "B": model.B,
                "C": model.C,
                "D": model.D,
                "K": model.K,
                "seconds": seconds,
            },
        )


def print_table(folder: Path) -> None:
    """Geometric means over the records of each truth."""
    from state_space import TRUTHS

    from evopem.estimation.state_space.held_out import prediction_errors, simulation_errors
    from evopem.models.state_space import StateSpaceModel

    print("| inputs × outputs, order | method | simulation | noise-free output | one step | time |")
    print("|---|---|---|---|---|---|")
    for number, (nu, ny, modes) in enumerate(TRUTHS):
        for method in ("evopem", "Octave n4sid", *(f"SIPPY {name}" for name in METHODS)):
            rows = []
            for file in sorted(folder.glob(f"{method}_{number}_*.mat")):
                found = loadmat(file)
                record = loadmat(file.with_name(file.name.replace(method, "record")))
                u, y = record["u"], record["y"]
                model = StateSpaceModel(
                    A=found["A"],
                    B=found["B"],
                    C=found["C"],
                    D=found["D"],
                    K=found["K"],
                    sampling_rate=100.0,
                    level=np.zeros(ny),
                    noise_covariance=np.eye(ny),
                )
                later, measured = u[KEPT:], y[KEPT:]
                clean = simulation_errors(model, later, record["clean"][KEPT:])
                rows.append(
                    (
                        simulation_errors(model, later, measured).mean(),
                        clean.mean(),
                        prediction_errors(model, later, measured).mean(),
                        float(found["seconds"][0, 0]),
                    )
                )
            if rows:
                unstable = sum(not np.isfinite(row[0]) for row in rows)
                kept = [row for row in rows if np.isfinite(row).all()]
                means = np.exp(np.mean(np.log(kept), axis=0)) if kept else np.full(4, np.nan)
                print(
                    f"| {nu} × {ny}, {2 * modes} | {method}"
                    f"{f' ({unstable} unstable)' if unstable else ''} | {means[0]:.2f} | "
                    f"{means[1]:.2f} | {means[2]:.2f} | {means[3]:.2f} s |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("records", "sippy", "own", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--records", type=int, default=5)
    arguments = parser.parse_args()
    if arguments.part == "records":
        write_records(arguments.folder, arguments.records)
    else:
        parts = {"sippy": run_sippy, "own": run_own, "table": print_table}
        parts[arguments.part](arguments.folder)


if __name__ == "__main__":
    main()
