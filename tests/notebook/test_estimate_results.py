"""What `evopem.estimate` returns: the estimate, and the results that `evopem.identify` shows."""

import pickle

import matplotlib as mpl
import numpy as np
import pytest
from scipy.signal import lfilter

import evopem
from evopem.figures.time_domain import record
from evopem.notebook.estimate_results import OF_RESULTS, EstimateResults
from evopem.validation.checks.inputs import OTHER_SAMPLES

mpl.use("agg")
RATE, POLES = 100.0, [1.0, -1.5, 0.7]
SETTINGS = evopem.SearchSettings(objective="quadratic", evaluations=200)


def signals(inputs=1, outputs=1, samples=400):
    generator = np.random.default_rng(1)
    u = generator.standard_normal((samples, inputs))
    noise = 0.1 * generator.standard_normal((samples, outputs))
    y = sum(lfilter([0.0, 1.0], POLES, column) for column in u.T) if inputs else 0.0
    disturbed = lfilter([1.0], POLES, noise, axis=0)
    return (u if inputs else None), np.add(y, disturbed.T).T


def estimated(orders, structure, inputs=1, outputs=1, **options):
    u, y = signals(inputs, outputs)
    return evopem.estimate(u, y, orders, RATE, structure=structure, settings=SETTINGS, **options)


@pytest.fixture(scope="module")
def arx():
    return estimated((2, 2, 1), "arx")


@pytest.fixture(scope="module")
def several():
    u, y = signals(2, 2)
    joined = evopem.Recording(u, y, RATE, segment_starts=(0, 200), segment_recordings=(0, 1))
    return evopem.estimate(joined, None, 2, structure="ss", settings=SETTINGS)


def test_it_has_what_identify_returns():
    named = {name for name in dir(evopem.Results) if name.startswith("plot_")}
    assert named < set(OF_RESULTS)
    assert set(OF_RESULTS) - {"results"} < set(dir(evopem.Results))
    for name in OF_RESULTS:
        assert vars(EstimateResults)[name].__doc__


def test_it_is_still_the_estimate(arx):
    assert isinstance(arx, evopem.PolynomialEstimate)
    u, y = signals()
    residuals = y[:, 0] - arx.predict(u, y[:, 0])
    assert residuals[10:] == pytest.approx(arx.residuals[10:], abs=1e-9)
    assert np.array_equal(arx.simulate(u), arx.model.simulate(u))


def test_a_terminal_shows_modes_errors_and_that_no_sample_was_held_out(arx):
    text = " ".join(repr(arx).split())
    (mode,) = arx.model.modes()
    assert arx.modes["frequency_hz"].tolist() == [mode.frequency_hz]
    assert arx.modes["trusted"].tolist() == [True]
    assert f"simulation {arx.simulation_error_percent:.3g}" in text
    assert "of these" in text
    assert f"caution {OTHER_SAMPLES}" in text
    assert OTHER_SAMPLES in arx._repr_html_()
    answers = {use.key: use.answer for use in arx.uses}
    assert answers["simulation"] == answers["prediction"] == "care"


def test_what_held_out_samples_alone_tell_is_not_judged(arx):
    names = {check.name for check in arx.checks}
    assert names.isdisjoint({"Response to the input significant", "Validation input comparable"})
    assert not arx.validation.floors
    assert np.isnan(arx.validation.input_test.p_value)


def test_the_error_of_the_prediction_is_that_of_the_residuals(arx):
    y, e = signals()[1][:, 0], arx.residuals
    scored = slice(-arx.validation.samples, None)
    deviation = np.linalg.norm(y[scored] - y[scored].mean())
    error = 100.0 * np.linalg.norm(e[scored]) / deviation
    assert arx.prediction_error_percent == pytest.approx(error, rel=1e-6)


@pytest.mark.parametrize(
    ("structure", "orders"),
    [("fir", (8, 1)), ("impulse", (20, 1)), ("bj", (2, 1, 1, 2, 1)), ("ss_oe", 2), ("ss_bj", 2)],
)
def test_every_structure_is_shown_and_plotted(structure, orders):
    model = estimated(orders, structure)
    assert model.summary.model in repr(model).replace("\\n", " ")
    assert len(model.plot_frequency_response()) == 3
    assert model.plot_step_response().has_data()
    mpl.pyplot.close("all")


def test_several_channels_are_reported_and_saved(several, tmp_path):
    assert several.shapes.shape[1] == 2
    page = several.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert "All 400 samples are used for estimation, and validate the model as well." in page
    assert "estimation samples" in page
    assert "validation sample" not in page
    assert "The structure and the orders were given." in page
    assert "smaller scores are better" not in page
    assert set(record(several.results).table["stage"]) == {"recorded", "estimation"}
    folder = several.save(tmp_path / "kept")
    again = evopem.read_results(folder)
    assert again.modes.equals(several.modes)
    assert again.verdict == several.verdict
    assert np.array_equal(evopem.load(folder / "model.json").A, several.model.A)


def test_estimates_are_compared_with_each_other_and_with_identifications(arx):
    u, y = signals()
    keys = {"structure": "oe", "orders": (2, 2, 1), "show_progress": False, "name": "oe"}
    identified = evopem.identify(u, y, RATE, **keys)
    assert list(arx.compare(identified).table.index) == ["data", "oe"]
    assert list(identified.compare(arx).table.index) == ["oe", "data"]
    with pytest.raises(evopem.InputError, match="give what identify or estimate returns"):
        arx.compare(arx.model)


def test_without_an_input_there_is_no_response_to_one():
    model = estimated(2, "ss", inputs=0)
    with pytest.raises(evopem.InputError, match="the model has no input"):
        model.plot_step_response()
    assert model.plot_impulse_response().has_data()
    with pytest.raises(evopem.InputError, match="a mode of one output has no shape"):
        model.shapes  # noqa: B018
    mpl.pyplot.close("all")


def test_recordings_with_levels_of_their_own_are_simulated_with_these():
    u, y = signals()
    outputs = np.concatenate([y + 1.0, y + 3.0])
    both = evopem.Recording(
        np.concatenate([u, u]), outputs, RATE, segment_starts=(0, 400), segment_recordings=(0, 1)
    )
    options = {"structure": "oe", "level": True, "settings": SETTINGS}
    model = evopem.estimate(both, orders=(2, 2, 1), **options)
    alone = evopem.estimate(u, y + 1.0, (2, 2, 1), RATE, **options)
    expected = alone.simulation_error_percent
    assert model.results.model.level_of_simulation == "state"
    # The mean of the joint outputs moves with their levels, so that its deviation is larger.
    assert model.simulation_error_percent < expected


def test_constraints_are_kept_with_the_model():
    model = estimated((2, 2, 1), "arx", constraints=evopem.Constraints(static_gain=5.0))
    assert model.results.model.fit.constraints.static_gain == 5.0
    assert "static_gain" in model.results.model.fit.active


def test_estimates_of_orders_show_themselves():
    recording = evopem.Recording(*signals(), RATE)
    orders = evopem.estimates_of_orders(recording, [1, 2], structure="ss_oe", settings=SETTINGS)
    for order, model in enumerate(orders, 1):
        assert f"state space, {order} state" in repr(model)
        assert model.results.model.structure == "ss_oe"


def test_an_estimate_is_pickled_with_and_without_its_results(arx):
    assert arx.summary
    again = pickle.loads(pickle.dumps(arx))
    assert repr(again) == repr(arx)


def test_too_few_samples_to_judge_are_said_beside_the_model():
    u, y = signals(samples=14)
    model = evopem.estimate(u, y, (1, 1, 1), RATE, structure="arx", level=True, settings=SETTINGS)
    assert "PolynomialModel" in repr(model) or "ARX" in repr(model)
