"""Recordings of others for ``public_recordings.py``: their sources, readers and splits.

``recordings_of_others_later.py`` and ``recordings_of_others_latest.py`` have the later sets.

The folder holds recordings that are free to download but are not part of the project, under these
names: of DaISy (De Moor, KU Leuven) ``ballbeam.dat``, ``exchanger.csv``, ``flutter.dat``,
``heating_system.dat``, ``dryer.dat`` and ``robot_arm.dat``; of the nonlinear benchmarks
``SNLS80mV.csv`` (Silverbox), ``dataBenchmark.csv`` (cascaded tanks) and ``drive.mat`` (coupled
electric drives); ``actuator.mat`` (hydraulic actuator, Sjöberg et al. 1995).

The set ``second`` has recordings that no rule was made with until 2026-11-26; which samples are for
estimation was written down before anything was run.  They come from public repositories at GitHub,
by repository (licence of the repository; none: none is stated) and file:

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

The set ``reserved`` was put together later, for one measurement of rules that were complete by
then, chosen by plots and split before anything was run.  Its 14 recordings have served to make
rules since 2026-11-27:

- gergelytakacs/AutomationShield (CC BY-NC-ND): ``BlackBoxModel.mat`` of PressureShield (pump,
  pressure in a vessel), ``ID_PID_4000us.mat`` of MagnetoShield (solenoid, place of the magnet that
  it holds under feedback, with steps of the reference);
- nebisman/DCMotor.jl (MIT): ``DCmotor_prbs_open_exp.csv`` (voltage, speed); nebisman/UNThermal
  (none): ``Thermal_prbs_open_exp.csv`` (heater, temperature);
- helonayala/bab_datasets (none): ``05_multisine_01.mat`` (beam, ball under feedback, every tenth
  sample); helonayala/sysid (Unlicense): ``sinal4_multiseno_malha_fechada.csv`` (a propeller that
  holds an arm under feedback: power, angle);
- lorsi96/System-Identification-Control-for-RCRC-Circuit (MIT): ``ls_output_data.csv`` (two
  resistors and two capacitors);
- josemiguelbento/UAV-OAT-controlo (none; the first three files are those of the book by
  Jategaonkar, the next two those of the book by Klein and Morelli, copyright AIAA):
  ``fAttasElv1.mat``, ``fAttasElv2.mat`` (aircraft ATTAS: elevator, rate of pitch),
  ``hfb320_1_10.asc`` (aircraft HFB-320, likewise), ``totter_lon_020213f1_017.mat``,
  ``totter_lon_020213f1_018.mat`` (Twin Otter, likewise), and of its own
  ``ProcessedData_2022_05_07_11_13_57.mat`` (an unmanned aircraft: aileron, rate of roll);
- m0in92/ECM (GPL-3): ``A1-A123-Dynamics.csv`` (CALCE, University of Maryland: a cell that is
  discharged by a driving cycle: current, voltage; two of its cycles);
- martinlarsalbert/System-identification-of-Vessel-Manoeuvring-Models (none):
  ``HSVA_CPMC_KVLCC2_Z_20_10_P.dat``, ``HSVA_CPMC_KVLCC2_Z_20_10_S.dat`` (model of a tanker in a
  towing tank, zigzags to port and to starboard: rudder, rate of yaw, every fourth sample);
- czagoni/darkgreybox (MIT): ``demo_data.csv`` (a house by the hour: heating, temperature).

The set ``third`` was put together for one measurement of the rules that followed: 15 recordings,
chosen by their plots and split before anything was run on any of them.  They have served to make
rules since 2026-11-27.  Where a repository states no licence, the rights stay with its owner:

- brunnese/EngineSystems (none): ``DataIdentification.mat``, ``DataValidation.mat`` (engine on a
  test bed: mass flow of air, pressure in the intake manifold, every second sample);
- Dolfas/DPCE (none): ``openloop_data_1.mat`` (first of two heated transistors: power, temperature);
- eliferin14/GBM5208-75T_system_identification (MIT): ``4_sinusoids_1.csv`` (motor of a gimbal:
  voltage, speed);
- prj-phcp/SYSID_Atividades (none): ``crane.mat`` (pilot crane of the CONTSID toolbox by Garnier:
  voltage, angle of the load; one binary sequence sent five times), ``DATA_EMPS.mat`` (positioning
  system under feedback, Janot et al. 2019: control signal, position, every tenth sample);
- liamjosephnolan/thesis_matlab (none): ``PRBS_pitch_v2.csv`` (arm of a surgical robot: control
  signal, pitch, every fifth sample);
- vhsabino/MATLAB (none): ``DATA_GROUND_1ms_08_10_19.csv`` (football robot that drives: demand,
  speed of its first wheel, every second sample);
- eunchurn/system-identification-unison-tower-matlab (none): ``wn_02.dat`` (five-storey tower that
  a mass shakes: accelerations of the mass and of the fourth floor);
- dongdaming1966/mcar_simulate (none): ``10_23_1.dat``, ``10_23_2.dat`` (balancing car: acceleration
  of the motor, angle of the body, every tenth sample);
- rujia-L/grey-box-thermal-modeling-sde (none): ``AllDat.csv`` (university building by the hour:
  first circuit of heating, temperature of the first room);
- Piotr-Bednarek/TeamPiesProjekt (none): ``identyfikacja-6.csv``, ``identyfikacja-7.csv`` (ball on a
  beam that a servo tilts: demand, place of the ball);
- felypemaciel/threetank (none): ``setpoint_tracking.csv`` (water tank under feedback: pump, level,
  every third sample);
- ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash (CC BY-SA): ``ImperialValleyDBE.json``,
  ``KocaeliDBE.json`` (friction damper moved as in two earthquakes: displacement, force, every tenth
  sample);
- Negm2000/Seesaw (none): ``data.mat`` (cart of a seesaw: voltage of its motor, place, every tenth
  sample);
- abhigyaraval/System-Identification-and-Digital-ControlSystem-Design-of-a-Swinging-Pendulum
  (Apache): ``TempControlSysId.mat`` (experiment on control of temperature: width of pulses of the
  heater, temperature; samples 100 to 2400).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.io import loadmat

PLAIN = {"delimiter": ","}
CSV = {**PLAIN, "skip_header": 1}
SILVERBOX_MULTISINE = slice(50_000, 58_000)


class Record(NamedTuple):
    """A recording, its input (N,) or (N, m), with the number of its samples for estimation."""

    name: str
    u: np.ndarray
    y: np.ndarray
    estimation: int
    rate: float


# Name, input and output, numbers of samples for estimation and for validation, rate.
Kind = tuple[str, Callable[[], list[np.ndarray]], int, int, float]


def first_samples_of(kinds: Sequence[Kind]) -> Iterator[Record]:
    """The recordings that are there, each with as many samples as it is split into."""
    for name, read, estimation, validation, rate in kinds:
        try:
            u, y = (each[: estimation + validation] for each in read())
            yield Record(name, u, y, estimation, rate)
        except FileNotFoundError as error:
            print(f"{name} is left out: {error}", flush=True)


def content_of(file: Path, **how: bool) -> dict[str, np.ndarray]:
    """What a file of MATLAB holds; one that is missing raises FileNotFoundError, as for tables."""
    with file.open("rb") as opened:
        return dict(loadmat(opened, **how))


def signals_of(folder: Path, name: str, *keys: str) -> list[np.ndarray]:
    """Variables of a file of MATLAB."""
    content = content_of(folder / name)
    return [content[key].ravel() for key in keys]


def columns_of(
    folder: Path, names: str | Sequence[str], u: int, y: int, **how: object
) -> list[np.ndarray]:
    """Two columns of a file, or of several, one after the other."""
    files = [names] if isinstance(names, str) else names
    values = np.concatenate([np.genfromtxt(folder / name, **how) for name in files])
    return [values[:, u], values[:, y]]


def seen(folder: Path) -> Iterator[Record]:
    """Recordings that rules of the choice or of the checks were made with: 12."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def silverbox() -> list[np.ndarray]:
        return [each[SILVERBOX_MULTISINE] for each in table("SNLS80mV.csv", 0, 1, **CSV)]

    def tanks() -> list[np.ndarray]:
        estimated, held = (table("dataBenchmark.csv", k, k + 2, **CSV) for k in (0, 1))
        return [np.concatenate(both) for both in zip(estimated, held, strict=True)]

    kinds: tuple[Kind, ...] = (
        ("heating system", lambda: table("heating_system.dat", 1, 2), 500, 301, 0.5),
        ("ball and beam", lambda: table("ballbeam.dat", 0, 1), 600, 400, 10.0),
        ("heat exchanger", lambda: table("exchanger.csv", 1, 2, **CSV), 3000, 1000, 1.0),
        ("cascaded tanks", tanks, 1024, 1024, 0.25),
        ("hydraulic actuator", lambda: matlab("actuator.mat", "u", "p"), 512, 512, 1.0),
        *(
            (f"coupled drives {n}", partial(matlab, "drive.mat", f"u{n}", f"z{n}"), 300, 200, 50.0)
            for n in (1, 2, 3)
        ),
        ("flutter", lambda: table("flutter.dat", 0, 1), 512, 512, 1.0),
        ("Silverbox", silverbox, 5000, 3000, 610.35),
        ("hair dryer", lambda: table("dryer.dat", 0, 1), 750, 250, 12.5),
        ("robot arm", lambda: table("robot_arm.dat", 0, 1), 800, 224, 125.0),
    )
    yield from first_samples_of(kinds)


def second(folder: Path) -> Iterator[Record]:
    """Recordings that no rule was made with until 2026-11-26: 17, of one input and output each."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def joined(name: str, samples: int = -1) -> list[np.ndarray]:
        u, y, u_val, y_val = matlab(name, "U", "Y", "U_val", "Y_val")
        return [np.concatenate([u[:samples], u_val]), np.concatenate([y[:samples], y_val])]

    swept, buck = ("swept1-0-10hz.txt", "swept2-0-10hz.txt"), ("buck_id.csv", "buck_valid.csv")

    def circuit() -> list[np.ndarray]:
        u, y = matlab("WienerHammerBenchMark.mat", "uBenchMark", "yBenchMark")
        part = np.r_[10_000:14_000, 110_000:112_000]
        return [u[part], y[part]]

    def laboratory() -> list[np.ndarray]:
        content = content_of(folder / "tclab_kuntz_rawlings_2022.mat")["data"]
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
    kinds: tuple[Kind, ...] = (
        ("gas furnace", lambda: table("gas_furnace.csv", 0, 1, **CSV), 196, 100, 1 / 9),
        ("damper", lambda: joined("Magneto.mat", 2000), 2000, 1499, 200.0),
        ("two tanks", lambda: joined("TwoTanksMatlab.mat", 2000), 2000, 1000, 5.0),
        ("industrial robot", lambda: joined("RobotArm.mat", 3000), 3000, 1500, 2000.0),
        ("Wiener-Hammerstein", circuit, 4000, 2000, 51_200.0),
        ("temperature laboratory", laboratory, 3600, 3540, 1.0),
        ("house", lambda: table("blg_1.csv", 5, 4, **house), 2800, 1381, 1 / 900),
        ("ruler", lambda: table(swept, 3, 5), 2000, 2000, 500.0),
        ("buck converter", lambda: table(buck, 1, 2, **CSV), 1001, 999, 1e5),
        ("F-16", lambda: table("f-16.txt", 0, 2, **PLAIN), 4000, 2000, 400.0),
        ("hoop", lambda: matlab("randomStepSequence.mat", "u", "y"), 4000, 2000, 10.0),
        ("printer heater", lambda: shield("resultID2.mat"), 4000, 2000, 0.5),
        ("lamp", lambda: shield("resultID.mat"), 900, 500, 200.0),
        ("geared motor", lambda: matlab("aprbsResult.mat", "u", "y"), 3200, 1601, 50.0),
        ("propeller pendulum", pendulum, 5001, 5001, 100.0),
        ("floating ball", lambda: matlab("APRBS_R4.mat", "u", "y"), 3000, 1800, 40.0),
        ("generator", generator, 700, 300, 1.0),
    )
    yield from first_samples_of(kinds)


def reserved(folder: Path) -> Iterator[Record]:
    """Recordings that no rule was made with until 2026-11-27: 14, of one input and output each."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def beam() -> list[np.ndarray]:
        return [each[2500::10] for each in matlab("05_multisine_01.mat", "u", "y")]

    def magnet() -> list[np.ndarray]:
        return list(content_of(folder / "ID_PID_4000us.mat")["result"][100:, [1, 0]].T)

    def flights(files: tuple[str, ...], key: str, u: int, y: int) -> list[np.ndarray]:
        values = np.concatenate([content_of(folder / f"{name}.mat")[key or name] for name in files])
        return [values[:, u], values[:, y]]

    def roll() -> list[np.ndarray]:
        content = content_of(folder / "ProcessedData_2022_05_07_11_13_57.mat")
        parts = [content[key][0, 0] for key in ("ail_2", "ail_4")]
        return [np.concatenate([part[key].ravel() for part in parts]) for key in ("delta_a", "p")]

    def cell() -> list[np.ndarray]:
        both = table("A1-A123-Dynamics.csv", 2, 3, **CSV)
        return [np.concatenate([each[18_123:19_492], each[19_493:20_862]]) for each in both]

    def ship() -> list[np.ndarray]:
        zigzags = [f"HSVA_CPMC_KVLCC2_Z_20_10_{side}.dat" for side in "PS"]
        parts = [table(name, 8, 6, skip_header=4, encoding="latin1") for name in zigzags]
        return [np.concatenate([each[::4] for each in both]) for both in zip(*parts, strict=True)]

    def arm() -> list[np.ndarray]:
        return [each[2000:] for each in table("sinal4_multiseno_malha_fechada.csv", 3, 2, **CSV)]

    attas, twin = ("fAttasElv1", "fAttasElv2"), [f"totter_lon_020213f1_01{k}" for k in (7, 8)]
    yield from first_samples_of(
        (
            ("pressure", lambda: matlab("BlackBoxModel.mat", "input", "output"), 4800, 2400, 100.0),
            ("magnet", magnet, 5000, 2400, 250.0),
            ("motor", lambda: table("DCmotor_prbs_open_exp.csv", 1, 2, **CSV), 2700, 1393, 50.0),
            ("heater", lambda: table("Thermal_prbs_open_exp.csv", 1, 2, **CSV), 1050, 525, 1.25),
            ("ball on a beam", beam, 3600, 1850, 100.0),
            ("arm with a propeller", arm, 4000, 2000, 100.0),
            ("RC circuit", lambda: table("ls_output_data.csv", 2, 1, **CSV), 4000, 2000, 1000.0),
            ("ATTAS", lambda: flights(attas, "", 21, 7), 626, 626, 25.0),
            ("Twin Otter", lambda: flights(twin, "fdata", 13, 5), 301, 401, 50.0),
            ("HFB-320", lambda: table("hfb320_1_10.asc", 1, 7), 300, 301, 10.0),
            ("unmanned aircraft", roll, 530, 525, 50.0),
            ("battery", cell, 1369, 1369, 1.0),
            ("tanker", ship, 951, 951, 5.0),
            ("hourly house", lambda: table("demo_data.csv", 1, 2, **CSV), 528, 264, 1 / 3600),
        )
    )


def third(folder: Path) -> Iterator[Record]:
    """Recordings that no later rule was made with until 2026-11-27: 15, of one input and output."""
    matlab, table = partial(signals_of, folder), partial(columns_of, folder)

    def every(step: int, read: Callable[[], list[np.ndarray]]) -> Callable[[], list[np.ndarray]]:
        return lambda: [each[::step] for each in read()]

    def manifold() -> list[np.ndarray]:
        files = (("DataIdentification.mat", "IdData"), ("DataValidation.mat", "ValData"))
        parts = [content_of(folder / name, simplify_cells=True)[key] for name, key in files]
        series = [
            [part[key]["signals"]["values"][::2] for part in parts] for key in ("mdot_in", "p")
        ]
        return [np.concatenate(both) for both in series]

    def transistor() -> list[np.ndarray]:
        content = content_of(folder / "openloop_data_1.mat")
        return [content[key][0].astype(float) for key in ("u", "y")]

    def crane() -> list[np.ndarray]:
        content = content_of(folder / "crane.mat")
        return [content["u2"][:, 0].astype(float), content["y2"][:, 1]]

    def car() -> list[np.ndarray]:
        parts = [table(f"10_23_{k}.dat", 4, 1) for k in (1, 2)]
        return [np.concatenate([each[::10] for each in both]) for both in zip(*parts, strict=True)]

    def damper() -> list[np.ndarray]:
        files = [folder / f"{earthquake}DBE.json" for earthquake in ("ImperialValley", "Kocaeli")]
        parts = [np.array(json.loads(file.read_text())["data"])[::10, 1:3] for file in files]
        return list(np.concatenate(parts).T)

    def cart() -> list[np.ndarray]:
        return list(content_of(folder / "data.mat")["data"][1:3, ::10])

    def chamber() -> list[np.ndarray]:
        return [each[100:].astype(float) for each in matlab("TempControlSysId.mat", "U", "Y")]

    emps, arm = partial(matlab, "DATA_EMPS.mat", "vir", "qm"), ("PRBS_pitch_v2.csv", 3, 2)
    wheel, level = ("DATA_GROUND_1ms_08_10_19.csv", 0, 1), ("setpoint_tracking.csv", 2, 1)
    balls = [f"identyfikacja-{k}.csv" for k in (6, 7)]
    yield from first_samples_of(
        (
            ("intake manifold", manifold, 3000, 2001, 50.0),
            ("heated transistor", transistor, 1000, 600, 0.2),
            ("gimbal motor", lambda: table("4_sinusoids_1.csv", 1, 2, **PLAIN), 3000, 1367, 92.4),
            ("crane", crane, 3000, 2080, 100.0),
            ("EMPS", every(10, emps), 1500, 985, 100.0),
            ("surgical arm", every(5, lambda: table(*arm, **CSV)), 3000, 1404, 80.0),
            ("driving wheel", every(2, lambda: table(*wheel, **PLAIN)), 2400, 1400, 500.0),
            ("tower", lambda: table("wn_02.dat", 1, 3), 5000, 3000, 100.0),
            ("balancing car", car, 3472, 3354, 49.9),
            ("university", lambda: table("AllDat.csv", 8, 2, **CSV), 1600, 800, 1 / 3600),
            ("ball on a servo", lambda: table(balls, 3, 1, **CSV), 333, 333, 27.8),
            ("tank", every(3, lambda: table(*level, **PLAIN)), 1600, 839, 1.63),
            ("friction damper", damper, 2870, 2735, 102.4),
            ("cart", cart, 2600, 1400, 50.0),
            ("temperature chamber", chamber, 1400, 900, 1.0),
        )
    )
