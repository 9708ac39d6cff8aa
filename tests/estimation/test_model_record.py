"""The record of a model: complete, exact, and read back as the same model."""

import json

import numpy as np
import pytest

import evopem
from evopem.config.settings import PreparationSettings, SearchSettings, SplitSettings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load, save
from evopem.notebook.estimate import estimate
from evopem.signals.preparation import prepare
from evopem.synthesis import armax

SETTINGS = SearchSettings(objective="quadratic", evaluations=500, seed=3)


@pytest.fixture(scope="module")
def estimated():
    recording, _ = armax(seed=1, samples=900, box_cox=1.1, difference=2)
    preparation = PreparationSettings(split=SplitSettings(discard=0, estimation=700))
    prepared = prepare(recording, preparation)
    data = prepared.estimation
    found = estimate(data.input, data.output, (3, 2, 2, 3), 100.0, settings=SETTINGS)
    return found, data, prepared.transforms


@pytest.fixture
def path(estimated, tmp_path):
    found, data, transforms = estimated
    save(ModelRecord.of(found, data, SETTINGS, transforms), tmp_path / "model.json")
    return tmp_path / "model.json"


def test_json_keeps_every_bit_of_the_model(estimated, path):
    model, again = estimated[0].model, evopem.load(path)
    for name in ("A", "B", "C", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    for name in ("nk", "orders", "sampling_rate", "noise_variance"):
        assert getattr(again, name) == getattr(model, name)


def test_the_record_says_how_the_model_was_found(estimated, path):
    found, _, transforms = estimated
    record = load(ModelRecord, path)
    assert record.search.settings == SETTINGS
    assert record.search.diagnostics == found.search.diagnostics
    assert record.search.at_stability_bound == found.at_stability_bound
    assert (record.objective, record.bic) == (found.criteria.objective, found.criteria.bic)
    assert record.fit_percent == (found.criteria.fit_percent,)
    assert record.window == found.window
    assert record.transforms == transforms
    states = np.concatenate([found.plant_state, found.noise_state])
    np.testing.assert_array_equal(record.initial_states, states)


def test_roots_modes_and_standard_errors_are_those_of_the_model(estimated, path):
    model, record = estimated[0].model, load(ModelRecord, path)
    assert list(record.modes) == model.modes()
    np.testing.assert_allclose(np.real(np.poly(record.poles)), model.A, rtol=1e-12)
    np.testing.assert_allclose(np.real(np.poly(record.noise_zeros)), model.C, rtol=1e-12)
    np.testing.assert_allclose(
        np.real(np.poly(record.zeros[0])) * model.B[0][0], model.B[0], rtol=1e-12
    )
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
    [("{", "is not valid JSON"), ("[]", "another form"), ('{"a": [1]}', "the key a is not known")],
)
def test_other_files_are_refused_in_a_sentence(tmp_path, content, problem):
    path = tmp_path / "model.json"
    path.write_text(content)
    with pytest.raises(InputError, match=problem) as caught:
        evopem.load(path)
    assert str(caught.value).endswith("give the model.json of a results folder.")


def changed(*keys, value):
    def change(content):
        place = content
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    return change


def too_few(content):
    content["model"]["B"][0].pop()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (changed("model", "A", 0, value=2), "A, C, D or F does not begin with 1"),
        (too_few, r"polynomials are those of ARMAX\(3,1,2,3\), not of ARMAX\(3,2,2,3\)"),
        (changed("model", "sampling_rate", value=-5.0), "the sampling rate is -5.0 Hz"),
        (changed("model", "sampling_rate", value=None), "the sampling rate is nan Hz"),
        (changed("model", "noise_variance", value=-1.0), "a variance is negative"),
        (changed("model", "noise_variance", value=None), "is not finite"),
        (changed("model", "C", 1, value=None), "is not finite"),
        (changed("structure", value="magic"), "the structure magic is not"),
        (changed("evopem", value="999.1"), "later than this"),
        (changed("model", "covariance", "factor", value=[[1.0]]), "covariance"),
        (changed("model", "sampling_rate", value=10**400), "is too large"),
        (changed("orders", "nf", value=[9]), "polynomials are those of"),
        (changed("output_names", value=[]), "output_names has not 1 entries"),
        (changed("fit_percent", value=[1.0, 2.0]), "fit_percent has not 1 entries"),
        (changed("poles", value=[[0.5, 0.0]]), "poles has not 3 entries"),
        (changed("parameter_standard_errors", value=[0.1]), "errors has not"),
    ],
)
def test_numbers_that_are_no_model_are_refused(path, change, problem):
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=problem):
        evopem.load(path)


def test_a_delay_beyond_the_samples_is_refused(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    content["model"]["nk"] = content["orders"]["nk"] = [10**9]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"reaches back 1000000001 of 700 samples"):
        evopem.load(path)


def test_deep_nesting_is_refused(path):
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match="is not valid JSON"):
        evopem.load(path)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_no_json_are_refused(path, number):
    content = json.loads(path.read_text(encoding="utf-8"))
    content["bic"] = "here"
    path.write_text(json.dumps(content).replace('"here"', number))
    with pytest.raises(InputError, match="is not valid JSON"):
        evopem.load(path)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"nk": [10**9]}, "reaches back 1000000000 of 10000 samples"),
        ({"A": [2.0, 1.0]}, "does not begin with 1"),
        ({"A": [1.0, None]}, "is not finite"),
        ({"A": []}, ""),
        ({"A": 5.0}, ""),
        ({"sampling_rate": 0.0}, r"the sampling rate is 0\.0 Hz"),
        ({"noise_variance": -1.0}, "a variance is negative"),
    ],
)
def test_a_model_without_a_record_is_checked_alike(tmp_path, changes, problem):
    path = tmp_path / "plain.json"
    save(evopem.PolynomialModel([1.0, -0.5], [2.0], nk=1), path)
    assert evopem.load(path).nk == (1,)
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | changes))
    with pytest.raises(InputError, match=problem):
        evopem.load(path)


@pytest.mark.parametrize("given", [None, 1, b"x", [], "x" * 5000])
@pytest.mark.parametrize("read", [evopem.load, evopem.read_results])
def test_what_is_no_path_is_refused(read, given):
    with pytest.raises(InputError, match="is no path"):
        read(given)


def test_a_device_is_no_model():
    with pytest.raises(InputError, match="is no regular file"):
        evopem.load("/dev/null")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.json: cannot be read \(No such file"):
        evopem.load(tmp_path / "absent.json")
