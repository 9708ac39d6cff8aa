"""The automatic recipe on public recordings, against what automatic peers reach on the same splits.

    PYTHONPATH=workflow/scripts python benchmarks/automatic_recordings.py --data ../shared/data

Each recording is given with nothing but its input, its output and its rate.  Errors are
``100 ||y - yhat|| / ||y - mean(y)||`` on validation samples that nothing was chosen by, simulated
from the initial state that their first tenth determines.  ``peers`` is the error of an automatic
choice between subspace, ARX, ARMAX, OE and BJ models of other programs, where it was measured.
``measured response``: of the motor bench, whose recording B has a quarter of the lines of A, the
error of the response of A as measured at each of these lines, without a model.
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

import evopem
from evopem.signals.best_linear_approximation import (
    excited_lines,
    period_of,
    spectra_of_periods,
)
from evopem.signals.recording import Recording
from evopem.signals.spectra import line_weights

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


def of_measured_response(case: Case) -> float:
    """Error where the response at each line is that of the estimation part, %; NaN of no period."""
    period = period_of(case.estimation.inputs)
    if not period or period_of(case.validation.inputs) != period:
        return np.nan
    parts = [
        [spectra_of_periods(signals, period)[:, :, 0] for signals in (part.inputs, part.outputs)]
        for part in (case.estimation, case.validation)
    ]
    (u, y), (v, z) = ([spectra.mean(axis=0) for spectra in part] for part in parts)
    excited = excited_lines(v[None, :, None])
    explained = np.zeros_like(z)
    explained[excited] = v[excited] * y[excited] / u[excited]
    weights = line_weights(period)[1:]
    powers = [weights @ np.abs(x[1:]) ** 2 for x in (z - explained, z)]
    return float(100.0 * np.sqrt(powers[0] / powers[1]))


def main() -> None:
    """Print one row for each recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the recordings")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    names = "simulation", "one step", "peers", "measured response", "model", "level"
    print("|", " | ".join(("recording", *names, "failed checks", "CPU s")), "|")
    print("|---" * (len(names) + 3) + "|")
    for case in cases(arguments.data):
        if arguments.only not in case.name:
            continue
        begun = time.process_time()
        parts = [(each.input, each.output) for each in (case.estimation, case.validation)]
        given = *parts[0], case.estimation.sampling_rate
        found = evopem.identify(*given, validation=parts[1], show_progress=False)
        spent = time.process_time() - begun
        record = found.results.model
        failed = [each.name for each in found.checks if each.passed is False]
        print(
            f"| {case.name} | {found.simulation_error_percent:.2f}"
            f" | {found.prediction_error_percent:.2f} | {case.peers:.2f}"
            f" | {of_measured_response(case):.2f} | {record.text}"
            f" | {record.level_of_simulation} | {', '.join(failed) or 'none'} | {spent:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
