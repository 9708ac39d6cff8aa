"""Polynomial structures with several inputs, from the file to the report."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from identified import undrawn_page
from scipy.io import loadmat
from scipy.signal import lfilter

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.pipeline.identification import identify_dataset
from evopem.results.fleet import DatasetSummary
from evopem.results.layout import DatasetFiles
from evopem.validation.validation import Validation

A = np.array([1.0, -1.5, 0.8])
SAMPLES = 700
# Frequency in Hz at 10 Hz, and damping ratio, of the poles of A.
POLE = np.log(np.roots(A)[0])
TRUTH = (10.0 * abs(POLE) / (2.0 * np.pi), -POLE.real / abs(POLE))

# Orders and delays of the truth, where the search for them is not the point.
GIVEN = {
    "structure": "armax",
    "orders": {"na": 2, "nb": [[2, 2], [1, 1]], "nc": 1},
    "delay": {"nk": [[1, 1], [3, 3]]},
}


def signals():
    """ARMAX with two inputs, delays 1 and 3, and 10 % noise."""
    generator = np.random.default_rng(4)
    u, e = generator.standard_normal((SAMPLES, 2)), generator.standard_normal(SAMPLES)
    driven = lfilter([0.0, 1.0, 0.5], [1.0], u[:, 0]) + lfilter([0, 0, 0, -0.7], [1.0], u[:, 1])
    clean, noise = lfilter([1.0], A, driven), lfilter([1.0, -0.5], A, e)
    scale = 0.1 * clean.std() / noise.std()
    return pd.DataFrame({"hot": u[:, 0], "cold": u[:, 1], "y": 3.0 + clean + scale * noise}), scale


def identified(path, monkeypatch, keys, samples=SAMPLES, table=None):
    monkeypatch.chdir(path)
    (signals()[0] if table is None else table)[:samples].to_csv("mixer.csv", index=False)
    dataset = {"file": "mixer.csv", "sampling_rate": 10, "input": ["hot", "cold"], "output": "y"}
    dataset |= {"search": {"evaluations": 1}} | keys
    settings = complete({"datasets": {"mixer": dataset}}).datasets["mixer"]
    files = DatasetFiles.of_dataset("mixer")
    identify_dataset(files, settings, with_report=False)
    return files


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("mixer")
        keys = {"structure": "armax", "orders": {"plant": [1, 3]}}
        files = identified(path, patch, keys)
        return DatasetFiles(str(path / files.folder))


def test_the_model_is_the_truth(results):
    record = load(ModelRecord, results.model)
    model = record.polynomials
    # The noise model may have a coefficient more than the truth.
    assert (model.orders.na, model.orders.nb, model.orders.nk) == (2, (2, 1), (1, 3))
    assert 1 <= model.orders.nc <= 2
    assert record.text == str(model.orders)
    assert (model.sampling_rate, record.input_names) == (10.0, ("hot", "cold"))
    errors = model.parameter_standard_errors()
    truth = np.array([-1.5, 0.8, 1.0, 0.5, -0.7, -0.5, 0.0])[: errors.size]
    assert np.abs((model.parameters - truth) / errors).max() < 3.5
    assert model.noise_variance == pytest.approx(signals()[1] ** 2, rel=0.2)
    response = model.frequency_response([0.5, 3.0])
    assert np.allclose(record.plant.frequency_response([0.5, 3.0]), response)


def test_validation_is_as_good_as_the_noise_allows(results):
    validation = load(Validation, results.validation)
    held_out = signals()[0]["y"].to_numpy()[int(0.8 * SAMPLES) :]
    least = 100.0 * signals()[1] / held_out.std()
    assert validation.prediction_error_percent == pytest.approx(least, rel=0.15)
    assert len(validation.pairs) == 2


def test_every_file_is_there_and_says_the_same(results):
    stored = loadmat(results.model_mat)
    assert stored["B"][0, 1].ravel()[:3].tolist() == [0.0, 0.0, 0.0]
    modes = pd.read_csv(results.modes)
    pole = np.roots(A)[0]
    assert modes["frequency_hz"][0] == pytest.approx(10 * abs(np.log(pole)) / 2 / np.pi, rel=0.02)
    assert {"participation_real_hot", "participation_real_cold"} <= set(modes)
    responses = pd.read_csv(results.frequency_response)
    assert sorted(set(responses["input"])) == ["cold", "hot"]
    assert (responses["gain_upper"] > responses["gain_lower"]).all()
    assert "simulated_y" in pd.read_csv(results.simulation)
    summary = load(DatasetSummary, results.summary)
    name = load(ModelRecord, results.model).text
    assert summary.model == name
    decisions = json.loads(Path(results.decisions).read_text())["decisions"]
    assert any(each["choice"] == name for each in decisions)
    revisions = json.loads(Path(results.decision("revisions")).read_text())
    assert revisions["choice"]["candidate"]["structure"] == "armax"
    assert (revisions["trials"], revisions["failed"]) == ([], [])
    page = undrawn_page(results)
    assert name in page
    assert "orders.nx" not in page
    assert "orders.plant" in page


def test_the_written_configuration_gives_the_same_settings(results):
    keys = yaml.safe_load(Path(results.config).read_text())
    again = complete(keys).datasets["mixer"]
    assert again.automatic.structure == "armax"
    assert again.automatic.orders.plant == (1, 3)


def test_orders_and_delays_of_each_input_stay_within_their_ranges(tmp_path, monkeypatch):
    keys = {
        "structure": "armax",
        "orders": {"nb": {"hot": [1, 3], "cold": 2}, "na": [1, 3], "nc": [0, 2]},
        "delay": {"nk": {"hot": [0, 2], "cold": 2}},
    }
    files = identified(tmp_path, monkeypatch, keys)
    record = load(ModelRecord, files.model)
    # Two coefficients at lags 2 and 3, of which the first is no part of the truth.
    assert str(record.polynomials.orders) == "ARMAX(2,[2 2],1,[1 2])"
    first, second = record.polynomials.B[1]
    errors = record.polynomials.covariance.standard_errors(np.eye(7))[4]
    assert abs(first) < 3.5 * errors
    assert second == pytest.approx(-0.7, abs=0.05)
    table = pd.read_csv(files.candidates)
    searched = table[table["model"].str.startswith("ARMAX") & (table["step"] == "order")]
    assert searched["model"].tolist() == [
        "ARMAX(1,[1 2],1,[1 2])",
        "ARMAX(2,[2 2],2,[1 2])",
        "ARMAX(3,[3 2],2,[1 2])",
    ]
    assert table[table["selected"]]["model"].tolist() == [str(record.polynomials.orders)]
    assert not any("[1 1]" in each or "[1 3]" in each for each in table["model"])


def test_fixed_orders_are_one_candidate(tmp_path, monkeypatch):
    keys = {
        "structure": "oe",
        "orders": {"nb": [[2, 2], [1, 1]], "nf": 2},
        "delay": {"nk": [[1, 1], [3, 3]]},
    }
    files = identified(tmp_path, monkeypatch, keys)
    record = load(ModelRecord, files.model)
    assert str(record.polynomials.orders) == "OE([2 1],[2 2],[1 3])"
    models = pd.read_csv(files.candidates)["model"]
    # Smaller structures have been searched as starts.
    assert models[models.str.startswith("OE")].tolist() == ["OE([2 1],[2 2],[1 3])"]


def test_ranges_of_other_inputs_are_refused_when_the_names_are_known(tmp_path, monkeypatch):
    keys = {"input": ["hot", 2], "structure": "oe", "delay": {"nk": {"warm": 1}}}
    with pytest.raises(InputError, match=r"datasets.mixer.delay.nk: there is no input warm"):
        identified(tmp_path, monkeypatch, keys)


@pytest.mark.parametrize(
    ("structure", "ranges", "na", "nf"),
    [
        ("fir", {"nb": [1, 4]}, 0, (0, 0)),
        ("ararx", {"plant": [1, 2]}, 2, (0, 0)),
        ("ararmax", {"plant": [1, 2]}, 2, (0, 0)),
        # Poles of A could be in all F_i and D as well, where these are not limited.
        ("general", {"na": 1, "nf": 1, "plant": 2}, 1, (1, 1)),
    ],
)
def test_every_structure_takes_several_recordings(tmp_path, monkeypatch, structure, ranges, na, nf):
    """Each recording has a level of its own, and the orders of each input are the truth's."""
    monkeypatch.chdir(tmp_path)
    for part in range(4):
        joined_part(structure, part).to_csv(f"part_{part}.csv", index=False)
    keys = {"file": "part_*.csv", "structure": structure, "orders": ranges}
    files = identified(tmp_path, monkeypatch, keys)
    record = load(ModelRecord, files.model)
    orders = record.polynomials.orders
    assert orders.structure == structure
    assert (orders.na, orders.nb, orders.nf, orders.nk) == (na, (2, 1), nf, (1, 3))
    validation = load(Validation, files.validation)
    assert validation.simulation_error_percent == pytest.approx(10.0, abs=2.0)
    decisions = Path(files.decisions).read_text(encoding="utf-8")
    assert "between them, of 3 recordings" in decisions
    assert "a level for each recording" in decisions


def joined_part(structure, part, samples=260):
    """One recording of a system of a structure, with 10 % noise, about a level of its own."""
    generator = np.random.default_rng(part)
    u, e = generator.standard_normal((samples, 2)), generator.standard_normal(samples)
    # The noise has a C where the structure has one, and a D where it has one.
    c = [1.0, -0.5] if structure in ("ararmax", "general") else [1.0]
    d = [1.0] if structure == "fir" else [1.0, 0.7]
    a = {"fir": np.ones(1), "general": np.array([1.0, -0.8])}.get(structure, A)
    f = ([1.0, -0.6], [1.0, 0.5]) if structure == "general" else ([1.0], [1.0])
    clean = lfilter([0.0, 1.0, 0.5], np.convolve(a, f[0]), u[:, 0])
    clean += lfilter([0.0, 0.0, 0.0, -0.7], np.convolve(a, f[1]), u[:, 1])
    noise = lfilter(c, np.convolve(a, d), e)
    y = 2.0 * part + clean + 0.1 * clean.std() / noise.std() * noise
    return pd.DataFrame({"hot": u[:, 0], "cold": u[:, 1], "y": y})


def test_polynomials_and_state_space_are_compared_by_one_criterion(tmp_path, monkeypatch):
    keys = {"orders": {"plant": 1, "nx": 1}}
    files = identified(tmp_path, monkeypatch, keys, samples=200)
    decisions = json.loads(Path(files.decisions).read_text())["decisions"]
    about = next(each for each in decisions if each["subject"] == "structure for simulation")
    names = {each["name"].split("(")[0].split(",")[0] for each in about["alternatives"]}
    assert {"ss", "ss_oe", "ARX", "ARMAX", "OE", "BJ"} <= names


def test_a_record_that_is_too_short_is_refused_in_one_sentence(tmp_path, monkeypatch):
    carried = r"any structure: \d+ samples for estimation carry at most \d+ coefficients"
    with pytest.raises(InputError, match=carried) as caught:
        identified(tmp_path, monkeypatch, {"structure": "bj", "orders": {"plant": 40}})
    assert str(caught.value).startswith("datasets.mixer: ")


@pytest.mark.parametrize(
    "keys", [{}, {"structure": "state_space", "form": "ss_oe", "orders": {"nx": 2}}], ids=str
)
def test_the_absolute_objective_bears_outliers(tmp_path, monkeypatch, keys):
    table = signals()[0][:400]
    hits = np.random.default_rng(1).random(len(table)) < 0.03
    table["y"] += np.where(hits, 40.0, 0.0)
    keys = GIVEN | keys | {"search": {"objective": "absolute", "evaluations": 1}}
    files = identified(tmp_path, monkeypatch, keys, table=table)
    record = load(ModelRecord, files.model)
    assert record.search.settings.objective == "absolute"
    nearest = min(record.plant.modes(), key=lambda mode: abs(mode.damping_ratio - TRUTH[1]))
    assert nearest.frequency_hz == pytest.approx(TRUTH[0], rel=0.02)
    assert nearest.damping_ratio == pytest.approx(TRUTH[1], rel=0.15)
    if "form" in keys:
        assert "mean absolute ones" in undrawn_page(files)


@pytest.mark.parametrize(
    ("keys", "active"),
    [
        ({"focus": 3}, ()),
        ({"structure": "arx", "orders": {"plant": 2}, "focus": "simulation"}, ()),
        ({"structure": "state_space", "form": "ss", "orders": {"nx": 2}, "focus": 3}, ()),
        ({"constraints": {"fixed_coefficients": {"a1": -1.5}, "stability": "free"}}, ("a1",)),
        (
            {
                "constraints": {
                    "priors": [{"quantity": "a2", "mean": 0.8, "standard_deviation": 0.01}]
                }
            },
            ("priors",),
        ),
    ],
    ids=str,
)
def test_focus_and_constraints_are_those_of_the_estimate(tmp_path, monkeypatch, keys, active):
    files = identified(tmp_path, monkeypatch, GIVEN | keys, samples=300)
    record = load(ModelRecord, files.model)
    assert record.fit.focus == keys.get("focus", "prediction")
    assert [each in " ".join(record.fit.active) for each in active] == [True] * len(active)
    nearest = min(record.plant.modes(), key=lambda mode: abs(mode.frequency_hz - TRUTH[0]))
    assert nearest.frequency_hz == pytest.approx(TRUTH[0], rel=0.03)


def test_one_input_of_several_recordings_has_a_focus_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = signals()[0][["hot", "y"]]
    for name, rows in (("one.csv", table[:200]), ("two.csv", table[200:400])):
        rows.to_csv(name, index=False)
    keys = {"structure": "armax", "orders": {"plant": 2}, "search": {"evaluations": 1}}
    keys |= {"file": ["one.csv", "two.csv"], "sampling_rate": 10, "split": {"by": "samples"}}
    written = {"datasets": {"two": keys | {"input": "hot", "output": "y", "focus": 3}}}
    files = DatasetFiles.of_dataset("two")
    identify_dataset(files, complete(written).datasets["two"], False)
    assert load(ModelRecord, files.model).fit.focus == 3


CONSTRAINED = [
    GIVEN,
    GIVEN | {"structure": "state_space", "form": "ss", "orders": {"nx": 2}},
]


@pytest.mark.parametrize("structure", CONSTRAINED, ids=("armax", "ss"))
def test_constraints_hold_from_the_file_to_the_report(tmp_path, monkeypatch, structure):
    keys = structure | {"constraints": {"static_gain": {"hot": 4.0}, "max_pole_radius": 0.85}}
    files = identified(tmp_path, monkeypatch, keys, samples=300)
    record = load(ModelRecord, files.model)
    gain = record.plant.frequency_response([0.0])[0, 0, 0].real
    assert gain == pytest.approx(4.0, rel=1e-9)
    assert np.abs(np.linalg.eigvals(record.plant.A)).max() <= 0.85 + 1e-9
    assert set(record.fit.active) == {"static_gain", "max_pole_radius"}
    assert record.fit.objective > record.fit.objective_without
    report = " ".join(undrawn_page(files).split())
    assert "static_gain.hot" in report
    assert "Standard errors are zero across active constraints" in report


@pytest.mark.parametrize("structure", CONSTRAINED, ids=("armax", "ss"))
def test_constraints_that_contradict_the_record_are_refused(tmp_path, monkeypatch, structure):
    # Half the sampling rate is 5 Hz.
    keys = structure | {"constraints": {"frequency_band": [6.0, 8.0]}}
    with pytest.raises(InputError) as refused:
        identified(tmp_path, monkeypatch, keys)
    assert "datasets.mixer.constraints.frequency_band" in str(refused.value)
