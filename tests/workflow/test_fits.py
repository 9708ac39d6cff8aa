"""A run with constraints and one with a focus, and what is refused before it."""

import numpy as np
import pytest

from evopem.models.polynomial import PolynomialModel
from evopem.synthesis.polynomial import polynomial_record

from .conftest import Folder

ONE = np.ones(1)
RESONANCE = np.array([1.0, -1.58, 0.81])
B, COLOUR = np.array([1.0, 0.5]), np.array([1.0, 0.6])
PLANT = PolynomialModel(ONE, B, COLOUR, ONE, RESONANCE, nk=1)
INTEGRATOR = PolynomialModel(np.poly([1.0, 0.7]), B, COLOUR, nk=1)
# The mode of the plant has a pole of radius 0.9.
CONSTRAINTS = {"max_pole_radius": 0.85, "static_gain_bounds": [1.0, None]}
CONSTRAINTS |= {"priors": [{"quantity": "b0", "mean": 1.0, "standard_deviation": 0.1}]}
DATASETS = {
    "constrained": {"structure": "oe", "constraints": CONSTRAINTS},
    "focused": {"structure": "arx", "focus": "simulation"},
    "integrator": {"structure": "armax", "constraints": {"fixed_poles": [{"real": 1}]}},
}
CONFIG = {
    "defaults": {
        "sampling_rate": 50,
        "transforms": {"box_cox": "none", "difference": 0},
        "split": {"discard": 20},
        "spectrum": {"nfft": 512},
        "delay": {"orders": 2, "nk": 1},
        "orders": {"joint": 2, "nc": 1, "nb": 2},
        "search": {"objective": "quadratic", "mu": 4, "lambda": 8, "nu": 2, "evaluations": 200},
    },
}
del CONFIG["defaults"]["sampling_rate"]


def configuration(**changed):
    datasets = {
        name: {"file": f"{name}.csv", "sampling_rate": 50} | keys | changed.get(name, {})
        for name, keys in DATASETS.items()
    }
    return CONFIG | {"datasets": datasets}


def write_records(folder):
    for name in DATASETS:
        truth = INTEGRATOR if name == "integrator" else PLANT
        u, y, _ = polynomial_record(truth, 900, 20.0, np.random.default_rng(1))
        np.savetxt(folder.path / f"{name}.csv", np.column_stack([u, y]), delimiter=",")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = Folder(tmp_path_factory.mktemp("fits"))
    write_records(folder)
    folder.configure(configuration())
    folder.finish("--cores", "2")
    return folder
