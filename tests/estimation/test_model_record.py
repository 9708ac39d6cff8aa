"""The record of a model: complete, exact, and read back as the same model."""

import json

import numpy as np
import pytest

import evopem
from evopem.config.settings import PreparationSettings, SearchSettings, SplitSettings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.structured_estimate import estimate
from evopem.files.json_form import load, save
from evopem.signals.preparation import prepare
from evopem.synthesis.armax import armax

SETTINGS = SearchSettings(objective="quadratic", evaluations=500, seed=3)


@pytest.fixture(scope="module")
def estimated():
    recording, _ = armax(seed=1, samples=900, box_cox=1.1, difference=2)
    preparation = PreparationSettings(split=SplitSettings(discard=0, estimation=700))
    prepared = prepare(recording, preparation)
    data = prepared.estimation
    found = estimate(data.input, data.output, (3, 2, 2, 3), 100.0, settings=SETTINGS)
    return found, prepared.transforms


@pytest.fixture
def path(estimated, tmp_path):
    found, transforms = estimated
    save(ModelRecord.of(found, SETTINGS, transforms), tmp_path / "model.json")
    return tmp_path / "model.json"


def test_json_keeps_every_bit_of_the_model(estimated, path):
    model, again = estimated[0].model, evopem.load(path)
    for name in ("a", "b", "c", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    for name in ("nk", "orders", "sampling_rate", "noise_variance"):
        assert getattr(again, name) == getattr(model, name)


def test_the_record_says_how_the_model_was_found(estimated, path):
    found, transforms = estimated
    record = load(ModelRecord, path)
    assert record.search.settings == SETTINGS
    assert record.search.diagnostics == found.search.diagnostics
    assert record.search.at_stability_bound == found.at_stability_bound
    assert record.criteria == found.criteria
    assert record.window == found.window
    assert record.transforms == transforms
    np.testing.assert_array_equal(record.noise_state, found.noise_state)


def test_roots_modes_and_standard_errors_are_those_of_the_model(estimated, path):
    model, record = estimated[0].model, load(ModelRecord, path)
    assert list(record.modes) == model.modes()
    np.testing.assert_allclose(np.real(np.poly(record.poles)), model.a, rtol=1e-12)
    np.testing.assert_allclose(np.real(np.poly(record.noise_zeros)), model.c, rtol=1e-12)
    np.testing.assert_allclose(np.real(np.poly(record.zeros)) * model.b[0], model.b, rtol=1e-12)
    np.testing.assert_array_equal(
        record.parameter_standard_errors, model.parameter_standard_errors()
    )


def test_other_programs_read_plain_json(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    orders = {"na": 3, "nb": [2], "nc": 2, "nd": 0, "nf": [0], "nk": [3]}
    assert content["orders"] == orders | {"structure": "armax"}
    assert content["search"]["settings"]["lambda"] == 100
    assert content["evopem"] == evopem.__version__
    assert content["versions"]["numpy"] == np.__version__
    assert len(content["poles"]) == 3
    assert all(len(pole) == 2 for pole in content["poles"])


@pytest.mark.parametrize(
    ("content", "problem"),
    [("{", "is not valid JSON"), ("[]", "another form"), ('{"a": [1]}', "is missing")],
)
def test_other_files_are_refused_in_a_sentence(tmp_path, content, problem):
    path = tmp_path / "model.json"
    path.write_text(content)
    with pytest.raises(InputError, match=problem) as caught:
        evopem.load(path)
    assert str(caught.value).endswith("give the model.json of a results folder.")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.json: cannot be read \(No such file"):
        evopem.load(tmp_path / "absent.json")
