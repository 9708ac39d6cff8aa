"""A run with an output-error model, a Box-Jenkins model and a model without input."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import undrawn_page
from scipy.io import loadmat
from simulated_records import polynomial_record

import evopem
from evopem.files.json_form import load
from evopem.models.polynomial import PolynomialModel
from evopem.results.fleet import DatasetSummary

from .conftest import Folder

ONE = np.ones(1)
RESONANCE = np.array([1.0, -1.58, 0.81])
COLOUR = np.array([1.0, -0.11, 0.64])
B, C = np.array([1.0, 0.5]), np.array([1.0, 0.6])
TRUTHS = {
    "oe": PolynomialModel(ONE, B, C, COLOUR, RESONANCE, nk=1),
    "bj": PolynomialModel(ONE, B, C, COLOUR, RESONANCE, nk=1),
    "arma": PolynomialModel(RESONANCE, np.empty(0), C),
}
PHASES = {"oe": ["delay", "plant", "nb"], "bj": ["delay", "plant", "nc", "nd", "nb"]}
PHASES["arma"] = ["plant", "nc"]
GRID = {"delay": {"orders": 2, "nk": [0, 1]}}
ORDERS = {
    "oe": {"plant": [1, 2], "nb": [1, 2]},
    "bj": {"plant": 2, "nc": [0, 1], "nd": [1, 2], "nb": 2},
    "arma": {"plant": [1, 2], "nc": [0, 1]},
}
CONFIG = {
    "one_job_per": "recording",
    "report": "none",
    "defaults": {
        "recipe": "chapter",
        "transforms": {"box_cox": "none", "difference": 0},
        "split": {"discard": 20},
        "spectrum": {"nfft": 512},
        "level": True,
        "search": {
            "objective": "quadratic",
            "mu": 4,
            "lambda": 8,
            "nu": 2,
            "evaluations": 300,
        },
    },
    "datasets": {
        name: {"file": f"{name}.csv", "sampling_rate": 50, "structure": name, "orders": orders}
        | {"recipe": "chapter"}
        | ({} if name == "arma" else GRID)
        for name, orders in ORDERS.items()
    },
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = Folder(tmp_path_factory.mktemp("structures"))
    for name, truth in TRUTHS.items():
        u, y, _ = polynomial_record(truth, 900, 20.0, np.random.default_rng(1))
        columns = [y + 3.0] if name == "arma" else [u, y + 3.0]
        np.savetxt(folder.path / f"{name}.csv", np.column_stack(columns), delimiter=",")
    folder.configure(CONFIG)
    folder.finish("--cores", "2")
    return folder


@pytest.mark.parametrize("name", TRUTHS)
def test_the_results_of_a_structure_are_read_back(run, name):
    files = run.files_of(name)
    model = evopem.load(files.model)
    assert model.structure == name
    found = sorted(map(str, Path(files.phase_folder).glob("*.json")))
    assert found == sorted(map(files.phase, PHASES[name]))
    plant = model.F[0] if name != "arma" else model.A
    assert plant == pytest.approx(RESONANCE, abs=0.05)
    assert load(DatasetSummary, files.summary).orders == model.orders
    stored = loadmat(files.model_mat)
    assert stored["F"].size == (0 if name == "arma" else len(model.F[0]))
    horizons = pd.read_csv(files.horizons)
    assert horizons["horizon"].iloc[0] == 1
    assert json.loads(Path(files.validation).read_text())["horizons"][0] == 1
    assert str(model.orders) in undrawn_page(files)


@pytest.mark.parametrize("name", TRUTHS)
def test_the_tables_say_what_belongs_to_plant_and_noise(run, name):
    files = run.files_of(name)
    modes = pd.read_csv(files.modes)
    of_noise = modes["doubts"].fillna("").str.contains("of the noise filter alone")
    assert of_noise.any() == (name == "bj")
    response = pd.read_csv(files.frequency_response)
    has_input = name != "arma"
    assert response["gain"].notna().all() == has_input
    assert (response["noise_gain_lower"] <= response["noise_gain"] * (1 + 1e-12)).all()
    in_time = pd.read_csv(files.time_response)
    assert in_time["step_upper"].notna().all() == has_input


@pytest.mark.parametrize(
    ("name", "shown", "hidden"),
    [
        ("oe", ["Measured and simulated", "Nyquist", "which no noise model uses"], []),
        ("bj", ["Measured and simulated", "Nyquist", "of the noise filter alone"], []),
        (
            "arma",
            [
                "Measured and predicted",
                "Response of the noise filter",
                "the spectrum of the output",
            ],
            ["Nyquist", "simulation from the input", "Response to the input", ">Delay<"],
        ),
    ],
)
def test_the_report_shows_what_a_structure_has(run, name, shown, hidden):
    page = undrawn_page(run.files_of(name))
    assert [words for words in shown if words not in page] == []
    assert [words for words in hidden if words in page] == []


def test_coloured_residuals_are_no_fault_of_an_output_error_model(run):
    checks = {
        check.name: check for check in load(DatasetSummary, run.files_of("oe").summary).checks
    }
    assert checks["White residuals"].passed
    assert "claim nothing of the noise" in checks["White residuals"].statement
    assert not [
        name for name, check in checks.items() if check.passed is False and "ranges" not in name
    ]


def test_a_model_without_input_has_no_checks_of_one(run):
    summary = load(DatasetSummary, run.files_of("arma").summary)
    assert not [check.name for check in summary.checks if "input" in check.name.lower()]
    assert np.isnan(summary.simulation_error_percent)


def test_a_second_run_repeats_nothing(run):
    assert run.planned() == {}


def test_phases_that_a_structure_does_not_have_are_no_jobs(run, tmp_path):
    folder = Folder(tmp_path)
    for name in TRUTHS:
        (folder.path / f"{name}.csv").symlink_to(run.path / f"{name}.csv")
    folder.configure(CONFIG | {"one_job_per": "stage"})
    planned = folder.planned()
    searched = sum(map(len, PHASES.values()))
    assert planned["estimate_candidates"] == planned["select_candidate"] == searched
