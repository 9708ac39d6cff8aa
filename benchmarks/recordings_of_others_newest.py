"""The newest sets of recordings of others for ``public_recordings.py``: sources, readers, splits.

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

The set ``twelfth`` is for one measurement at the end: 6 recordings of other sources than those of
the sets before, two of several inputs, chosen by plots and documents and split before anything was
run on any:

- PREDICT-EPFL/polydome (none; Shi, Lian and Jones 2022): of ``dataset/data`` the files
  ``raw_2021-07-15_2021-09-08.csv`` and ``raw_2021-10-31_2022-01-14.mat`` (building at Lausanne that
  a heat pump cools in summer, samples 0 to 3300, and heats in winter, samples 200 to 2600, under
  feedback, by the quarter of an hour: its power, temperature outdoors, radiation, mean of the four
  temperatures indoors; missing values are interpolated);
- artursbm/system-identification (none): ``PRBSA02.DAT`` of ``tarefa_5`` (plant of a course at Belo
  Horizonte under a random binary signal, both channels in volts, with outliers and a drift; samples
  100 to 2950);
- raj-gun/NonSysID (BSD; Lacerda Junior, Almeida and Milani 2017): of
  ``Examples/Electro-mechanical_system/Data`` the files ``x_cc.csv`` and ``y_cc.csv`` (motor that
  drives a generator under a random binary signal: voltage, speed, every hundredth sample of 10000
  to 410000; the interval is not stated and counts as one second);
- iotctrl/iotctrl-results (MIT): of ``csv/VP`` the files ``MFC-lambda30alpha9-test2.csv`` and
  ``Cascade-Quasi-R.csv`` (motor under feedback: voltage, and its tachometer, samples 2650 to 4050
  and 5600 to 7000 of the first run, or its place in the second run).

The set ``thirteenth`` is for one measurement at the end: 8 recordings of other sources than those
of the sets before, two of several inputs, chosen by plots and documents and split before anything
was run on any:

- antonior92/MultipleShootingPEM.jl (MIT): of ``examples/ex2/processed_data`` the files
  ``training_set.csv`` and ``test_set.csv`` (level process station LabVolt 3503: voltage in steps of
  random height, level; two experiments);
- Barkiegitter/system_identification (none): of ``RPA3 trials`` the files ``yxrsa.csv`` and
  ``prdid.csv`` (patrol vessel in the port of Rotterdam that somebody steers: angle of its rudder,
  rate of turn as the heading gained in a second, logged at intervals that vary and read at 1 Hz;
  seconds 470 to 1890, in which no message is missing for more than two);
- Andy1978/Brautomat (GPL-3): ``Wasser20l.log`` of ``GUI`` (kettle of a brewery with 20 litres of
  water that a relay heats in steps of the reference: heater, temperature, read every five seconds);
- linklab-uva/deep-dynamics (GPL-3): ``Putnam_park2023_run4_2.csv`` of ``deep_dynamics/data``
  (racing car AV-21 of the Indy Autonomous Challenge with its autopilot: throttle and brake, speed,
  every fifth sample of 6000 to 11900; steering angle, rate of yaw, every fifth sample of 1500 to
  11900, while its speed varies);
- mitchallain/BeagleBone-excavator (none): ``manual_mitch_1102_1814.csv`` of
  ``jupyter/ML/trial_data`` and ``manual_orlando_1102_1405.csv`` of ``tests/data`` (model of an
  excavator that somebody moves: command and place of the cylinder of its bucket, which has ends, in
  the first file, command and angle of its swing in the second, logged at intervals that vary and
  read at 10 Hz);
- LuisM78/Reconstruction_of_indoor_temperatures (none; Candanedo, Feldheim and Deramaix 2018):
  ``energy_weather_temp.zip`` (passive house by the hour from 2016-11-15: energies of the heater and
  of the appliances, temperature outdoors, temperature of the first room; missing values are
  interpolated).

The set ``fourteenth`` is for one measurement at the end: 8 recordings, two of several inputs,
chosen by plots and documents and split before anything was run on any:

- amey-waghmare/Twin-Rotor-System (none): ``io_data_22.csv`` and ``io_data_22_2nd.csv`` of ``ARMAX``
  (twin rotor under feedback: both rotors, first angle; two experiments);
- pastas/pastas (MIT): ``prec.csv``, ``evap.csv``, ``temp.csv``, ``heads.csv`` of
  ``doc/examples/data_forecast`` (groundwater by the day from 1998: precipitation, evaporation,
  temperature, level);
- vhsabino/MATLAB (none; the set ``third`` has a recording of it as well): ``data_w2.csv`` and
  ``data_ground_19_08_23.csv`` of ``robocup/w_tuning`` (football robot: demand, rate of turn, every
  tenth sample; demand, speed of a wheel, every twentieth);
- FelipeEduardoMarcondes/SYSTEM-IDENTIFICATION-AERO (none): ``chirp_0601_19-39.csv`` and
  ``chirp_0608_18-44.csv`` of ``PYTHON/dados`` (pendulum with a propeller: power, angle, read every
  50 milliseconds; sweeps of two days);
- nbauersfeld/tclab (none): ``tclab.model.q.3.csv`` of ``data`` (transistor: its heater, its
  temperature);
- orri93/analysis (none): ``200414c.csv`` and ``200415b.csv`` of ``var/pid/csv`` (boiler under
  feedback: power, temperature, read every second; two runs);
- HelmutQualtinger/kinomap (none): ``race.csv`` (cyclist on an ergometer: power, rate of the heart).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from recordings_of_others import CSV, PLAIN, Record, columns_of, content_of, first_samples_of

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


def twelfth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 6, of one output; two have three inputs."""
    causes = ["power", "weather_temp", "weather_rad"]

    def building(rows: pd.DataFrame) -> list[np.ndarray]:
        rooms = rows[[f"sensor_temp_{k}" for k in (1, 2, 3, 4)]].interpolate().mean(axis=1)
        return [rows[causes].interpolate().to_numpy(), rooms.to_numpy()]

    def cooled() -> list[np.ndarray]:
        return building(pd.read_csv(folder / "raw_2021-07-15_2021-09-08.csv")[:3300])

    def heated() -> list[np.ndarray]:
        log = content_of(folder / "raw_2021-10-31_2022-01-14.mat", simplify_cells=True)["exp"]
        names = [key for key in log if key.startswith("sensor_temp")]
        return building(pd.DataFrame({key: log[key] for key in [*causes, *names]})[200:2600])

    def plant() -> list[np.ndarray]:
        return list(np.loadtxt(folder / "PRBSA02.DAT")[100:2950, 1:].T)

    def generator() -> list[np.ndarray]:
        return [np.loadtxt(folder / f"{key}_cc.csv")[10_000:410_000:100] for key in "xy"]

    def motor(run: str, output: str, *parts: slice) -> list[np.ndarray]:
        rows = pd.read_csv(folder / f"{run}.csv")
        return [np.concatenate([rows[key][part] for part in parts]) for key in ("VM", output)]

    runs = "MFC-lambda30alpha9-test2", "Cascade-Quasi-R"
    parts = slice(2650, 4050), slice(5600, 7000)
    yield from first_samples_of(
        (
            ("cooled building", cooled, 2200, 1100, 1 / 900),
            ("heated building", heated, 1600, 800, 1 / 900),
            ("plant of a course", plant, 1900, 950, 1 / 2.033),
            ("motor and generator", generator, 2500, 1500, 1.0),
            ("tachometer", lambda: motor(runs[0], "VT", *parts), 1400, 1400, 50.0),
            ("place of a motor", lambda: motor(runs[1], "VP", slice(2000)), 1300, 700, 50.0),
        )
    )


def thirteenth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 8, of one output; two have several inputs."""
    table = partial(columns_of, folder)

    def vessel() -> list[np.ndarray]:
        second = np.arange(470.0, 1890.0)
        rudder = sentences(folder / "yxrsa.csv", 1)
        times, heading = sentences(folder / "prdid.csv", 3)
        turned = np.interp(second, times, np.unwrap(heading, period=360.0))
        return [np.interp(second, *rudder)[1:], np.diff(turned)]

    def kettle() -> list[np.ndarray]:
        rows = np.loadtxt(folder / "Wasser20l.log")
        times = rows[:, 0] - rows[0, 0] + rows[:, 1] / 1e6
        return [np.interp(np.arange(0.0, 6400.0, 5.0), times, rows[:, k]) for k in (6, 2)]

    def car(first: int, output: str, *inputs: str) -> list[np.ndarray]:
        rows = pd.read_csv(folder / "Putnam_park2023_run4_2.csv")[first::5]
        return [rows[list(inputs)].to_numpy().squeeze(), rows[output].to_numpy()]

    def excavator(trial: str, part: str, last: float) -> list[np.ndarray]:
        rows = pd.read_csv(folder / f"manual_{trial}.csv")
        moments = np.arange(0.1, last, 0.1)
        return [np.interp(moments, rows["Time"], rows[f"{part} {key}"]) for key in ("Cmd", "Ms")]

    def house() -> list[np.ndarray]:
        rows = pd.read_csv(folder / "energy_weather_temp.zip", index_col=0, skipinitialspace=True)
        rows.index = pd.to_datetime(rows.index)
        hours = rows["2016-11-15":].resample("1h").mean().interpolate()
        return [hours[["ElectricHeater", "Appliances", "T_out"]].to_numpy(), hours["T1"].to_numpy()]

    levels = ("training_set.csv", "test_set.csv")
    pedals, turn = ("throttle_ped_cmd(%)", "brake_ped_cmd(kPa)"), ("omega(rad/s)", "delta(rad)")
    yield from first_samples_of(
        (
            ("level", lambda: table(levels, 1, 2, **CSV), 711, 359, 0.1),
            ("patrol vessel", vessel, 850, 569, 1.0),
            ("kettle", kettle, 860, 420, 0.2),
            ("racing car ahead", lambda: car(6000, "vx(m/s)", *pedals), 780, 400, 5.0),
            ("racing car that turns", lambda: car(1500, *turn), 1400, 680, 5.0),
            ("bucket", lambda: excavator("mitch_1102_1814", "Bucket", 90.8), 600, 307, 10.0),
            ("swing", lambda: excavator("orlando_1102_1405", "Swing", 183.5), 1200, 634, 10.0),
            ("passive house", house, 1240, 632, 1 / 3600),
        )
    )


def fourteenth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 8, of one output; two have several inputs."""
    table = partial(columns_of, folder)

    def twin_rotor() -> list[np.ndarray]:
        files = [folder / f"io_data_{part}.csv" for part in ("22", "22_2nd")]
        rows = np.concatenate([np.loadtxt(file, delimiter=",") for file in files])
        return [rows[:, :2], rows[:, 2]]

    def groundwater() -> list[np.ndarray]:
        files = [folder / f"{key}.csv" for key in ("prec", "evap", "temp", "heads")]
        days = [pd.read_csv(file, index_col=0).loc["1998-01-01":] for file in files]
        rows = pd.concat(days, axis=1).to_numpy()
        return [rows[:, :3], rows[:, 3]]

    def robot(file: str, step: int) -> list[np.ndarray]:
        return [each[:30_000:step] for each in table(file, 0, 1, **PLAIN)]

    def resampled(file: str, names: tuple[str, str, str], moments: np.ndarray) -> list[np.ndarray]:
        rows = pd.read_csv(folder / file)
        return [np.interp(moments, rows[names[0]], rows[key]) for key in names[1:]]

    def experiments(names: tuple[str, str, str], **moments: np.ndarray) -> list[np.ndarray]:
        parts = [resampled(f"{file}.csv", names, times) for file, times in moments.items()]
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def pendulum() -> list[np.ndarray]:
        sweeps = {
            "chirp_0601_19-39": np.arange(1e3, 50_500.0, 50.0),
            "chirp_0608_18-44": np.arange(2e3, 70_000.0, 50.0),
        }
        return experiments(("tempo_ms", "u_pct", "angulo_deg"), **sweeps)

    def boiler() -> list[np.ndarray]:
        runs = {"200414c": np.arange(1.0, 951.0), "200415b": np.arange(1.0, 1001.0)}
        return experiments(("time", "output", "temperature"), **runs)

    def cyclist() -> list[np.ndarray]:
        rows = pd.read_csv(folder / "race.csv")[:1690]
        return [rows["Power"].to_numpy(float), rows["Heart rate"].to_numpy(float)]

    yield from first_samples_of(
        (
            ("twin rotor", twin_rotor, 1473, 1130, 10.0),
            ("groundwater", groundwater, 2400, 1200, 1 / 86_400),
            ("robot that turns", lambda: robot("data_w2.csv", 10), 1000, 500, 50.0),
            ("motor of a wheel", lambda: robot("data_ground_19_08_23.csv", 20), 1000, 500, 25.0),
            ("pendulum with a propeller", pendulum, 990, 1360, 20.0),
            ("transistor", lambda: table("tclab.model.q.3.csv", 2, 4, **CSV), 800, 400, 1.0),
            ("boiler", boiler, 950, 1000, 1.0),
            ("ergometer", cyclist, 1150, 540, 1.0),
        )
    )


def sentences(file: Path, field: int) -> tuple[np.ndarray, np.ndarray]:
    """Seconds and one field of a log of NMEA sentences, of which some are there several times."""
    rows = pd.read_csv(file).drop_duplicates("timestamp").sort_values("timestamp")
    times = pd.to_datetime(rows["timestamp"]) - pd.Timestamp("2019-11-13 11:52:30")
    values = rows["content"].str.split(",").str[field].astype(float)
    return times.dt.total_seconds().to_numpy(), values.to_numpy()
