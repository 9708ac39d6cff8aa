"""Several recordings of several channels, from the files to the report."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identified import finish, undrawn_page

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.figures.comparison import compared_simulations
from evopem.files.json_form import load
from evopem.pipeline.identification import identify_dataset
from evopem.pipeline.report import compare_datasets
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.recording_info import RecordingInfo
from evopem.validation.checks import Evidence, OrderRange
from evopem.validation.checks.search import search_ranges
from evopem.validation.validation import Validation

RATE, NOISE = 100.0, 0.02
FREQUENCIES = (7.0, 19.0)
SHAPES = np.array([[0.5, 1.0], [1.0, -0.6]])
BLOWS = {
    "file": "blow_*.csv",
    "time": "time",
    "input": ["hammer"],
    "output": ["acc_*"],
    "structure": "state_space",
    "form": "ss_oe",
    "orders": {"nx": 4},
    "delay": {"nk": [0, 2]},
    "search": {"evaluations": 1},
}


def blow(seed, samples=260):
    """The response to a blow of 3 samples, over a level of its own, with noise."""
    generator = np.random.default_rng(seed)
    force = np.zeros(samples)
    force[15 + seed : 18 + seed] = np.array([0.5, 1.0, 0.5]) * (1.0 + 0.2 * seed)
    poles = np.exp((-0.02 + 1j) * 2.0 * np.pi * np.array(FREQUENCIES) / RATE)
    x, y = np.zeros(2, dtype=complex), np.zeros((samples, 2))
    for k in range(samples):
        y[k] = x.imag @ SHAPES
        x = poles * (x + np.array([1.0, 0.7]) * force[k])
    y += NOISE * generator.standard_normal(y.shape) + 3.0 * seed
    force += 1e-3 * generator.standard_normal(samples)
    columns = {"time": np.arange(samples) / RATE, "hammer": force}
    return pd.DataFrame(columns | {"acc_1": y[:, 0], "acc_2": y[:, 1]})


def identified(path, monkeypatch, keys, lengths=(260, 230, 250, 240)):
    monkeypatch.chdir(path)
    for number, samples in enumerate(lengths, 1):
        blow(number, max(samples, 20))[:samples].to_csv(f"blow_{number}.csv", index=False)
    settings = complete({"datasets": {"frame": BLOWS | keys}}).datasets["frame"]
    files = DatasetFiles.of_dataset("frame")
    identify_dataset(files, settings, with_report=False)
    return files


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("blows")
        files = identified(path, patch, {})
        # Paths are relative to the folder of the run.
        return DatasetFiles(str(path / files.folder))


def test_the_model_of_all_blows_is_the_truth(results):
    record = load(ModelRecord, results.model)
    assert record.plant_states == 4
    assert [each.recording for each in record.transforms.estimation] == [0, 1, 2]
    assert [each.recording for each in record.transforms.validation] == [3]
    modes = load(Validation, results.validation).modes
    assert len(modes.trusted) == len(modes.modes)
    for mode, frequency, shape in zip(modes.trusted, FREQUENCIES, SHAPES, strict=True):
        assert abs(mode.frequency_hz - frequency) < 4 * mode.frequency_se_hz + 0.002
        np.testing.assert_allclose(
            mode.shape.real, shape / shape[np.abs(shape).argmax()], atol=0.02
        )


def test_the_held_out_blow_is_simulated_down_to_the_noise(results):
    validation = load(Validation, results.validation)
    data = load_prepared(results.prepared, results.transforms)
    assert data.validation.samples == 240
    least = 100.0 * np.mean(NOISE / data.validation.outputs.std(axis=0))
    assert validation.simulation_error_percent == pytest.approx(least, rel=0.1)
    (candidate,) = json.loads(Path(results.decision("comparison")).read_text())["candidates"]
    expected = 100.0 * np.mean(NOISE / data.estimation.outputs.std(axis=0))
    # Every part of the recordings is held out, and a third of them hold one of the three blows.
    assert 0.9 * expected < candidate["scores"]["simulation"] < 1.2 * expected


def test_models_of_several_outputs_are_compared_output_by_output(results, tmp_path):
    for name in ("a", "b"):
        shutil.copytree(results.folder, tmp_path / name)
        finish(DatasetFiles(str(tmp_path / name)))
    both = [str(tmp_path / name) for name in ("a", "b")]
    compared = compare_datasets(both, str(tmp_path / "page.html"))
    assert [[each.name for each in outputs] for outputs in compared.outputs] == [
        ["acc_1", "acc_1"],
        ["acc_2", "acc_2"],
    ]
    assert compared.has_same_validation
    assert [panel.y_label for panel in compared_simulations(compared).panels] == ["acc_1", "acc_2"]
    assert "acc_2" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_report_lists_every_recording(results):
    page = undrawn_page(results)
    assert "4 recordings of one system are one data set" in page
    for number in range(1, 5):
        assert page.count(f"blow_{number}.csv</th>") == 1
        assert f"<dd>blow_{number}.csv</dd>" in page


@pytest.mark.parametrize(
    ("form", "order", "passed", "says"),
    [
        ("ss_oe", 4, True, "Inside: states of the plant = 4 (orders.nx: 2 to 8)."),
        ("ss_oe", 8, False, "At an end of the range: states of the plant = 8 (orders.nx: 2 to 8)."),
        # The states of such a model are those of plant and noise; the plant's were searched.
        ("ss_bj", 4, True, "Inside: states of the plant = 4 (orders.nx: 2 to 8)."),
    ],
)
def test_the_order_is_judged_by_the_orders_that_were_searched(results, form, order, passed, says):
    record = replace(load(ModelRecord, results.model), structure=form, plant_states=11)
    validation = load(Validation, results.validation)
    info = load(RecordingInfo, results.recording_info)
    tried = OrderRange("states of the plant", "orders.nx", order, 2, 8, least=2)
    found = search_ranges(Evidence(record, validation, info, (tried,)))
    assert (found.passed, found.statement) == (passed, says)


def test_every_structure_takes_several_recordings(tmp_path, monkeypatch):
    own = {key: value for key, value in BLOWS.items() if key != "form"}
    own |= {
        "input": ["hammer", "acc_2"],
        "output": "acc_1",
        "structure": "armax",
        "orders": {"plant": 2},
        "split": {"by": "samples"},
        "search": {"evaluations": 1},
    }
    monkeypatch.chdir(tmp_path)
    for number in (1, 2, 3):
        blow(number).to_csv(f"blow_{number}.csv", index=False)
    settings = complete({"datasets": {"frame": own}}).datasets["frame"]
    files = DatasetFiles.of_dataset("frame")
    identify_dataset(files, settings, with_report=False)
    record = load(ModelRecord, files.model)
    assert record.text.startswith("ARMAX(")
    simulation = pd.read_csv(files.simulation)
    assert simulation.groupby("recording").size().tolist() == [52, 52, 52]


@pytest.mark.parametrize(
    ("lengths", "keys", "says"),
    [
        ((260, 19, 250), {}, r"\(blow_2\.csv\): no stretch for estimation has 20 samples"),
        (
            (260, 30, 250),
            {"split": {"by": "samples"}},
            r"validation \(the samples of blow_2\.csv as prepared\): there are only 6 samples",
        ),
    ],
)
def test_a_recording_that_is_too_short_is_named(tmp_path, monkeypatch, lengths, keys, says):
    with pytest.raises(InputError, match=says) as caught:
        identified(tmp_path, monkeypatch, keys, lengths)
    assert "\n" not in str(caught.value)
