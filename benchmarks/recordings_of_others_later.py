"""Later sets of recordings of others for ``public_recordings.py``: sources, readers, splits.

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

The set ``fifth`` is for one measurement at the end: 18 recordings of other sources than those of
the sets before, chosen by plots and documents and split before anything was run on any:

- DanielMartensson/MataveID (MIT): ``MultivariableCylinders.csv`` (two hydraulic cylinders under
  feedback: reference, position of the second), ``HangingLoad.csv`` (load that hangs on a hydraulic
  system under proportional control: control signal, position, which answers otherwise upwards than
  downwards; every fifth sample);
- Abhay3757/PSO-Optimized-Dual-Attention-LSTM-for-MR-Damper-Force-Prediction (none; the experiment
  is NEES-2012-1158 by Dyke): ``ranran_50_converted.csv`` (magnetorheological damper whose voltage,
  which is not given, is random, too: velocity, force, every tenth sample);
- KIT-HYD/model-evaluation (MIT): ``p_ebni.csv``, ``q_host.csv`` of ``strace/data`` (mountain river
  by the hour: rain, discharge; hours 47000 to 50500 and 55500 to 57500);
- tylim2946/BCIT (Apache): ``temps.mat`` (house of straw bales: temperatures outdoors and indoors,
  every fourth sample, both halves);
- chrystalchern/mdof (BSD; the records are the California Geological Survey's):
  ``ferndaleoffshore_08dec2016_us20007z6r_ce89324p.zip``, ``nc73351710_ce89324p.zip`` (overpass at
  Painter Street in Rio Dell, whose modes are published, in two earthquakes: accelerations across
  of the middle column at the ground and at its top, every second sample);
- wattai/control-engineering-for-inverted-pendulum (none): ``for_measure_input_white_noise.csv``
  (wheel of a pendulum on wheels: white duty cycle, speed; from sample 100);
- PDLdeLange/RiderID (none; the experiment is by Moore, University of California, Davis):
  ``data.mat`` (person on a bicycle who is pushed seven times: lateral force, steering angle, every
  fourth sample of what was recorded);
- EmDash00/CPHS2017 (none; Yamagami et al. 2019): the files of ``analysis/CPHS_Upload/data/dp`` that
  begin with ``20170901-095154`` and ``20170901-095244`` as ``tracking_p2a3.csv`` and
  ``tracking_p3a3.csv`` (person who follows by hand: reference, hand, every third sample);
- decargroup/system_norm_koopman (MIT): ``faster.csv`` (beam of a rig for fatigue tests under
  feedback, Fortune et al. 2019: control signal, force, every fourth sample);
- marcocognetti/FrankaEmikaPandaDynModel (GPL-3): ``exciting_traj_torques.txt``,
  ``exciting_traj_velocity.txt`` (robot Panda under feedback, Gaz et al. 2019: torque and speed of
  its first axis, every tenth sample);
- ibpsa/modelica-ibpsa (BSD): ``PipeDataAIT151218.mos`` (district heating in Pongau by the quarter
  of an hour: temperatures at two ends of pipes whose flow varies);
- bryansgue/Identificacion_M100 (none): ``Identification.mat``, ``Validation.mat`` (quadrotor DJI
  M100 with its autopilot: demanded and measured speed ahead and rate of yaw; steps, then sines);
- MattiaDiMauro/Model-identification-and-state-estimation-for-a-multirotor-UAV (MIT): the files that
  begin with ``log_2`` and ``log_3`` as ``log_2.mat`` and ``log_3.mat`` (quadrotor ANT-X on a test
  bed under feedback: moment, rate of pitch, every second sample; a sweep, then doublets of six
  times its amplitude);
- jGomezSanz/TFG_finalCode (none): ``valLinea_MarshallMB15little.mat`` (guitar amplifier Marshall
  MB15: what is played, what comes out; samples 350000 to 356000);
- WDWidanage/PulseMultisineClass (MIT): ``Measured_PMS_50per_25degC.mat`` (lithium-ion battery at
  half its charge, Widanage et al. 2016: current, voltage; one pulse-multisine sent five times);
- ML-PSE/Machine_Learning_for_PSE (Apache; Fortuna et al. 2007): ``debutanizer_data.txt``
  (debutanizer of a refinery: temperature of the sixth tray, content of butane, shifted by its
  delay of 8 samples; the interval is not stated and counts as one second).

The set ``sixth`` is for one measurement at the end: 12 recordings of other sources than those of
the sets before, chosen by plots and documents and split before anything was run on any:

- EAGRE-water-wave-impact-modelling/FSI_Experiments (none; MARIN, OMAE 2023): of
  ``Exp3_irreg_waves_0.25m/gain_half`` the files ``WAVEMAKER_POS.h5m``, ``TIME_WAVEFLAP.h5m``,
  ``WAVE_FORE.h5m`` and ``TIME_WAVE.h5m`` (wave basin: place of the flap, irregular waves of 2.25 s
  at a probe, 7 s later, which is when the first waves arrive; every twentieth sample from 100 s);
- INTO-CPS-Association/example_digital-twin_incubator (none): of ``20200917_calibration_fan_12v``
  the files ``random_on_off_sequences.csv``, ``random_on_off_sequences_2.csv`` (incubator: heater
  switched at random, temperature of the air; one file for each part);
- saimh-ee/hvac-control (none; of the office building of Photon Energy): ``control_test.csv`` (room
  under feedback: wanted temperature, temperature, every third sample of 1800 to 13200);
- johnnv1/compensator_projects (MIT): ``20190701-23:37:34-Fs10-N4000-Nv100.csv`` (motor with a
  belt and a tachometer: duty cycle in steps of random height, voltage; it has a dead zone);
- kd0aij/impulse-response (GPL-3): of ``S250AQ/2016-12-13`` the files
  ``log1_vehicle_rates_setpoint_0.csv``, ``log1_vehicle_attitude_0.csv`` (racing quadrotor with its
  autopilot: demanded and measured rate of roll, logged at intervals that vary and read at 80 Hz);
- VictorRenkin/MECA0062-1_vibration_testing (none): ``DPsv00002.mat`` of ``first_lab`` (structure
  of a course at Liege, whose modes the course computed: one blow of a hammer, its force,
  acceleration of the second accelerometer; the end of its ringing is for validation);
- ramvasudevan/soft-robot-koopman (none; Bruder et al. 2019): ``softrobot_train-13_val-4.mat``, its
  tenth trial (soft arm: second pressure, second coordinate of its tip; the third pressure, which is
  not given, moves it as well);
- boschresearch/Bosch-Engine-Datasets (CC BY-SA): ``raw_000010_measurement_000000.csv`` of
  ``gengine1`` (gasoline engine whose speed varies, too: load, nitrogen oxides of 6000 samples, and
  temperature of the exhaust manifold, every fifth sample);
- mgmike1011/System_identification_lab (none): ``dane.mat`` (analogue circuit of a course at Poznan
  that stands for a process: one filter, from sample 300);
- dainnovation722/Time-Series-Regression-By-FFT (none; Fortuna et al. 2007): ``SRU_data.txt``
  (recovery of sulphur in a refinery: secondary air under feedback, hydrogen sulphide, samples 4600
  to 7000; other gases vary as well; the interval is not stated and counts as one minute);
- malik-robert/HSM150-data (none): ``idf_pos_0.06_1.mat``, ``idf_pos_0.065_1.mat`` (drive HSM150
  that starts from rest and has one step, of 0.01 and of 0.015 Nm: torque, speed, every twentieth
  sample).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import h5py
import numpy as np
from recordings_of_others import (
    CSV,
    PLAIN,
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


def accelerations_of(file: Path, channel: int) -> np.ndarray:
    """Corrected accelerations of a channel in a zipped record, written in fields of 10 characters.

    A file that is missing raises FileNotFoundError.
    """
    with ZipFile(file) as record:
        names = {name.lower(): name for name in record.namelist()}
        lines = record.read(names[f"chan{channel:03}.v2"]).decode("latin1").splitlines()
    start = next(k for k, line in enumerate(lines) if "of accel data" in line)
    rows = lines[start + 1 : start + 1 + -(-int(lines[start].split()[0]) // 8)]
    fields = [row[k : k + 10] for row in rows for k in range(0, len(row.rstrip()), 10)]
    return np.array(fields, dtype=float)


def fifth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 18, of one input and one output each."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def every(step: int, signals: list[np.ndarray]) -> list[np.ndarray]:
        return [each[::step] for each in signals]

    def river() -> list[np.ndarray]:
        hours = np.r_[47_000:50_500, 55_500:57_500]
        return [np.loadtxt(folder / name)[hours] for name in ("p_ebni.csv", "q_host.csv")]

    def overpass() -> list[np.ndarray]:
        shaken = (
            ("ferndaleoffshore_08dec2016_us20007z6r_ce89324p.zip", slice(0, 7000, 2)),
            ("nc73351710_ce89324p.zip", slice(1500, 6500, 2)),
        )
        return [
            np.concatenate(
                [accelerations_of(folder / name, channel)[part] for name, part in shaken]
            )
            for channel in (3, 7)
        ]

    def cyclist() -> list[np.ndarray]:
        recorded = content_of(folder / "data.mat", simplify_cells=True)["raw"]
        return [recorded["w"], recorded["y"][:, 1]]

    def person() -> list[np.ndarray]:
        parts = [every(3, table(f"tracking_p{k}a3.csv", 2, 3, **PLAIN)) for k in (2, 3)]
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def panda() -> list[np.ndarray]:
        names = [f"exciting_traj_{signal}.txt" for signal in ("torques", "velocity")]
        return [np.loadtxt(folder / name).reshape(-1, 7)[:, 0] for name in names]

    def copter(speed: str) -> list[np.ndarray]:
        parts = [
            matlab(f"{name}.mat", f"{speed}_ref_{end}", f"{speed}_{end}")
            for name, end in (("Identification", "iden"), ("Validation", "vali"))
        ]
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def flight(number: int, part: slice) -> list[np.ndarray]:
        log = content_of(folder / f"log_{number}.mat", simplify_cells=True)
        rate, moment = log["q"], log["M"]
        known = np.interp(rate["timestamp"], moment["timestamp"], moment["value"])
        return [known[part], rate["value"][part]]

    def bed() -> list[np.ndarray]:
        parts = flight(2, slice(9500, 16_300, 2)), flight(3, slice(8300, 14_700, 2))
        return [np.concatenate(both) for both in zip(*parts, strict=True)]

    def battery() -> list[np.ndarray]:
        measured = content_of(folder / "Measured_PMS_50per_25degC.mat", simplify_cells=True)["data"]
        return [measured["Current"], measured["Voltage"]]

    def amplifier() -> list[np.ndarray]:
        played = content_of(folder / "valLinea_MarshallMB15little.mat")["val"]
        return list(played[350_000:356_000].T)

    cylinders, load = ("MultivariableCylinders.csv", 2, 4), ("HangingLoad.csv", 3, 2)
    damper, fatigue = ("ranran_50_converted.csv", 5, 6), ("faster.csv", 2, 3)
    white, pipe = ("for_measure_input_white_noise.csv", 1, 2), ("PipeDataAIT151218.mos", 1, 2)
    column, temperatures = ("debutanizer_data.txt", 4, 7), ("temps.mat", "ExtTemp", "IntTemp")
    yield from first_samples_of(
        (
            ("cylinder", lambda: table(*cylinders, **PLAIN), 1500, 889, 10.0),
            ("hanging load", lambda: every(5, table(*load, **PLAIN)), 2400, 812, 10.0),
            ("random damper", lambda: every(10, table(*damper, **CSV)), 4200, 2100, 300.5),
            ("mountain river", river, 3500, 2000, 1 / 3600),
            ("house of straw", lambda: every(4, matlab(*temperatures)), 1343, 1343, 1 / 768),
            ("overpass", overpass, 3500, 2500, 50.0),
            ("pendulum wheel", lambda: table(*white, **PLAIN, skip_header=100), 1200, 705, 200.0),
            ("pushed cyclist", lambda: every(4, cyclist()), 2000, 985, 50.0),
            ("tracking person", person, 901, 901, 20.0),
            ("fatigue rig", lambda: every(4, table(*fatigue, **CSV)), 3500, 1800, 32.2),
            ("Panda", lambda: every(10, panda()), 1350, 704, 100.0),
            ("heating pipe", lambda: table(*pipe, **PLAIN, skip_header=2), 450, 222, 1 / 900),
            ("M100 ahead", lambda: copter("ul"), 1801, 1351, 30.0),
            ("M100 in yaw", lambda: copter("w"), 1801, 1351, 30.0),
            ("ANT-X", bed, 3400, 3200, 125.0),
            ("guitar amplifier", amplifier, 4000, 2000, 44_100.0),
            ("multisine battery", battery, 1800, 1200, 10.0),
            ("debutanizer", lambda: table(*column, skip_header=5), 1600, 794, 1.0),
        )
    )


def sixth(folder: Path) -> Iterator[Record]:
    """Recordings for one measurement at the end: 12, of one input and one output each."""
    table = partial(columns_of, folder)

    def basin() -> list[np.ndarray]:
        def read(name: str, key: str) -> np.ndarray:
            with h5py.File(folder / f"{name}.h5m") as file:
                return file[key][:].ravel()

        flap = read("WAVEMAKER_POS", "100.00 Hz/Flap 3 Pos")
        at = read("TIME_WAVEFLAP", "100.00 Hz/Time")
        probe = read("TIME_WAVE", "200.05 Hz/Time"), read("WAVE_FORE", "200.05 Hz/WAVE.FORE")
        part = slice(10_000, 110_000, 20)
        return [flap[part], np.interp(at[part] + 7.0, *probe)]

    def incubator() -> list[np.ndarray]:
        names = [f"random_on_off_sequences{end}.csv" for end in ("", "_2")]
        rows = [np.genfromtxt(folder / name, dtype=str, **CSV)[:, [2, 6]] for name in names]
        heater, temperature = np.concatenate(rows).T
        return [(heater == "True").astype(float), temperature.astype(float)]

    def racer() -> list[np.ndarray]:
        demanded = table("log1_vehicle_rates_setpoint_0.csv", 0, 1, **CSV)
        measured = table("log1_vehicle_attitude_0.csv", 0, 1, **CSV)
        at = measured[0][0] + 12_500.0 * np.arange(5200, 6900)  # microseconds
        return [np.interp(at, *demanded), np.interp(at, *measured)]

    def hammer() -> list[np.ndarray]:
        content = content_of(folder / "DPsv00002.mat")
        return [content[key][:, 1] for key in ("X1", "X3")]

    def arm() -> list[np.ndarray]:
        name = folder / "softrobot_train-13_val-4.mat"
        trial = content_of(name, simplify_cells=True)["train"][9]
        return [trial["u"][:, 1], trial["y"][:, 1]]

    def drive() -> list[np.ndarray]:
        names = [folder / f"idf_pos_{torque}_1.mat" for torque in ("0.06", "0.065")]
        return list(np.concatenate([content_of(name)["data"][::20] for name in names])[:, [4, 3]].T)

    def office() -> list[np.ndarray]:
        return [each[1800:13_200:3] for each in table("control_test.csv", 3, 1, **CSV)]

    def manifold() -> list[np.ndarray]:
        return [each[::5] for each in table(engine, 1, 11, **PLAIN)]

    def circuit() -> list[np.ndarray]:
        return [each[300:] for each in signals_of(folder, "dane.mat", "u", "y")]

    engine = "raw_000010_measurement_000000.csv"
    tachometer, sulphur = "20190701-23:37:34-Fs10-N4000-Nv100.csv", ("SRU_data.txt", 2, 5)
    yield from first_samples_of(
        (
            ("wave basin", basin, 3000, 2000, 5.0),
            ("incubator", incubator, 305, 506, 0.33),
            ("office", office, 2500, 1300, 1 / 900),
            ("tachometer", lambda: table(tachometer, 0, 1, **CSV), 2600, 1400, 10.0),
            ("racing quadrotor", racer, 900, 800, 80.0),
            ("struck structure", hammer, 1200, 1000, 512.0),
            ("soft arm", arm, 2300, 1171, 12.05),
            ("nitrogen oxides", lambda: table(engine, 1, 9, **PLAIN), 4000, 2000, 10.0),
            ("exhaust manifold", manifold, 1750, 923, 2.0),
            ("analogue circuit", circuit, 1700, 1000, 100.0),
            ("sulphur", lambda: table(*sulphur, skip_header=4601), 1650, 750, 1 / 60),
            ("HSM150", drive, 1000, 1000, 50.0),
        )
    )
