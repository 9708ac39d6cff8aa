"""A run with constraints and one with a focus, and what is refused before it."""

import numpy as np
import pandas as pd
import pytest
from identified import undrawn_page
from simulated_records import polynomial_record

from evopem.config.settings import SearchSettings
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.files.json_form import load
from evopem.models.polynomial import PolynomialModel
from evopem.results.fleet import DatasetSummary
from evopem.signals.prepared_data import load_prepared

from .conftest import Folder

ONE = np.ones(1)
B, COLOUR = np.array([1.0, 0.5]), np.array([1.0, 0.6])
TRUTHS = {
    "focused": PolynomialModel(ONE, B, COLOUR, ONE, np.array([1.0, -1.58, 0.81]), nk=1),
    "integrator": PolynomialModel(np.poly([1.0, 0.7]), B, COLOUR, nk=1),
}
CONSTRAINTS = {
    "max_pole_radius": 1,
    "stability": "free",
    "fixed_poles": [{"real": 1}],
    "priors": [{"quantity": "b0", "mean": 1.0, "standard_deviation": 0.1}],
}
FITS = {
    "focused": {"structure": "arx", "focus": "simulation"},
    "integrator": {"structure": "armax", "constraints": CONSTRAINTS},
}
DEFAULTS = {
    "recipe": "chapter",
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 20},
    "spectrum": {"nfft": 512},
    "delay": {"orders": 2, "nk": 1},
    "orders": {"plant": 2, "nc": 1, "nb": 2},
    "search": {"objective": "quadratic", "mu": 4, "lambda": 8, "nu": 2, "evaluations": 60},
}


def configuration(**changed):
    """The configuration of the run, with other keys of its data sets."""
    datasets = {
        name: {"file": f"{name}.csv", "sampling_rate": 50} | keys | changed.get(name, {})
        for name, keys in FITS.items()
    }
    return {
        "one_job_per": "recording",
        "report": "none",
        "defaults": DEFAULTS,
        "datasets": datasets,
    }


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = Folder(tmp_path_factory.mktemp("fits"))
    for name, truth in TRUTHS.items():
        u, y, _ = polynomial_record(truth, 600, 20.0, np.random.default_rng(1))
        np.savetxt(folder.path / f"{name}.csv", np.column_stack([u, y]), delimiter=",")
    folder.configure(configuration())
    folder.finish("--cores", "2")
    return folder


def test_a_model_meets_its_constraints_and_records_them(run):
    files = run.files_of("integrator")
    record = load(ModelRecord, files.model)
    assert 1.0 in np.round(record.poles.real, 12)
    assert {"fixed_poles", "priors"} <= set(record.fit.active)
    assert record.fit.objective >= record.fit.objective_without
    # The poles' sum is one free number: its error is that of both coefficients of A.
    errors = record.parameter_standard_errors
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)
    page = undrawn_page(files)
    assert ">Constraints</h3>" in page
    assert "z = 1" in page


def test_an_integrator_is_validated_like_other_models(run):
    files = run.files_of("integrator")
    response = pd.read_csv(files.frequency_response).iloc[1:]
    assert np.isfinite(response[["gain", "phase_deg", "noise_phase_deg"]]).all(axis=None)
    assert np.isfinite(pd.read_csv(files.simulation)["simulated_output"]).all()
    summary = load(DatasetSummary, files.summary)
    assert summary.prediction_error_percent < 2.0
    stable = next(check for check in summary.checks if check.name == "Stable")
    assert stable.passed is not False


def test_a_focus_is_that_of_the_python_interface(run):
    files = run.files_of("focused")
    record = load(ModelRecord, files.model)
    assert (record.fit.focus, record.fit.constraints) == ("simulation", None)
    data = load_prepared(files.prepared, files.transforms).estimation
    direct = estimate_polynomial(
        data,
        record.orders,
        settings=SearchSettings(objective="quadratic"),
        window=record.window,
        focus="simulation",
    )
    assert direct.focus_objective == pytest.approx(record.fit.objective, rel=1e-6)
    selected = load(PhaseSelection, files.phase("nb")).selected
    assert record.objective > selected.criteria.objective
    assert ">Focus</h3>" in undrawn_page(files)


def test_a_contradiction_is_refused_before_any_job(folder):
    folder.configure(configuration(integrator={"constraints": {"frequency_band": [30, 40]}}))
    refused = folder.run("--dry-run")
    assert refused.returncode != 0
    assert "config.yaml, datasets.integrator.constraints.frequency_band: 30" in refused.stdout
