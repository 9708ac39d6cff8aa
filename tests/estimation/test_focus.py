"""Fits for k steps and for simulation: gradients, what they gain, and where all agree."""

import numpy as np
import pytest
from simulated_records import polynomial_record

from evopem import SearchSettings, estimate
from evopem.config.settings import ScoringWindow
from evopem.estimation.pem.derived_errors import KStepErrors
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.models.orders import STRUCTURES
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment

QUADRATIC = SearchSettings(objective="quadratic")
SHORT = SearchSettings(objective="quadratic", evaluations=0)
ONE = np.ones(1)
RESONANT = np.poly([0.92 * np.exp(0.6j), 0.92 * np.exp(-0.6j)]).real
DAMPED = np.poly([0.8 * np.exp(1.5j), 0.8 * np.exp(-1.5j)]).real
COLOUR = np.array([1.0, 0.5, 0.2])
B = np.array([1.0, 0.6])
GENERAL = PolynomialModel(np.array([1.0, -0.5]), B, COLOUR, np.array([1.0, 0.3]), RESONANT, 1)

TRUTHS = {
    "arx": PolynomialModel(RESONANT, B, ONE, ONE, ONE, 1),
    "armax": PolynomialModel(RESONANT, B, COLOUR, ONE, ONE, 1),
    "bj": PolynomialModel(ONE, B, COLOUR, DAMPED, RESONANT, 1),
    "general": PolynomialModel(DAMPED, B, ONE, np.array([1.0, 0.4]), RESONANT, 1),
}


def problem(u, y, objective, level, window):
    stretches = [Segment(u, y)]
    return PolynomialErrors(stretches, GENERAL.orders, objective, 0.999, 0.999, level, window)


def record(model, samples, seed, noise_percent=20.0):
    return polynomial_record(model, samples, noise_percent, np.random.default_rng(seed))


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize("horizon", [1, 2, 7])
def test_the_gradient_of_k_step_errors_is_right(objective, horizon):
    u, y, _ = record(GENERAL, 300, 1)
    one_step = problem(u, y, objective, True, ScoringWindow(2, 10))
    errors = KStepErrors(one_step, horizon)
    point = np.concatenate([1.03 * GENERAL.parameters, [0.1], np.full(4, 0.1)])
    smoothing, barrier = np.array([0.1]), np.array([0.01])

    def value(at):
        return errors.values_and_gradients(at[None, :], smoothing, barrier)[0][0]

    steps = 1e-6 * np.eye(len(point))
    _, gradients = errors.values_and_gradients(point[None, :], smoothing, barrier)
    differences = [(value(point + h) - value(point - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(gradients[0], differences, atol=1e-6 * np.max(np.abs(gradients)))
    columns = [(errors.residuals(point + h) - errors.residuals(point - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(errors.jacobian(point), np.transpose(columns), atol=1e-5)


@pytest.mark.parametrize("horizon", [1, 2, 7])
def test_k_step_errors_are_those_of_the_models_prediction(horizon):
    u, y, _ = record(GENERAL, 300, 1)
    errors = problem(u, y, "quadratic", False, ScoringWindow(2, 2))
    point = np.concatenate([GENERAL.parameters, np.zeros(4)])
    expected = (y - GENERAL.predict(u, y, horizon))[2:]
    np.testing.assert_allclose(KStepErrors(errors, horizon).residuals(point), expected, atol=1e-10)


def test_each_focus_is_the_best_at_its_own_errors_when_the_order_is_too_low():
    truth = PolynomialModel(ONE, B, COLOUR, ONE, np.convolve(RESONANT, DAMPED), 1)
    u, y, _ = record(truth, 800, 3)
    found = {
        focus: estimate(u, y, (2, 2, 1), structure="arx", settings=QUADRATIC, focus=focus)
        for focus in ("prediction", 8, "simulation")
    }

    def simulation_error(model):
        form = model.plant().state_space()
        return np.sum((y - form.simulate_from_fitted_state(u[:, None], y[:, None])[:, 0]) ** 2)

    def prediction_error(model, horizon):
        return np.nansum((y - model.predict(u, y, horizon)) ** 2)

    at_eight = {focus: prediction_error(each.model, 8) for focus, each in found.items()}
    assert min(at_eight, key=at_eight.get) == 8
    assert at_eight[8] < 0.9 * at_eight["prediction"]
    simulated = {focus: simulation_error(each.model) for focus, each in found.items()}
    assert min(simulated, key=simulated.get) == "simulation"
    ahead = {focus: prediction_error(each.model, 1) for focus, each in found.items()}
    assert min(ahead, key=ahead.get) == "prediction"
    for focus, each in found.items():
        assert each.focus == focus


@pytest.mark.parametrize("structure", TRUTHS)
def test_with_the_true_orders_every_focus_finds_the_truth(structure):
    truth = TRUTHS[structure]
    u, y, _ = record(truth, 1000, 5)
    names = STRUCTURES[structure]
    orders = {name: getattr(truth.orders.single, name) for name in names}
    for focus in ("prediction", 2, "simulation"):
        found = estimate(u, y, orders, structure=structure, settings=SHORT, focus=focus)
        errors = found.model.parameters - truth.parameters
        deviations = np.sqrt(np.diag(found.model.covariance.matrix))
        np.testing.assert_array_less(np.abs(errors), 4.0 * deviations)


def test_the_level_of_a_simulation_is_that_of_the_output():
    truth = TRUTHS["armax"]
    u, y, _ = record(truth, 800, 5)
    found = estimate(
        u, y + 9.0, (2, 2, 2, 1), settings=QUADRATIC, focus="simulation", level=True
    ).model
    assert found.output_level == pytest.approx(9.0, abs=0.5)


def test_the_horizon_does_not_matter_where_the_noise_is_white():
    u, y, _ = record(PolynomialModel(ONE, B, ONE, ONE, RESONANT, 1), 500, 5)
    one, other = (
        estimate(u, y, (2, 2, 1), structure="oe", settings=QUADRATIC, focus=focus).model
        for focus in ("prediction", 4)
    )
    np.testing.assert_array_equal(one.parameters, other.parameters)


@pytest.mark.parametrize(
    ("focus", "structure", "orders", "message"),
    [
        (0, "oe", (1, 1, 1), "number of samples"),
        (2.5, "oe", (1, 1, 1), "number of samples"),
        ("control", "oe", (1, 1, 1), "number of samples"),
        ("simulation", "arma", (1, 1), "nothing to simulate"),
    ],
)
def test_a_bad_focus_is_refused(focus, structure, orders, message):
    u, y = np.random.default_rng(1).standard_normal((2, 100))
    with pytest.raises(ValueError, match=message):
        estimate(None if structure == "arma" else u, y, orders, structure=structure, focus=focus)
