"""The latest sets of recordings of others for ``public_recordings.py``: sources, readers, splits.

The set ``seventh`` is for one measurement at the end: 12 recordings of other sources than those of
the sets in ``recordings_of_others.py`` and ``recordings_of_others_later.py``, chosen by plots and
documents and split before anything was run on any.  They come from public repositories at GitHub,
by repository (licence of the repository; none: none is stated, and the rights stay with its owner)
and file; a name after "as" is the one that the folder uses:

- mihaozbot/Plate-Heat-Exchanger (MIT; Ozbot et al. 2023): of ``PHE_data/Starcase_up_n_down`` the
  file ``measurement_steps_all_2022_06_16_21_40_PRBS.mat`` (heat exchanger of plates: valve of
  the hot water in steps of random height, temperature that leaves it, every fifth sample);
- merijnfloren/fsm-benchmark-data (CC BY; Floren et al. 2024): ``u_300mV_train.npy``,
  ``y_300mV_train.npy``, ``u_300mV_test.npy``, ``y_300mV_test.npy`` (steering mirror of a satellite
  on three piezoelectric actuators: sum of their voltages, sum of the displacements at three points;
  second periods of a random-phase multisine for estimation and of another for validation);
- SJ-Chuang/TD3-Shake-Table-System (none): of ``dataset/test`` the files ``1999_921_CHY027_NS.csv``
  and ``1999_921_CHY046_NS.csv`` (structure on a hydraulic shaking table under feedback, moved as in
  an earthquake at two stations: voltage of its valve, displacement of the table, every fourth
  sample of 5500 to 18300; accelerations of the first floor and of the roof, every second sample of
  6000 to 13000);
- dronefreak/system-identification-helicopter (MIT): ``Data_graphready.mat`` of
  ``data/experiments/Experiment_data`` (model helicopter TREX 550 that a pilot flies: longitudinal
  cyclic, rate of pitch, samples 3800 to 8400; the other controls, which are not given, move as
  well);
- abditag2/quanser-helicopter-dof (none): ``recorded_data.txt`` (bench helicopter with three axes
  under feedback: difference of the voltages of its rotors, pitch, every second sample of 100 to
  7600; the voltages are limited);
- alexzhengyc/Vehicle-dynamics-learning (Apache): ``rawdata.csv`` of ``Data/8.8-2`` (model car that
  somebody drives: steering, rate of yaw with an outlier, every fifth sample of 800 to 11400; its
  speed varies);
- eron93br/carOBD (none): ``drive1.csv`` (car with gears in a town: pedal, speed; the brake is not
  given; two samples a second by the time since its start);
- Tang1001/Heat_pump (none): ``week 13 inlet water T in heat pump.csv``, ``week 13 outlet water T in
  heat pump.csv`` (heat pump of a building by the minute: temperatures of the water that enters and
  that leaves it; it is switched, and no water flows at night; three days and two days);
- RuudVelo/ML-Engineer-Udacity (none): ``2017_02_24_20_56_22.csv`` (cyclist with three intervals:
  power, rate of the heart);
- JRavenelco/levitador-benchmark (MIT): ``dataset_chirp_20251217_210058.txt`` (ball that a magnet
  holds under feedback while its reference sweeps: voltage, place of the ball, from sample 2040);
- batterysim/equiv-circ-model (MIT): ``cell-cycling-10c-24c-40c.csv`` (cell of a Nissan Leaf that is
  charged, at last by constant voltage, and discharged by constant current: current, voltage, logged
  at intervals that vary and read every five minutes).

The set ``eighth`` is for one measurement at the end: 13 recordings of other sources than those of
the sets before, three of several inputs, chosen by plots and documents and split before anything
was run on any:

- leopoldch/vehicle-dynamics-identification (none): ``input_delta1``, ``output_Fy1``,
  ``input_delta2``, ``output_Fy2`` (car DYNA of the laboratory Heudiasyc that somebody drives:
  steering angle, lateral force, every fourth sample; two drives);
- RockyJBL/Tailsitter-hovering-dataset (none): ``manual_altitude_1.mat``, ``manual_altitude_2.mat``
  of ``dataset`` (hovering tail-sitter with its autopilot that a pilot flies: control of yaw, rate
  of yaw, both smoothed by a moving average, every fourth sample; two flights);
- c-howley/acid-base-pH-model (none): of ``sample_data`` the files
  ``2025.02.24-005_control_pH7_from_basic.csv``, ``2025.02.24-008_control_pH7_from_acidic.csv``
  (vessel of a course into which acid flows while a relay switches the pump of the base: its speed,
  pH, logged at intervals that vary and read at 2 Hz; two runs);
- HydroGeoSines/HydroGeoSines (CC BY-NC-ND): ``death_valley.csv`` of ``tests/data/death_valley``
  (well BLM-1 by the hour: pressure of the air, gravity of the earth tide as computed, level);
- TheCasperKnudsen/Master_Thesis_2021_Results_MPC_for_Sanitation_Networks (MIT):
  ``Rounded_meas_lab_data.mat`` of ``System_Identification/Data`` (sewer of the Smart Water
  Infrastructures Laboratory at Aalborg, a pipe that ends in a tank whose pump rests while the level
  is low: flows into the pipe, out of the tank and into the pipe from the side, level of the tank,
  every fourth sample from 600 s);
- CEAOD/Data (none): ``Air.csv``, ``PAR.csv`` of ``GH_Tomato/UAzAbenDataKubota`` (greenhouse of
  tomatoes in Tucson that is heated and cooled under feedback, by ten minutes: temperature outdoors,
  light, temperature indoors, of which one missing row is interpolated; samples 2000 to 6500);
- rssalessio/Control-Linear-Vibrations (none): ``data0000.txt``, ``data0001.txt``,
  ``data0002.txt`` of ``rand_kmed_nomass`` in ``src/Tests/Identification`` as ``cart_0.txt``,
  ``cart_1.txt``, ``cart_2.txt`` (cart between a motor and a spring at Milan: voltage in steps of
  random height, place, every second sample; its friction holds it in places);
- CiganOliviu/brushless-DC-electric-motor-identification (MIT): ``dataset.mat`` (motor without
  brushes: duty cycle, speed, every second sample; it turns one way, then the other);
- cellularmitosis/logs (MIT): ``controller.csv`` of ``20180115-tec-calibration/run3``
  (thermoelectric chamber under PID: power in per cent, temperature, every fourth sample);
- hahnicity/ventMAP (GPL-3): ``0017_02_55_40_1to1000.csv_test`` of ``ventmap/tests/samples``
  (patient whom a ventilator PB-840 supports: pressure in the airway, flow);
- wenlinzhangzwl/Li-ion-battery-equivalent-circuit-parameterization (none; Zhang, Ahmed and Habibi
  2022): ``HWFET_25degC_0p8.mat`` of ``data`` (cell EVE 280 of iron phosphate in a driving cycle
  that is repeated: current, voltage, every tenth sample of 50000 to 88300);
- kobyhuazai/Vibration (none): ``impact_pt8.txt``, ``accel-pt18.txt``, ``impact_pt18.txt``,
  ``accel-pt8.txt`` (structure that a hammer strikes at one point and whose acceleration is measured
  at another, then the other way round, of which reciprocity makes one and the same response);
- ZhelunChen/HILFT-ASHP-DEMO (MIT): ``data.csv`` of ``data/Atlanta/Eff/STD2019`` and of
  ``data/Atlanta/Eff/Default`` as ``data_STD2019.csv``, ``data_Default.csv`` (heat pump of the
  National Institute of Standards and Technology by the minute under feedback of a room that its
  laboratory imitates: power of the outdoor unit, temperature of the air that it supplies, at rest
  while the fan is off; two days).

The set ``ninth`` is for one measurement at the end: 7 recordings of other sources than those of the
sets before, one of several inputs, chosen by plots and documents and split before anything was run
on any:

- tonykhkim/System-Identification (none): ``gt1_forPython.mat`` (car that somebody drives in bends:
  angle of the wheels, rate of yaw, every tenth sample of 3000 to 44000);
- versi379/Quadcopter-System-Identification (none): ``input_output_data_12.mat`` of
  ``data/input_output_data_MATLAB`` (quadrotor under feedback: thrust, height, every tenth sample of
  3500 to 24500; the interval varies by a few per cent);
- LuisM78/Occupancy-detection-data (none; Candanedo and Feldheim 2016): ``datatraining.txt`` (office
  by five minutes: light, temperature; somebody there, carbon dioxide);
- zhouhaoyi/ETDataset (CC BY-ND): ``ETTh1.csv`` of ``ETT-small`` (transformer of a grid by the hour:
  three reactive loads, temperature of its oil);
- opatiny/micromouse (CERN-OHL-P): ``testPid2.csv`` of ``matlab/data`` (motor of a small robot under
  PID: command, speed in steps of its encoder);
- jmnzzz210/IE0431-proyecto (MIT): ``datos_motor-3-3_lambda.csv`` of ``Data`` (motor of a course
  under feedback: what its controller sends, speed with outliers, by the course of the signals and
  not by their headings; logged at intervals that vary and read every 31 milliseconds).

The set ``tenth`` is for one measurement at the end: 6 recordings of other sources than those of the
sets before, four of several inputs, chosen by plots and documents and split before anything was run
on any:

- prakharsethi17/Attitude-Control-of-Quadcopter (none): of ``Decoupled 3-DoF`` the files
  ``Pitch/combined_exp1_1.csv`` and ``Roll/combined_exp1.csv`` (quadrotor on a rig that turns about
  one axis: settings of its four motors in steps of random height, angle of pitch or of roll, every
  tenth sample from 120 s and from 100 s);
- wackypiyush/Solar_Plants (none): ``Plant_1_Weather_Sensor_Data.csv`` (solar plant in India by the
  quarter of an hour: irradiation, temperature of the air, temperature of a module; missing rows are
  interpolated);
- YANGOnion/Rainfall-runoff-modelling-in-R (none): ``66193.csv`` of ``hydro_modelling/input`` (river
  basin by the day: rainfall, potential evaporation, runoff, samples 4000 to 8000);
- mauicv/servo-sysid (none): ``real-action-state-dataset.json`` of ``src/sysid/dataset`` (servo with
  an arm: angle that is asked for, angle; random binary, triangular and square sequences, before
  each of which the arm returns);
- EzeSabatella/CSV (none; package tsibbledata of R): ``vic_elec.csv`` (electricity of Victoria by
  the hour: temperature, demand; the first 4500 hours of 2012).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from recordings_of_others import (
    CSV,
    PLAIN,
    Record,
    columns_of,
    content_of,
    first_samples_of,
    signals_of,
)


def seventh(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 12, of one input and one output each."""
    table = partial(columns_of, folder)

    def exchanger() -> list[np.ndarray]:
        content = content_of(folder / "measurement_steps_all_2022_06_16_21_40_PRBS.mat")
        return [content["u"][5::5, 0], content["x"][5::5, 1]]

    def mirror() -> list[np.ndarray]:
        def sums(signal: str) -> np.ndarray:
            parts = [np.load(folder / f"{signal}_300mV_{part}.npy") for part in ("train", "test")]
            return np.concatenate([part[:4000, :, 0, 1].sum(axis=1) for part in parts])

        return [sums("u"), sums("y")]

    def shaken(u: int, y: int, part: slice) -> list[np.ndarray]:
        names = [f"1999_921_CHY{station}_NS.csv" for station in ("027", "046")]
        parts = [table(name, u, y, **CSV) for name in names]
        return [np.concatenate([each[part] for each in both]) for both in zip(*parts, strict=True)]

    def flight() -> list[np.ndarray]:
        content = content_of(folder / "Data_graphready.mat")
        return [content["inr"][3800:8400, 1], content["outr"][3800:8400, 3]]

    def bench() -> list[np.ndarray]:
        values = np.genfromtxt(folder / "recorded_data.txt", max_rows=7600)[100::2]
        return [values[:, 4] - values[:, 5], values[:, 2]]

    def model_car() -> list[np.ndarray]:
        return [each[800:11_400:5] for each in table("rawdata.csv", 9, 7, **CSV)]

    def pump() -> list[np.ndarray]:
        names = [f"week 13 {side} water T in heat pump.csv" for side in ("inlet", "outlet")]
        tables = [pd.read_csv(folder / name, sep=";", decimal=",") for name in names]
        return [each.iloc[:, 1].to_numpy() for each in tables]

    def ball() -> list[np.ndarray]:
        both = table("dataset_chirp_20251217_210058.txt", 5, 1, encoding="latin1")
        return [each[2040:] for each in both]

    def cell() -> list[np.ndarray]:
        name = folder / "cell-cycling-10c-24c-40c.csv"
        seconds, *both = np.genfromtxt(name, **CSV, usecols=(1, 8, 9)).T
        return [np.interp(300.0 * np.arange(10, 2010), seconds, each) for each in both]

    slow, fast = slice(5500, 18_300, 4), slice(6000, 13_000, 2)
    yield from first_samples_of(
        (
            ("plate exchanger", exchanger, 2400, 1413, 0.1),
            ("steering mirror", mirror, 4000, 4000, 6400.0),
            ("shaking table", lambda: shaken(7, 1, slow), 3200, 3200, 51.2),
            ("shaken storeys", lambda: shaken(5, 3, fast), 3500, 3500, 102.4),
            ("TREX 550", flight, 2800, 1800, 100.0),
            ("bench helicopter", bench, 2250, 1500, 10.0),
            ("model car", model_car, 1300, 820, 20.0),
            ("car in a town", lambda: table("drive1.csv", 11, 2, **CSV), 1700, 1009, 2.0),
            ("heat pump", pump, 4320, 2880, 1 / 60),
            ("heart", lambda: table("2017_02_24_20_56_22.csv", 6, 2, **CSV), 800, 481, 1.0),
            ("held ball", ball, 900, 547, 100.0),
            ("Leaf cell", cell, 1200, 800, 1 / 300),
        )
    )


def eighth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 13, of one output; three have several inputs."""
    table = partial(columns_of, folder)

    def joined(parts: Sequence[list[np.ndarray]]) -> list[np.ndarray]:
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def every(step: int, signals: list[np.ndarray]) -> list[np.ndarray]:
        return [each[::step] for each in signals]

    def drives() -> list[np.ndarray]:
        names = [(f"input_delta{k}", f"output_Fy{k}") for k in (1, 2)]
        return joined([[np.loadtxt(folder / name)[::4] for name in both] for both in names])

    def hovering() -> list[np.ndarray]:
        logs = [content_of(folder / f"manual_altitude_{k}.mat") for k in (1, 2)]
        keys = ("actuator_controls", "local_rate")
        return joined([[log[key][:9000:4, 2] for key in keys] for log in logs])

    def vessel() -> list[np.ndarray]:
        def read(name: str, samples: int) -> list[np.ndarray]:
            how = {**CSV, "usecols": (1, 3, 6), "encoding": "latin1"}
            seconds, *both = np.genfromtxt(folder / f"2025.02.24-00{name}.csv", **how).T
            at = seconds[0] + 0.5 * np.arange(samples)
            return [np.interp(at, seconds, each) for each in both]

        parts = (("5_control_pH7_from_basic", 2070), ("8_control_pH7_from_acidic", 1800))
        return joined([read(*part) for part in parts])

    def well() -> list[np.ndarray]:
        level, *given = np.genfromtxt(folder / "death_valley.csv", **CSV)[::4, 1:4].T
        return [np.column_stack(given), level]

    def sewer() -> list[np.ndarray]:
        content = content_of(folder / "Rounded_meas_lab_data.mat", simplify_cells=True)
        rows = content["dataStructure"]["data"][:, 1200::4]
        return [rows[[8, 9, 12]].T, rows[7]]

    def greenhouse() -> list[np.ndarray]:
        columns = (("Air.csv", 5), ("PAR.csv", 1), ("Air.csv", 1))
        how = {**CSV, "max_rows": 6500}
        signals = [np.genfromtxt(folder / name, **how)[2000:, k] for name, k in columns]
        times = np.arange(4500)
        known = [np.flatnonzero(np.isfinite(each)) for each in signals]
        *given, indoors = (
            np.interp(times, at, each[at]) for at, each in zip(known, signals, strict=True)
        )
        return [np.column_stack(given), indoors]

    def cart() -> list[np.ndarray]:
        first, second, held = (table(f"cart_{k}.txt", 0, 2) for k in range(3))
        fitted = [each[500:5900:2] for each in joined([first, second])]
        return joined([fitted, every(2, held)])

    def brushless() -> list[np.ndarray]:
        signals = content_of(folder / "dataset.mat", simplify_cells=True)["cigan"]["Y"]
        return [signals[k]["Data"][::2].astype(float) for k in (2, 1)]

    def patient() -> list[np.ndarray]:
        lines = (folder / "0017_02_55_40_1to1000.csv_test").read_text().splitlines()
        measured = [line.split(",") for line in lines if not line.startswith("B")][:6000]
        return list(np.array(measured, dtype=float).T[::-1])

    def cell() -> list[np.ndarray]:
        measured = content_of(folder / "HWFET_25degC_0p8.mat", simplify_cells=True)["meas"]
        return [measured[key][50_000:88_300:10] for key in ("Current", "Voltage")]

    def struck() -> list[np.ndarray]:
        names = [(f"impact_pt{a}.txt", f"accel-pt{b}.txt") for a, b in ((8, 18), (18, 8))]
        return joined([[np.loadtxt(folder / name)[:2500, 1] for name in both] for both in names])

    def pump() -> list[np.ndarray]:
        days = [table(f"data_{day}.csv", 2, 5, **CSV) for day in ("STD2019", "Default")]
        return joined([[each[300:1270] for each in day] for day in days])

    yield from first_samples_of(
        (
            ("driven car", drives, 2000, 1663, 25.0),
            ("tail-sitter", hovering, 2250, 2250, 25.0),
            ("neutralisation", vessel, 2070, 1800, 2.0),
            ("well", well, 2700, 1471, 1 / 3600),
            ("sewer", sewer, 3500, 2200, 0.5),
            ("greenhouse", greenhouse, 3000, 1500, 1 / 600),
            ("cart on a spring", cart, 2700, 1100, 100.0),
            ("brushless motor", brushless, 1900, 2267, 1 / 0.00144),
            (
                "Peltier chamber",
                lambda: every(4, table("controller.csv", 2, 1, **PLAIN)),
                *(2100, 1900, 1.0),
            ),
            ("ventilated patient", patient, 4000, 2000, 50.0),
            ("EVE cell", cell, 2300, 1530, 1.0),
            ("reciprocal blows", struck, 2500, 2500, 4000.0),
            ("air-source heat pump", pump, 970, 970, 1 / 60),
        )
    )


def ninth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 7, of one output; one has three inputs."""
    table = partial(columns_of, folder)

    def car() -> list[np.ndarray]:
        signals = signals_of(folder, "gt1_forPython.mat", "WSA_rad", "Yaw_Rate")
        return [each[3000:44_000:10] for each in signals]

    def height() -> list[np.ndarray]:
        keys = "controller_thrust", "pose_z"
        signals = signals_of(folder, "input_output_data_12.mat", *keys)
        return [each[3500:24_500:10].astype(float) for each in signals]

    def office(u: int, y: int) -> list[np.ndarray]:
        return [each[::5] for each in table("datatraining.txt", u, y, **CSV)]

    def transformer() -> list[np.ndarray]:
        columns = np.genfromtxt(folder / "ETTh1.csv", **CSV, max_rows=4500)
        return [columns[:, [2, 4, 6]], columns[:, 7]]

    def course() -> list[np.ndarray]:
        name = folder / "datos_motor-3-3_lambda.csv"
        seconds, *both = np.genfromtxt(name, **CSV, usecols=(0, 2, 3)).T
        return [np.interp(1.0 + 0.031 * np.arange(3000), seconds, each) for each in both]

    yield from first_samples_of(
        (
            ("car in bends", car, 2600, 1500, 10.0),
            ("quadrotor's height", height, 1300, 800, 10.0),
            ("light in an office", lambda: office(4, 2), 1000, 628, 1 / 300),
            ("carbon dioxide", lambda: office(7, 5), 1000, 628, 1 / 300),
            ("transformer", transformer, 3000, 1500, 1 / 3600),
            ("micromouse", lambda: table("testPid2.csv", 3, 2, **CSV), 500, 248, 1 / 0.011),
            ("motor of a course", course, 1900, 1100, 1 / 0.031),
        )
    )


def tenth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 6, of one output; four have several inputs."""
    table = partial(columns_of, folder)

    def on_a_rig(name: str, first: int) -> list[np.ndarray]:
        rows = np.genfromtxt(folder / name, **CSV)[first::10]
        return [rows[:, 3:7], rows[:, 1]]

    def module() -> list[np.ndarray]:
        measured = pd.read_csv(folder / "Plant_1_Weather_Sensor_Data.csv")
        minutes = (pd.to_datetime(measured["DATE_TIME"]) - pd.Timestamp("2020-05-15")).dt
        at, times = minutes.total_seconds().to_numpy() / 900.0, np.arange(3260)
        names = "IRRADIATION", "AMBIENT_TEMPERATURE", "MODULE_TEMPERATURE"
        *given, warm = (np.interp(times, at, measured[name].to_numpy()) for name in names)
        return [np.column_stack(given), warm]

    def river() -> list[np.ndarray]:
        rows = np.genfromtxt(folder / "66193.csv", **CSV)[4000:8000]
        return [rows[:, [2, 4]], rows[:, 1]]

    def servo() -> list[np.ndarray]:
        tests = json.loads((folder / "real-action-state-dataset.json").read_text())["data"]
        kinds = "prbs", "triangle", "square"
        kept = [test for kind in kinds for test in tests if test["type"] == kind]
        return [np.concatenate([t[key] for t in kept]) for key in ("actions", "sensor_data")]

    def demand() -> list[np.ndarray]:
        return [each[:9000:2] for each in table("vic_elec.csv", 2, 1, **CSV)]

    yield from first_samples_of(
        (
            ("pitch on a rig", lambda: on_a_rig("combined_exp1_1.csv", 12_000), 2900, 1500, 10.0),
            ("roll on a rig", lambda: on_a_rig("combined_exp1.csv", 10_000), 3600, 2400, 10.0),
            ("solar module", module, 2160, 1100, 1 / 900),
            ("river basin", river, 2500, 1500, 1 / 86_400),
            ("servo with an arm", servo, 1050, 600, 50.0),
            ("grid of Victoria", demand, 3000, 1500, 1 / 3600),
        )
    )
