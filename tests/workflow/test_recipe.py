"""The automatic recipe in real runs: from three keys to results, and what a changed key redoes."""

import json
from pathlib import Path

import numpy as np
import pytest

from evopem import read_results
from evopem.automatic.decision import DecisionRecord
from evopem.automatic.varying import Varying
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.models.orders import Orders

from .conftest import Folder

THREE_KEYS = {"file": "pump.csv", "input": "u", "output": "y"}
THREE_KEYS |= {"sampling_rate": 50}
# A short record of a second-order system with white measurement noise: an output-error model.
SAMPLES = 400


def write_recording(path):
    from scipy.signal import lfilter

    generator = np.random.default_rng(5)
    u = np.repeat(generator.standard_normal(SAMPLES // 4), 4)
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.2 * generator.standard_normal(SAMPLES)
    rows = np.column_stack([u, y + 3.0])
    np.savetxt(path, rows, delimiter=",", header="u,y", comments="", fmt="%.10g")


def configuration(**keys):
    return {"report": "none", "datasets": {"pump": THREE_KEYS | keys}}


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """A finished run over all structures, in one job."""
    folder = Folder(tmp_path_factory.mktemp("recipe"))
    write_recording(folder.path / "pump.csv")
    folder.configure(configuration() | {"one_job_per": "recording"})
    folder.finish("--cores", "1")
    return folder


# For tests of jobs, a structure and ranges that take less time.
GIVEN = {"structure": "arx", "delay": {"nk": 1}, "orders": {"plant": [2, 3]}}


@pytest.fixture(scope="module")
def staged(tmp_path_factory):
    """A finished run with a job for each stage; nobody changes it."""
    folder = Folder(tmp_path_factory.mktemp("staged"))
    write_recording(folder.path / "pump.csv")
    folder.configure(configuration(**GIVEN))
    folder.finish("--cores", "2")
    return folder


@pytest.fixture
def again(staged, tmp_path):
    return staged.copied(tmp_path / "again")


def results_of(folder):
    """Contents of all files of the data set but those that tell of its jobs."""
    root = folder.results / "pump"
    files = (path for path in root.rglob("*") if path.is_file() and path.name[0] != ".")
    parts = {path.relative_to(root): path for path in files}
    return {
        str(name): path.read_bytes()
        for name, path in parts.items()
        if name.parts[0] not in ("logs", "benchmarks", "checksums")
    }


def test_three_keys_find_the_system(identified):
    files = identified.files_of("pump")
    model = load(ModelRecord, files.model)
    (mode,) = [each for each in model.modes if each.damping_ratio < 0.5]
    pole = np.log(max(np.roots([1.0, -1.5, 0.7]), key=np.imag)) * 50
    assert mode.frequency_hz == pytest.approx(abs(pole) / (2 * np.pi), rel=0.03)
    summary = json.loads(Path(files.summary).read_text())
    other = load(DecisionRecord, files.decisions).other_model
    assert other.purpose == "prediction"
    kept = load(ModelRecord, files.other_model("prediction"))
    assert str(kept.orders) == other.model
    assert other.prediction_error_percent < 13.0
    # What remains is the measurement noise.
    assert summary["simulation_error_percent"] < 12.0
    subjects = [each.subject for each in load(DecisionRecord, files.decisions).decisions]
    assert {"start", "clipping", "decimation", "objective", "folds", "delay"} <= set(subjects)
    assert model.orders == Orders(nb=2, nf=2, nk=1)
    assert {f"orders of {name}" for name in ("fir", "arx", "armax", "oe", "bj")} <= set(subjects)


def test_the_graph_is_known_before_it_runs(folder):
    write_recording(folder.path / "pump.csv")
    folder.configure(configuration())
    planned = folder.planned()
    assert (planned["search_polynomials"], planned["search_state_space"]) == (1, 1)
    assert "estimate_candidates" not in planned
    folder.configure(configuration(structure="oe"))
    planned = folder.planned()
    assert (planned["search_polynomials"], "search_state_space" in planned) == (1, False)


def test_one_job_for_all_stages_gives_the_same_files(staged, folder):
    write_recording(folder.path / "pump.csv")
    folder.configure(configuration(**GIVEN) | {"one_job_per": "recording"})
    folder.finish("--cores", "1")
    assert results_of(folder) == results_of(staged)


def test_nothing_is_left_to_do_until_a_key_changes(again):
    """Which jobs a key changes is tested in tests/pipeline/test_changed_keys.py."""
    assert again.planned() == {}
    again.configure(configuration(**GIVEN, purpose="prediction"))
    assert set(again.planned()) == {"complete_model", "estimate_varying", "validate"}


def test_a_key_overrides_its_decision(staged):
    files = staged.files_of("pump")
    orders = load(ModelRecord, files.model).orders
    assert orders.structure == "arx"
    assert orders.single.nk == 1
    assert 2 <= orders.na <= 3
    delay = next(
        each for each in load(DecisionRecord, files.decisions).decisions if each.subject == "delay"
    )
    assert delay.sentence == "Given by the configuration."


def test_a_signal_that_does_not_vary_is_refused_in_one_sentence(folder):
    rows = np.column_stack([np.r_[np.zeros(390), np.ones(10)], np.arange(400.0) % 7])
    np.savetxt(folder.path / "pump.csv", rows, delimiter=",", header="u,y", comments="")
    folder.configure(configuration())
    run = folder.run("--cores", "1")
    assert run.returncode != 0
    assert 'input "u": every sample is 0, so there is nothing to identify' in run.stdout


def test_what_moves_in_a_chirping_resonance_is_reported(tmp_path):
    generator, samples = np.random.default_rng(5), 900
    u, e = generator.standard_normal((2, samples))
    y = np.zeros(samples)
    for t in range(2, samples):
        angle = 2.0 * np.pi * (5.0 + 3.0 * t / samples) / 50.0
        y[t] = 1.9 * np.cos(angle) * y[t - 1] - 0.9 * y[t - 2] + u[t - 1] + 0.3 * e[t]
    folder = Folder(tmp_path)
    rows = np.column_stack([u, y])
    np.savetxt(tmp_path / "pump.csv", rows, delimiter=",", header="u,y", comments="", fmt="%.10g")
    folder.configure(configuration(**GIVEN) | {"report": "html"})
    folder.finish("--cores", "1", drawn=False)
    moves = load(Varying, tmp_path / "results/pump/varying.json").moves
    assert moves.is_better
    (mode,) = moves.modes
    for end, truth in zip((mode.modes[0], mode.modes[-1]), (5.0, 8.0), strict=True):
        assert abs(end.frequency_hz - truth) < 4.0 * end.frequency_se_hz + 0.05
    page = (tmp_path / "results/pump/report.html").read_text(encoding="utf-8")
    assert "The machine changes: mode 1 moves from" in page
    assert "<h2>What moves</h2>" in page
    folder.configure(configuration(**GIVEN, varying="none") | {"report": "html"})
    assert set(folder.planned()) == {"validate", "report"}
    folder.finish("--cores", "1", drawn=False)
    assert "<h2>What moves</h2>" not in (tmp_path / "results/pump/report.html").read_text()
    assert not list((tmp_path / "results/pump").glob("varying*"))
    assert read_results(tmp_path / "results/pump").varying is None
