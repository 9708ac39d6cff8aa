"""The newest set of recordings of others for ``public_recordings.py``: sources, readers, splits.

The set ``eleventh`` is for one measurement at the end: 7 recordings of other sources than those of
the sets in ``recordings_of_others.py`` and its later parts, three of several inputs, chosen by
plots and documents and split before anything was run on any.  They come from public repositories
at GitHub, by repository (licence of the repository; none: none is stated, and the rights stay with
its owner) and file:

- jankristia/BlueBoatSystemIdentification (none): of ``sorted_data`` the files
  ``fixed_00000235.csv`` and ``fixed_00000239.csv`` (unmanned boat with two thrusters: their forces
  as computed from what is sent to them, rate of yaw, samples 850 to 2900 of the first run, and
  speed ahead, samples 380 to 2400 of the second);
- malik-robert/HSM150-data (none): of ``Data/Identification`` the files ``idf_pos_0.06_2.mat`` and
  ``idf_pos_0.065_1.mat`` (motor that another loads: torque with one step, speed from rest, every
  twentieth sample; two experiments with steps of other heights);
- AlejoBSmith/MotorDCSystemIdentification (none): ``Delay 5 Avg 5 OpenLoop.csv`` of ``Mediciones``
  as of revision 07b81ab (motor on a board of a course: width of pulses in steps of random height,
  speed as a moving average, every fifth sample; its interval is taken as that of the third column);
- INTO-CPS-Association/example_digital-twin_incubator (none):
  ``20230501_calibration_empty_system.csv`` of ``software/incubator/datasets`` (incubator that a
  relay heats: heater, mean temperature inside);
- APMonitor/arduino (Apache): ``data.txt`` of ``2_Regression/Energy_balance_MIMO/MATLAB_fmincon``
  (two transistors that heat each other by the second: both heaters, first temperature);
- idsia-robotics/nanodrone-sysid-benchmark (none): of ``data/real/processed/train`` as of revision
  6d78c23 the files ``square_20251017_run1.csv`` and ``square_20251017_run2.csv`` (nano-quadrotor
  under feedback that flies squares: torque of pitch by the speeds of its rotors, rate of pitch; two
  flights).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from recordings_of_others import PLAIN, Record, columns_of, content_of, first_samples_of

FORCES = ["left_force", "right_force"]


def eleventh(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 7, of one output; three have several inputs."""
    table = partial(columns_of, folder)

    def boat(run: int, output: str, first: int) -> list[np.ndarray]:
        rows = pd.read_csv(folder / f"fixed_00000{run}.csv")[first:]
        return [rows[FORCES].to_numpy(), rows[output].to_numpy()]

    def loaded_motor() -> list[np.ndarray]:
        files = [folder / f"idf_pos_{height}.mat" for height in ("0.06_2", "0.065_1")]
        rows = np.concatenate([content_of(file)["data"][::20] for file in files])
        return [rows[:, 4], rows[:, 3]]

    def board() -> list[np.ndarray]:
        return [each[::5] for each in table("Delay 5 Avg 5 OpenLoop.csv", 0, 1, **PLAIN)]

    def incubator() -> list[np.ndarray]:
        rows = pd.read_csv(folder / "20230501_calibration_empty_system.csv")
        return [rows["heater_on"].to_numpy(float), rows["average_temperature"].to_numpy()]

    def heaters() -> list[np.ndarray]:
        rows = np.genfromtxt(folder / "data.txt", delimiter=",", skip_header=1)
        return [rows[:, 1:3], rows[:, 3]]

    def drone() -> list[np.ndarray]:
        flights = [pd.read_csv(folder / f"square_20251017_run{k}.csv") for k in (1, 2)]
        return [np.concatenate([f[key] for f in flights]) for key in ("torque_pitch", "wy")]

    yield from first_samples_of(
        (
            ("boat that turns", lambda: boat(235, "yaw_rate", 850), 1250, 800, 10.0),
            ("boat ahead", lambda: boat(239, "surge", 380), 1250, 770, 10.0),
            ("loaded motor", loaded_motor, 1000, 1000, 50.0),
            ("motor on a board", board, 2800, 1700, 1000 / 30),
            ("incubator", incubator, 1400, 816, 1 / 3),
            ("two heaters", heaters, 400, 199, 1.0),
            ("nano-quadrotor", drone, 1900, 1900, 100.0),
        )
    )
