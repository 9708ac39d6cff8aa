"""The most recent set of recordings of others for ``public_recordings.py``, as the ones before.

The set ``fifteenth`` is for one measurement at the end: 10 recordings of other sources than those
of the sets in ``recordings_of_others.py`` and its later parts, three of several inputs, chosen by
plots and documents and split before anything was run on any.  They come from public repositories
at GitHub, by repository (licence of the repository; none: none is stated, and the rights stay with
its owner) and file:

- brycemihal/bearrivers (none): of ``projects/wq`` the file ``testing/obs.js`` as ``obs_2024.js``
  and ``grandcanyon/js/obs.js`` as ``obs_2025.js`` (Colorado river at gauges of the Geological
  Survey: discharge at Lees Ferry, below a dam that follows demand, and 88 miles further down, read
  every half hour; three weeks of two years);
- l2late/intProj (none): of ``tclab/MATLAB/data/luca`` the files ``prbs_test_60min.mat`` and
  ``prbs_test_60min_val.mat`` (two transistors that heat each other: both heaters by random binary
  sequences, first temperature, every fifth second; two experiments);
- mariuseb/zeblab_data (none): ``ZEBLab_jan25_1m_MPC_219.csv`` of ``old_pulls`` (room 219 of the
  ZEB laboratory at Trondheim by the quarter of an hour: power of its radiator under feedback,
  temperature outdoors, radiation on the facade, temperature);
- misofey/Integrationproject (none): ``sines0_01.mat`` of ``data`` (wheel on a pendulum of a course
  at Delft: demand, speed of the wheel from sample 400);
- StienenNiels/IntegrationProject (none): of ``CollectedSimData`` the files
  ``D06_10_chirp_03_h01.mat`` and ``D06_10_chirp_05_h01.mat`` (pendulum with such a wheel: demand,
  angle of the pendulum, every fifth sample; sweeps of two amplitudes);
- ggjbakker/integrationproject (none): ``dataprbsC2.mat`` of ``data`` (two arms, one below the
  other, of which a motor moves the first under feedback: its demand, angle of the first arm, every
  twentieth sample from 2000);
- DiogoFernandes-2008015/SysID_LPV_NN_Battery (none): ``data_train.mat`` and ``data_val.mat`` (cell
  that is discharged by driving cycles: current, voltage, every second sample from 8000 of the first
  file and from 4000 of the second);
- nPoKhappy/control-valve-stiction-implementation (MIT): ``LIC-106_20241121~27.csv`` of
  ``new_project`` (plant under feedback of a level, by the minute: valve, flow through it, from
  minute 5200);
- Trobolit/R7015E_lab4 (none): ``throttle.txt``, ``lift_joystick.txt``, ``tilt_joystick.txt``,
  ``engine_speed_rps.txt`` (wheel loader that somebody drives: throttle and what is asked for lift
  and tilt, speed of its engine, from sample 3000; the interval is not stated and counts as 0.1 s);
- Oxford-NIL/YoYoTest (none): ``D06_COSMED_2.csv`` of ``SecondRound/D06`` (runner in an intermittent
  test: speed, rate of the heart, logged by breaths and read every two seconds).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from recordings_of_others import Record, content_of, first_samples_of, signals_of


def fifteenth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 10, of one output; three have several inputs."""

    def joined(*parts: list[np.ndarray]) -> list[np.ndarray]:
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def every(step: int, signals: list[np.ndarray]) -> list[np.ndarray]:
        return [each[::step] for each in signals]

    def river() -> list[np.ndarray]:
        starts = {"obs_2024.js": "2024-03-25", "obs_2025.js": "2025-02-15"}
        moments = {
            name: pd.date_range(day, periods=960, freq="30min") for name, day in starts.items()
        }
        gauges = ("RM0", "RM88")
        return joined(
            *(
                [discharge(folder / name, gauge, at) for gauge in gauges]
                for name, at in moments.items()
            )
        )

    def heaters(name: str) -> list[np.ndarray]:
        rows = content_of(folder / f"{name}.mat")["data"][::5]
        return [rows[:, 1:3], rows[:, 3]]

    def room() -> list[np.ndarray]:
        rows = pd.read_csv(folder / "ZEBLab_jan25_1m_MPC_219.csv")
        return [rows[["P_rad_219", "T_amb", "I_ver"]].to_numpy(), rows["T_219_TR3"].to_numpy()]

    def sweep(amplitude: str) -> list[np.ndarray]:
        name = folder / f"D06_10_chirp_{amplitude}_h01.mat"
        log = content_of(name, simplify_cells=True)["data"]
        return [log[key][::5] for key in ("control", "pendulum_angle_unwrapped")]

    def valve() -> list[np.ndarray]:
        rows = pd.read_csv(folder / "LIC-106_20241121~27.csv", encoding="utf-8-sig")[::-1][5200:]
        return [rows[key].to_numpy() for key in ("LV_106", "FT_115")]

    def loader() -> list[np.ndarray]:
        keys = ("throttle", "lift_joystick", "tilt_joystick", "engine_speed_rps")
        *given, speed = (np.loadtxt(folder / f"{key}.txt")[3000:] for key in keys)
        return [np.column_stack(given), speed]

    def runner() -> list[np.ndarray]:
        columns = ["t", "GPS Speed", "HR"]
        rows = pd.read_csv(folder / "D06_COSMED_2.csv", usecols=columns, skiprows=[1])
        at = np.arange(0.0, 1800.0, 2.0)
        return [np.interp(at, rows["t"], rows[key]) for key in columns[1:]]

    def cell() -> list[np.ndarray]:
        parts = (("data_train.mat", slice(8000, 14_000)), ("data_val.mat", slice(4000, 7000)))
        signals = ((signals_of(folder, name, "i", "v"), part) for name, part in parts)
        return every(2, joined(*([each[part] for each in both] for both, part in signals)))

    def wheel() -> list[np.ndarray]:
        return [each[400:] for each in signals_of(folder, "sines0_01.mat", "u", "phidot")]

    def arms() -> list[np.ndarray]:
        both = signals_of(folder, "dataprbsC2.mat", "um", "th1m")
        return every(20, [each[2000:] for each in both])

    tests = ("prbs_test_60min", "prbs_test_60min_val")
    yield from first_samples_of(
        (
            ("Colorado river", river, 960, 960, 1 / 1800),
            ("two transistors", lambda: joined(*map(heaters, tests)), 720, 720, 0.2),
            ("room of a laboratory", room, 880, 440, 1 / 900),
            ("wheel on a pendulum", wheel, 3600, 2000, 100.0),
            ("pendulum with a wheel", lambda: joined(sweep("03"), sweep("05")), 601, 601, 20.0),
            ("two arms", arms, 3000, 2000, 50.0),
            ("driven cell", cell, 3000, 1500, 0.5),
            ("valve of a plant", valve, 2000, 1000, 1 / 60),
            ("wheel loader", loader, 2400, 1200, 10.0),
            ("runner", runner, 600, 300, 0.5),
        )
    )


def discharge(file: Path, gauge: str, moments: pd.DatetimeIndex) -> np.ndarray:
    """Of a gauge in a file of JavaScript, at moments; missing values are interpolated."""
    block = file.read_text().split(f"{gauge}: [")[1].split("\n\t],")[0]
    pairs = re.findall(r"Datetime: '([^']+)',[^}]*?Discharge: ([\d.]+)", block)
    times = pd.to_datetime([time for time, _ in pairs])
    known = np.array([float(value) for _, value in pairs])
    return np.interp(moments.astype("int64"), times.astype("int64"), known)
