"""The automatic recipe on recordings of others, beside automatic peers; writes docs/evidence.

    PYTHONPATH=workflow/scripts python benchmarks/public_recordings.py --data FOLDER [--only NAME]
    PYTHONPATH=workflow/scripts python benchmarks/public_recordings.py --data FOLDER --unseen

The folder holds recordings that are free to download but are not part of the project, under these
names: of DaISy (De Moor, KU Leuven) ``ballbeam.dat``, ``exchanger.csv``, ``flutter.dat``,
``heating_system.dat``, ``dryer.dat`` and ``robot_arm.dat``; of the nonlinear benchmarks
``SNLS80mV.csv`` (Silverbox), ``dataBenchmark.csv`` (cascaded tanks) and ``drive.mat`` (coupled
electric drives); ``actuator.mat`` (hydraulic actuator, Sjöberg et al. 1995).  One that is missing
is left out, with a message.

``--unseen`` are recordings that no rule was made with; which samples are for estimation was
written down before anything was run.  They come from public repositories at GitHub, by repository
(licence of the repository; none: none is stated) and file:

- zhenwendai/RGP (BSD): ``gas_furnace.csv`` (Box & Jenkins 1970: rate of gas, CO2);
- gsmfnc/LPV_SysId (BSD): ``Magneto.mat`` (a magnetorheological damper: velocity, force),
  ``TwoTanksMatlab.mat`` (pump, lower level), ``RobotArm.mat`` (industrial robot: torque, speed),
  ``WienerHammerBenchMark.mat`` (a circuit with a diode, Schoukens et al. 2009);
- rawlings-group/mlid_2024 (MIT): ``tclab_kuntz_rawlings_2022.mat`` (first heater, its temperature;
  the second heater, which is not given, warms it as well);
- JulienLeprince/fiftyshadesofgrey (MIT): ``blg_1.csv`` (a Dutch house: heating, temperature);
- ryanGT/systemid (none): ``swept1-0-10hz.txt``, ``swept2-0-10hz.txt`` (a ruler on a motor:
  voltage, acceleration of the tip);
- wilsonrljr/sysidentpy-data (MIT): ``buck_id.csv``, ``buck_valid.csv`` (buck converter),
  ``f-16.txt`` (ground vibration test: shaker, acceleration), ``x_cc.csv``, ``y_cc.csv`` (direct
  current motor and generator, every 500th sample);
- helonayala/sysid (Unlicense): ``randomStepSequence.mat`` (ball in a hoop: motor, angle);
- gergelytakacs/AutomationShield (CC BY-NC-ND): ``resultID2.mat`` of HeatShield (heater of a
  printer's head under feedback), ``resultID.mat`` of OptoShield (lamp, light), ``aprbsResult.mat``
  (geared motor: voltage, speed), ``Identification_Data2.mat``, ``Validation_Data2.mat`` (pendulum
  with a propeller), ``APRBS_R4.mat`` (ball that floats in a tube of air under feedback).

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
SEEN = "All were in view when rules of the choice or of the checks were made. "
UNSEEN = "None was in view when a rule was made; sources are in the script. "
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


def unseen(folder: Path) -> Iterator[Record]:
    """Recordings that no rule was made with: 17, of one input and one output each."""

    def matlab(name: str, *keys: str) -> list[np.ndarray]:
        content = loadmat(folder / name)
        return [content[key].ravel() for key in keys]

    def joined(name: str, samples: int = -1) -> list[np.ndarray]:
        u, y, u_val, y_val = matlab(name, "U", "Y", "U_val", "Y_val")
        return [np.concatenate([u[:samples], u_val]), np.concatenate([y[:samples], y_val])]

    def table(names: tuple[str, ...], u: int, y: int, **how: object) -> list[np.ndarray]:
        values = np.concatenate([np.genfromtxt(folder / name, **how) for name in names])
        return [values[:, u], values[:, y]]

    csv = {"delimiter": ",", "skip_header": 1}
    swept, buck = ("swept1-0-10hz.txt", "swept2-0-10hz.txt"), ("buck_id.csv", "buck_valid.csv")

    def circuit() -> list[np.ndarray]:
        u, y = matlab("WienerHammerBenchMark.mat", "uBenchMark", "yBenchMark")
        part = np.r_[10_000:14_000, 110_000:112_000]
        return [u[part], y[part]]

    def laboratory() -> list[np.ndarray]:
        content = loadmat(folder / "tclab_kuntz_rawlings_2022.mat")["data"]
        return [content[key][0, 0][:, 0] for key in ("udat", "ydat")]

    def pendulum() -> list[np.ndarray]:
        one = matlab("Identification_Data2.mat", "u", "yrad")
        two = matlab("Validation_Data2.mat", "uval", "yradval")
        return [np.concatenate(both) for both in zip(one, two, strict=True)]

    def generator() -> list[np.ndarray]:
        return [np.loadtxt(folder / name)[::500] for name in ("x_cc.csv", "y_cc.csv")]

    def shield(name: str) -> list[np.ndarray]:
        return list(matlab(name, "resultID")[0].reshape(-1, 2).T[::-1])

    house = {"delimiter": ";", "skip_header": 1}
    kinds: tuple[tuple[str, Callable[[], list[np.ndarray]], int, int, float], ...] = (
        ("gas furnace", lambda: table(("gas_furnace.csv",), 0, 1, **csv), 196, 100, 1 / 9),
        ("damper", lambda: joined("Magneto.mat", 2000), 2000, 1499, 200.0),
        ("two tanks", lambda: joined("TwoTanksMatlab.mat", 2000), 2000, 1000, 5.0),
        ("industrial robot", lambda: joined("RobotArm.mat", 3000), 3000, 1500, 2000.0),
        ("Wiener-Hammerstein", circuit, 4000, 2000, 51_200.0),
        ("temperature laboratory", laboratory, 3600, 3540, 1.0),
        ("house", lambda: table(("blg_1.csv",), 5, 4, **house), 2800, 1381, 1 / 900),
        ("ruler", lambda: table(swept, 3, 5), 2000, 2000, 500.0),
        ("buck converter", lambda: table(buck, 1, 2, **csv), 1001, 999, 1e5),
        ("F-16", lambda: table(("f-16.txt",), 0, 2, delimiter=","), 4000, 2000, 400.0),
        ("hoop", lambda: matlab("randomStepSequence.mat", "u", "y"), 4000, 2000, 10.0),
        ("printer heater", lambda: shield("resultID2.mat"), 4000, 2000, 0.5),
        ("lamp", lambda: shield("resultID.mat"), 900, 500, 200.0),
        ("geared motor", lambda: matlab("aprbsResult.mat", "u", "y"), 3200, 1601, 50.0),
        ("propeller pendulum", pendulum, 5001, 5001, 100.0),
        ("floating ball", lambda: matlab("APRBS_R4.mat", "u", "y"), 3000, 1800, 40.0),
        ("generator", generator, 700, 300, 1.0),
    )
    for name, read, estimation, validation, rate in kinds:
        u, y = read()
        yield Record(name, *(each[: estimation + validation] for each in (u, y)), estimation, rate)


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
    parser.add_argument("--unseen", action="store_true", help="those no rule was made with")
    arguments = parser.parse_args()
    rows, ratios, failed = [], [], []
    for record in (unseen if arguments.unseen else records)(arguments.data):
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
        + (UNSEEN if arguments.unseen else SEEN)
    )
    print(text)
    if not arguments.only:
        title = "Recordings of others" + ", unseen by any rule" * arguments.unseen
        names = ("recording", "split", "evopem", "automatic peer", "ARX", "subspace")
        columns = (*names, "regularised", "model", "defects")
        write_section("automatic", title, text, COMMAND, columns, rows)


if __name__ == "__main__":
    main()
