"""The automatic recipe on public recordings, against what automatic peers reach on the same splits.

    PYTHONPATH=workflow/scripts python benchmarks/automatic_recordings.py --data ../shared/data

Each recording is given with nothing but its input, its output and its rate.  Errors are
``100 ||y - yhat|| / ||y - mean(y)||`` on validation samples that nothing was chosen by, simulated
from the initial state that their first tenth determines.  ``peers`` is the error of an automatic
choice between subspace, ARX, ARMAX, OE and BJ models of other programs, where it was measured.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.io import loadmat
from scipy.signal import decimate

from evopem.automatic.held_out.simulation import errors_simulated_on, prediction_errors
from evopem.automatic.identify import Identification, identify
from evopem.signals.recording import Recording

SAMPLES_OF_LAST_PERIODS, BENCH_FACTOR, BENCH_RATE = 5 * 2500, 4, 625.0


class Case(NamedTuple):
    """A recording in two parts, and the error of automatic peers in percent."""

    name: str
    estimation: Recording
    validation: Recording
    peers: float


def cases(data: Path) -> Iterator[Case]:
    """All recordings below a folder."""
    for name, file, rate, split, peers in (
        ("robot arm", "robot_arm.dat", 125.0, 800, 3.17),
        ("dryer", "dryer.dat", 12.5, 750, 8.11),
    ):
        u, y = np.loadtxt(data / "daisy" / file).T
        yield _cut(name, u, y, rate, split, peers)
    for output in ("omega_max", "omega_may"):
        parts = [_bench(data / "motor_bench" / f"MultisineType{p}.mat", output) for p in "AB"]
        yield Case(f"motor bench {output}", *parts, 11.4 if output == "omega_max" else 11.2)
    columns = np.loadtxt(data / "daisy" / "CD_player_arm.dat").T
    for u, y in ((0, 2), (1, 2), (0, 3), (1, 3)):
        name = f"CD arm u{u + 1} y{y - 1}"
        yield _cut(name, columns[u], columns[y], 1.0, 1500, np.nan)


def _cut(name: str, u: np.ndarray, y: np.ndarray, rate: float, split: int, peers: float) -> Case:
    parts = [
        Recording(np.ascontiguousarray(u[s]), np.ascontiguousarray(y[s]), rate)
        for s in (slice(split), slice(split, None))
    ]
    return Case(name, parts[0], parts[1], peers)


def _bench(file: Path, output: str) -> Recording:
    """The last five periods at a quarter of the rate."""
    content = loadmat(file)
    signals = [
        np.asarray(content[name], dtype=float).ravel()[-SAMPLES_OF_LAST_PERIODS:]
        for name in ("iq_adx", output)
    ]
    u, y = (decimate(each, BENCH_FACTOR, ftype="fir", zero_phase=True) for each in signals)
    return Recording(u, y, BENCH_RATE)


def errors_on(validation: Recording, found: Identification) -> tuple[float, float]:
    """Errors of simulation, whose state the first tenth determines, and of prediction, percent."""
    prepared, model = found.prepared, found.choice.candidate.model
    stretches = prepared.of_other(validation, prepared.plan.differences)
    fitted = found.choice.level == "state"
    outputs = np.concatenate([each.output for each in stretches])
    return tuple(
        100.0 * float(np.std(np.concatenate(errors)) / np.std(outputs))
        for errors in (
            [errors_simulated_on(model, None, each, fitted) for each in stretches],
            [prediction_errors(model, each) for each in stretches],
        )
    )


def main() -> None:
    """Print one row for each recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the recordings")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    print("| recording | simulation | one step | peers | model | level | failed checks | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for case in cases(arguments.data):
        if arguments.only not in case.name:
            continue
        begun = time.process_time()
        given = case.estimation
        found = identify(given.input, given.output, given.sampling_rate)
        spent = time.process_time() - begun
        simulation, prediction = errors_on(case.validation, found)
        print(
            f"| {case.name} | {simulation:.2f} | {prediction:.2f} | {case.peers:.2f} "
            f"| {found.choice.candidate.name} | {found.choice.level} "
            f"| {', '.join(found.failed) or 'none'} | {spent:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
