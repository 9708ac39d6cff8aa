"""A run with several channels: two inputs and three outputs, in two modes of running."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import undrawn_page
from scipy.io import loadmat

from evopem.estimation.model_record import ModelRecord
from evopem.figures import CHARTS
from evopem.figures.draw import draw
from evopem.files.json_form import load
from evopem.results.dataset import read_results
from evopem.results.fleet import DatasetSummary
from evopem.signals.prepared_data import load_prepared
from evopem.validation.validation import Validation

from .conftest import Folder

RATE, SAMPLES = 50.0, 500
FREQUENCIES = (4.0, 11.0)
GEOMETRY = {
    "points": {"root": [0, 0, 0], "middle": [0, 0, 1], "tip": [0, 0, 2]},
    "lines": [["root", "middle"], ["middle", "tip"]],
    "channels": {
        "acc_1": {"point": "middle", "direction": "x"},
        "acc_2": {"point": "tip", "direction": "x"},
        "acc_3": {"point": "tip", "direction": "y"},
    },
}
DATASET = {
    "file": "frame.csv",
    "time": "time",
    "input": ["force_x", "force_y"],
    "output": ["acc_*"],
    "input_unit": "N",
    "output_unit": {"acc_1": "m/s2", "acc_2": "m/s2"},
    "structure": "state_space",
    "form": "ss_oe",
    "orders": {"nx": [3, 5]},
    "delay": {"nk": [1, 2]},
    "search": {"evaluations": 20},
    "geometry": GEOMETRY,
}


def frame(seed=8):
    """Two modes, the second input a sample later, and 10 % white noise."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((SAMPLES, 2))
    angles = 2.0 * np.pi * np.array(FREQUENCIES) / RATE
    poles = np.exp((-0.02 + 1j) * angles)
    shapes = np.array([[0.5, 1.0, 0.2], [1.0, -0.6, 0.3]])
    drives = np.array([[1.0, 0.3], [-0.4, 1.0]])
    x, y = np.zeros(2, dtype=complex), np.zeros((SAMPLES, 3))
    for k in range(SAMPLES):
        y[k] = x.imag @ shapes
        push = np.array([u[k, 0], u[k - 1, 1] if k else 0.0])
        x = poles * (x + drives @ push)
    y += 0.1 * y.std(axis=0) * generator.standard_normal(y.shape)
    columns = {"time": np.arange(SAMPLES) / RATE, "force_x": u[:, 0], "force_y": u[:, 1]}
    return pd.DataFrame(columns | {f"acc_{k + 1}": y[:, k] for k in range(3)})


ALONE = {
    "file": "frame.csv",
    "time": "time",
    "input": "none",
    "output": ["acc_1", "acc_2"],
    "orders": {"nx": 4},
    "search": {"evaluations": 10},
}


JOINED = ALONE | {"file": "run_*.csv", "input": ["force_*"], "form": "ss_oe"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A job for each stage; the folder and what was printed."""
    folder = Folder(tmp_path_factory.mktemp("stages"))
    frame().to_csv(folder.path / "frame.csv", index=False)
    folder.configure({"datasets": {"frame": DATASET}})
    return folder, folder.finish("--cores", "2", drawn=False)


@pytest.fixture(scope="module")
def at_once(tmp_path_factory):
    """A job for each recording, with outputs alone beside the same data set."""
    folder = Folder(tmp_path_factory.mktemp("at_once"))
    frame().to_csv(folder.path / "frame.csv", index=False)
    for number in (1, 2, 3):
        frame(number).to_csv(folder.path / f"run_{number}.csv", index=False)
    datasets = {"frame": DATASET, "alone": ALONE, "joined": JOINED}
    folder.configure({"datasets": datasets, "one_job_per": "recording", "report": "none"})
    folder.finish("--cores", "1")
    return folder


def test_what_is_printed(run):
    _, printed = run
    assert "frame: " in printed
    assert "state space, 4 states (output error" in printed
    assert "mean over the outputs" in " ".join(printed.split())


def test_the_truth_is_found(run):
    folder, _ = run
    files = folder.files_of("frame")
    record = load(ModelRecord, files.model)
    assert record.model.input_delays == (0, 1)
    assert record.plant_states == 4
    assert record.output_units == ("m/s2", "m/s2", "")
    modes = load(Validation, files.validation).modes
    for mode, frequency in zip(modes.trusted, FREQUENCIES, strict=True):
        assert abs(mode.frequency_hz - frequency) < 5 * mode.frequency_se_hz + 0.02
    np.testing.assert_allclose(modes.trusted[1].shape.real, [1.0, -0.6, 0.3], atol=0.05)
    validation = load(Validation, files.validation)
    measured = frame()[["acc_1", "acc_2", "acc_3"]].to_numpy()
    held_out = measured[int(0.8 * SAMPLES) :]
    noise = 0.1 * measured.std(axis=0) / np.sqrt(1.01)
    left = 100.0 * np.mean(noise / held_out.std(axis=0))
    assert validation.simulation_error_percent == pytest.approx(left, rel=0.1)
    assert [each.name for each in validation.outputs] == ["acc_1", "acc_2", "acc_3"]


def test_the_tables_hold_every_channel(run):
    folder, _ = run
    files = folder.files_of("frame")
    simulation = pd.read_csv(files.simulation)
    record = load(ModelRecord, files.model)
    data = load_prepared(files.prepared, files.transforms)
    before, after = data.estimation, data.validation
    inputs = np.concatenate([before.inputs, after.inputs])
    outputs = np.concatenate([before.outputs, after.outputs])
    simulated = record.model.simulate_from_fitted_state(inputs, outputs, known=before.samples)
    simulated = simulated[before.samples :]
    np.testing.assert_allclose(simulation["simulated_acc_3"], simulated[:, 2], rtol=1e-9)
    response = pd.read_csv(files.frequency_response)
    pairs = response.groupby(["output", "input"]).size()
    assert len(pairs) == 6
    row = response.iloc[100]
    gain = abs(record.plant.frequency_response([row["frequency_hz"]])[0, 0, 0])
    assert row["gain"] == pytest.approx(gain)
    assert row["gain_lower"] < row["gain"] < row["gain_upper"]
    modes = pd.read_csv(files.modes)
    assert list(modes["output"]) == ["acc_1", "acc_2", "acc_3"] * 2
    correlation = pd.read_csv(files.cross_correlation)
    assert len(correlation.groupby(["output", "input"])) == 6


def test_octave_reads_the_model(run, tmp_path):
    folder, _ = run
    files = folder.files_of("frame")
    stored = loadmat(files.model_mat)
    record = load(ModelRecord, files.model)
    np.testing.assert_array_equal(stored["A"], record.model.A)
    assert stored["InputDelay"].ravel().tolist() == list(record.model.input_delays)
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("Octave is not installed")
    shutil.copy(files.model_mat, tmp_path / "model.mat")
    script = (
        "load model.mat; x = zeros(rows(A), 1);"
        "for k = 1:5, y = C * x + D * [1; 0]; x = A * x + B * [1; 0]; printf('%.17g\\n', y(1));"
        "end; printf('%.17g\\n', Ts);"
    )
    printed = subprocess.run(
        [octave, "--no-gui", "--quiet", "--eval", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout.split()
    steps = record.model.simulate(np.tile([1.0, 0.0], (5, 1)))[:, 0] - record.model.level[0]
    np.testing.assert_allclose(np.array(printed[:5], float), steps, rtol=1e-9, atol=1e-12)
    assert float(printed[5]) == 1.0 / record.sampling_rate


PURPOSES = ("simulation", "prediction", "modes")


def test_every_decision_is_a_file(run):
    folder, _ = run
    files = folder.files_of("frame")
    decisions = json.loads(Path(files.decisions).read_text())["decisions"]
    subjects = [each["subject"] for each in decisions]
    first = ["outliers", "start", "decimation", "drift", "objective", "folds"]
    assert subjects[: len(first)] == first
    assert {"independent samples", "delay", "orders of ss_oe"} <= {*subjects}
    about = [
        "level",
        *(f"structure for {p}" for p in PURPOSES),
        "global search of the chosen model",
    ]
    assert subjects[-5:] == about
    assert json.loads(Path(files.decision("delay")).read_text())["delays"] == [1, 2]


def test_the_report_shows_every_channel_and_shape(run):
    folder, _ = run
    page = Path(folder.files_of("frame").report).read_text(encoding="utf-8")
    for text in (
        "acc_3",
        "acc_3 ← force_y",
        "acc_1, residuals",
        "Step and impulse",
        "Moving shapes",
        "Modal assurance criterion",
        "<animate ",
    ):
        assert text in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_figures_have_a_panel_for_each_channel_or_pair(run):
    folder, _ = run
    results = read_results(folder.files_of("frame"))
    charts = {name: chart_of(results) for name, chart_of in CHARTS.items()}
    of_outputs, of_pairs = ("measured_and_simulated", "residual_spectrum"), ("gain", "nyquist")
    assert [len(charts[name].panels) for name in of_outputs] == [3] * 2
    assert [len(charts[name].panels) for name in of_pairs] == [6] * 2
    for chart in charts.values():
        assert len(draw(chart).axes) >= len(chart.panels)


def test_outputs_alone_are_predicted(at_once):
    alone = undrawn_page(at_once.files_of("alone"))
    assert "Response to the input" not in alone
    assert "predicted one step ahead" in alone


def test_recordings_under_one_name_have_one_model(at_once):
    files = at_once.files_of("joined")
    record = load(ModelRecord, files.model)
    assert [each.samples for each in record.transforms.estimation] == [SAMPLES] * 2
    assert record.transforms.validation_samples == SAMPLES
    modes = load(Validation, files.validation).modes
    for mode, frequency in zip(modes.trusted, FREQUENCIES, strict=True):
        assert abs(mode.frequency_hz - frequency) < 5 * mode.frequency_se_hz + 0.02
    assert "run_3.csv" in undrawn_page(files)


def test_data_sets_with_several_channels_are_listed(at_once):
    folder = at_once
    fleet = pd.read_csv(folder.results / "fleet.csv")
    rows = fleet[fleet["dataset"] == "frame"]
    assert len(rows) == 2
    assert rows["model"].str.startswith("state space, 4 states").all()
    assert "state space, 4 states" in (folder.results / "index.html").read_text(encoding="utf-8")
    summary = load(DatasetSummary, folder.files_of("frame").summary)
    assert summary.orders is None
    assert any(summary.trusted)


def test_nothing_is_left_to_do(run):
    folder, _ = run
    assert folder.planned() == {}


def test_one_job_a_recording_gives_the_same_bits(run, at_once):
    for name in ("model.json", "modes.csv", "validation.json", "simulation.csv", "summary.json"):
        one, other = (each.results / "frame" / name for each in (run[0], at_once))
        assert one.read_bytes() == other.read_bytes(), name
