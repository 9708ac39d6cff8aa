"""The fourth set of recordings of others for ``public_recordings.py``: sources, readers and split.

The set ``fourth`` is for one measurement of the rules that followed the set ``third``: 14
recordings, chosen by their plots and split before anything was run on any of them.  They come from
public repositories at GitHub, by repository (licence of the repository; none: none is stated, and
the rights stay with its owner) and file; a name after "as" is the one that the folder uses:

- cartacamilla/SystemIdentification (none): ``CE.mat`` (flexible link of a course at EPFL, four
  periods of a binary sequence), ``laserbeamdataN.mat`` (laser beam that an actuator steers);
- danielsmorais/system-identification (none): ``tanks1.dat`` (two tanks in cascade: pump, lower
  level; its length and interval are those of the free data of Wigren and Schoukens 2013);
- JonasWeigand/Robot_Identification (MIT): ``data.mat`` of its trajectories ``2020-10-21 10s FF A
  08ms`` and ``... B 08ms`` as ``data_A.mat``, ``data_B.mat`` (robot KUKA KR300 under feedback:
  torque and speed of the motor of its first axis);
- jankristia/BlueBoatSystemIdentification (none): ``fixed_00000235.csv`` (boat with two thrusters
  that are mounted as mirror images: difference of their demands, speed ahead; sum of their demands,
  rate of yaw; samples 900 to 2900);
- michoy/system_identification (MIT): ``heave-1.csv``, ``random-1.csv`` (underwater vehicle:
  demanded force and speed, vertical in the first file and ahead in the second);
- srouchier/buildingenergygeeks (none): ``building_1298.csv`` (a building by the hour: temperature
  outdoors, of which four missing values are interpolated, chilled water as its second meter counts
  it, with missed counts; hours 3000 to 5400);
- gkeiel/dc_motor_position_control (MIT): ``data.csv`` of ``dc_motor_position_control_pid_step`` as
  ``data_pid_step.csv`` (motor under feedback: control signal, angle, every fifth sample);
- nadurthi/ros_roverbot_ws (none): ``InputOutputData_50ms_new.txt`` (log of a quadrotor: its
  input U, its output V, with dropouts);
- SerfinHub/PIDNN (none): ``tclab_data.csv`` (temperature laboratory: first heater, its temperature;
  the second heater, which is not given, warms it as well);
- raghuramshankar/data-driven-modelling-of-li-ion-batteries (MIT): ``562_PausCycl.csv`` (McMaster
  University: cell LG HG2 at 40 degrees, current, voltage; up to its last pause);
- fywu85/circles-sysid (MIT): ``data.csv`` of ``linear/fourth_order`` as
  ``data_fourth_order.csv`` (car: demanded and measured acceleration).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from recordings_of_others import (
    CSV,
    Record,
    columns_of,
    content_of,
    first_samples_of,
    signals_of,
)


def fourth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement of the latest rules: 14, of one input and one output each."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def robot() -> list[np.ndarray]:
        names = [folder / f"data_{trajectory}.mat" for trajectory in "AB"]
        parts = [content_of(name, simplify_cells=True)["rec"] for name in names]
        keys = ("act_torque_rel_nm", "act_vel_mot_deg_per_s")
        return [np.concatenate([part[key][0] for part in parts]) for key in keys]

    def boat(sign: float, output: int) -> list[np.ndarray]:
        left, right = table("fixed_00000235.csv", 16, 17, **CSV)
        motion = table("fixed_00000235.csv", 17, output, **CSV)[1]
        return [(right + sign * left)[900:2900], motion[900:2900]]

    def water() -> list[np.ndarray]:
        outdoors, counted = (each[3000:5400] for each in table("building_1298.csv", 5, 2, **CSV))
        known = np.flatnonzero(np.isfinite(outdoors))
        return [np.interp(np.arange(len(outdoors)), known, outdoors[known]), counted]

    def motor() -> list[np.ndarray]:
        return [each[::5] for each in table("data_pid_step.csv", 3, 1, **CSV)]

    def cell() -> list[np.ndarray]:
        how = {"delimiter": ",", "skip_header": 30, "usecols": (8, 9)}
        return table("562_PausCycl.csv", 1, 0, **how)

    flexible, beam = partial(matlab, "CE.mat", "u", "y"), ("laserbeamdataN.mat", "u", "y")
    yield from first_samples_of(
        (
            ("flexible link", flexible, 1200, 800, 1 / 0.015),
            ("laser beam", lambda: matlab(*beam), 300, 200, 1000.0),
            ("tanks in cascade", lambda: table("tanks1.dat", 0, 1), 1600, 900, 0.2),
            ("KUKA KR300", robot, 2501, 2501, 250.0),
            ("boat ahead", lambda: boat(-1.0, 8), 1200, 800, 10.0),
            ("boat in yaw", lambda: boat(1.0, 10), 1200, 800, 10.0),
            ("vehicle in heave", lambda: table("heave-1.csv", 4, 20, **CSV), 1700, 929, 10.0),
            ("vehicle ahead", lambda: table("random-1.csv", 2, 18, **CSV), 1900, 1101, 10.0),
            ("chilled water", water, 1600, 800, 1 / 3600),
            ("motor under PID", motor, 2500, 1500, 100.0),
            (
                "quadrotor",
                lambda: table("InputOutputData_50ms_new.txt", 0, 1, **CSV),
                *(1500, 900, 20.0),
            ),
            ("heater of TCLab", lambda: table("tclab_data.csv", 1, 3, **CSV), 300, 200, 0.5),
            ("LG cell", cell, 1150, 750, 10.0),
            ("car", lambda: table("data_fourth_order.csv", 4, 3, **CSV), 700, 399, 20.0),
        )
    )
