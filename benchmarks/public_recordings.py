"""The automatic recipe on recordings of others, beside automatic peers; writes docs/evidence.

    PYTHONPATH=workflow/scripts python benchmarks/public_recordings.py --data FOLDER [--only NAME]

The folder holds recordings that are free to download but are not part of the project, under these
names: of DaISy (De Moor, KU Leuven) ``ballbeam.dat``, ``exchanger.csv``, ``flutter.dat``,
``heating_system.dat``, ``dryer.dat`` and ``robot_arm.dat``; of the nonlinear benchmarks
``SNLS80mV.csv`` (Silverbox), ``dataBenchmark.csv`` (cascaded tanks) and ``drive.mat`` (coupled
electric drives); ``actuator.mat`` (hydraulic actuator, Sjöberg et al. 1995).  One that is missing
is left out, with a message.

Only input, output and rate are given.  Errors are ``100 ||y - yhat|| / ||y - mean(y)||`` of
simulations of validation samples, from the initial state that their first tenth determines; those
of the peers with a level that is fitted to what is scored.  Errors above 100 % count as 100 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from automatic_zoo import PEERS, automatic
from evidence import write_section
from scipy.io import loadmat

import evopem
from evopem.automatic.cross_validation.simulation import simulated_on
from evopem.signals.recording import Segment

COMMAND = "benchmarks/public_recordings.py"
FURTHER = (automatic, *PEERS)
SILVERBOX_MULTISINE = slice(50_000, 58_000)


class Record(NamedTuple):
    """A recording, with the number of its samples for estimation."""

    name: str
    u: np.ndarray
    y: np.ndarray
    estimation: int
    rate: float


def records(folder: Path) -> Iterator[Record]:
    """All recordings of the folder."""

    def table(name: str, **how: object) -> np.ndarray:
        return np.genfromtxt(folder / name, **how)

    def columns(name: str, u: int, y: int, **how: object) -> tuple[np.ndarray, np.ndarray]:
        values = table(name, **how)
        return values[:, u], values[:, y]

    csv = {"delimiter": ",", "skip_header": 1}

    def silverbox() -> tuple[np.ndarray, np.ndarray]:
        u, y = columns("SNLS80mV.csv", 0, 1, **csv)
        return u[SILVERBOX_MULTISINE], y[SILVERBOX_MULTISINE]

    def tanks() -> tuple[np.ndarray, np.ndarray]:
        values = table("dataBenchmark.csv", **csv)
        return np.concatenate(values[:, :2].T), np.concatenate(values[:, 2:4].T)

    def of_matlab(name: str, u: str, y: str) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        def read() -> tuple[np.ndarray, np.ndarray]:
            content = loadmat(folder / name)
            return content[u].ravel(), content[y].ravel()

        return read

    kinds: tuple[tuple[str, Callable[[], tuple[np.ndarray, np.ndarray]], int, float], ...] = (
        ("heating system", lambda: columns("heating_system.dat", 1, 2), 500, 0.5),
        ("ball and beam", lambda: columns("ballbeam.dat", 0, 1), 600, 10.0),
        ("heat exchanger", lambda: columns("exchanger.csv", 1, 2, **csv), 3000, 1.0),
        ("cascaded tanks", tanks, 1024, 0.25),
        ("hydraulic actuator", of_matlab("actuator.mat", "u", "p"), 512, 1.0),
        *(
            (f"coupled drives {n}", of_matlab("drive.mat", f"u{n}", f"z{n}"), 300, 50.0)
            for n in (1, 2, 3)
        ),
        ("flutter", lambda: columns("flutter.dat", 0, 1), 512, 1.0),
        ("Silverbox", silverbox, 5000, 610.35),
        ("hair dryer", lambda: columns("dryer.dat", 0, 1), 750, 12.5),
        ("robot arm", lambda: columns("robot_arm.dat", 0, 1), 800, 125.0),
    )
    for name, read, estimation, rate in kinds:
        try:
            yield Record(name, *read(), estimation, rate)
        except FileNotFoundError as error:
            print(f"{name} is left out: {error}", flush=True)


def peer_errors(record: Record) -> list[float]:
    """Of the peer that chooses by its second half, and of each alone."""
    u, y = record.u[: record.estimation], record.y[: record.estimation]
    held = Segment(record.u[record.estimation :], record.y[record.estimation :])
    found = []
    for peer in FURTHER:
        model = peer(u, y)
        computed = simulated_on(model, held.between(0, 0), held, fitted_level=True)[:, 0]
        scored = held.output[held.samples - len(computed) :]
        with np.errstate(all="ignore"):
            error = (
                100.0 * np.linalg.norm(scored - computed) / np.linalg.norm(scored - scored.mean())
            )
        found.append(float(error) if np.isfinite(error) else np.inf)
    return found


def main() -> None:
    """Print one row for each recording, and write all of them where none was asked for alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the recordings")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    rows, ratios, failed = [], [], []
    for record in records(arguments.data):
        if arguments.only not in record.name:
            continue
        cut = record.estimation
        found = evopem.identify(
            *(record.u[:cut], record.y[:cut], record.rate),
            validation=(record.u[cut:], record.y[cut:]),
            show_progress=False,
        )
        own, others = found.simulation_error_percent, peer_errors(record)
        defects = [c.name for c in found.checks if c.passed is False and c.grade == "defect"]
        ratios.append([min(own, 100.0) / min(error, 100.0) for error in (others[0], min(others))])
        failed.append(len(defects))
        numbers = [f"{error:.1f}" if error < 1000.0 else "over 1000" for error in (own, *others)]
        split = f"{cut}/{len(record.y) - cut}"
        rows.append((record.name, split, *numbers, found.summary.model, str(len(defects))))
        print(" | ".join(rows[-1]), "|", ", ".join(defects), flush=True)
    means = np.exp(np.mean(np.log(ratios), axis=0))
    text = (
        f"Geometric mean of the errors, capped at 100 %: {means[0]:.2f} times those of the peer "
        f"that chooses by itself, {means[1]:.2f} times the lowest of all peers, which is known "
        f"afterwards only. Failed checks that are defects: {np.mean(failed):.1f} a recording. "
        "All were in view when rules of the choice or of the checks were made. "
    )
    print(text)
    if not arguments.only:
        names = ("recording", "split", "evopem", "automatic peer", "ARX", "subspace")
        columns = (*names, "regularised", "model", "defects")
        write_section("automatic", "Recordings of others", text, COMMAND, columns, rows)


if __name__ == "__main__":
    main()
