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
        model = truth(nu, ny, modes, "ss")
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
            save_model(file, f"SIPPY {method}", found, seconds)


def run_own(folder: Path) -> None:
    from evopem.estimation.state_space.estimate import estimates_of_orders
    from evopem.signals.recording import Recording

    for file in sorted(folder.glob("record_?_*.mat")):
        record = loadmat(file)
        u, y, order = record["u"][:KEPT], record["y"][:KEPT], int(record["order"][0, 0])
        begun = time.process_time()
        (estimated,) = estimates_of_orders(Recording(u, y, 100.0), [order])
        seconds = time.process_time() - begun
        save_model(file, "evopem", estimated.model, seconds)


def save_model(file: Path, method: str, model, seconds: float) -> None:  # type: ignore[no-untyped-def]
    """Keep the matrices that a method found of a record, in the form of Octave's part."""
    matrices = {name: getattr(model, name) for name in "ABCDK"}
    savemat(file.with_name(file.name.replace("record", method)), matrices | {"seconds": seconds})


def scores_of(file: Path, method: str) -> tuple[float, float, float, float]:
    """Errors of simulation, of the noise-free output and one step ahead, percent; seconds."""
    from evopem.models.state_space import StateSpaceModel

    found = loadmat(file)
    record = loadmat(file.with_name(file.name.replace(method, "record")))
    u, y, clean = (record[name][KEPT:] for name in ("u", "y", "clean"))
    ny = y.shape[1]
    model = StateSpaceModel(
        **{name: found[name] for name in "ABCDK"},
        sampling_rate=100.0,
        level=np.zeros(ny),
        noise_covariance=np.eye(ny),
    )

    def relative(errors: np.ndarray, outputs: np.ndarray) -> float:
        sizes = np.linalg.norm(outputs - outputs.mean(axis=0), axis=0)
        return float(np.mean(100.0 * np.linalg.norm(errors, axis=0) / sizes))

    return (
        relative(y - model.simulate_from_fitted_state(u, y), y),
        relative(clean - model.simulate_from_fitted_state(u, clean), clean),
        relative(model.residuals(u, y, model.prediction_state(u, y)), y),
        float(found["seconds"][0, 0]),
    )


def print_table(folder: Path) -> None:
    """Geometric means over the records of each truth."""
    from state_space import TRUTHS

    print("| inputs × outputs, order | method | simulation | noise-free output | one step | time |")
    print("|---|---|---|---|---|---|")
    for number, (nu, ny, modes) in enumerate(TRUTHS):
        for method in ("evopem", "Octave n4sid", *(f"SIPPY {name}" for name in METHODS)):
            files = sorted(folder.glob(f"{method}_{number}_*.mat"))
            if not files:
                continue
            rows = [scores_of(file, method) for file in files]
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
