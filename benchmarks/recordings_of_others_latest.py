"""The latest set of recordings of others for ``public_recordings.py``: sources, readers, splits.

The set ``seventh`` is for one measurement at the end: 12 recordings of other sources than those of
the sets in ``recordings_of_others.py`` and ``recordings_of_others_later.py``, chosen by plots and
documents and split before anything was run on any.  They come from public repositories at GitHub,
by repository (licence of the repository; none: none is stated, and the rights stay with its owner)
and file:

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
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from recordings_of_others import CSV, Record, columns_of, content_of, first_samples_of


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
