"""Polynomial models with several inputs: responses, state space, modes, exports."""

from dataclasses import replace

import numpy as np
import pytest
from covariances import covariance_of_matrix
from scipy.io import loadmat
from scipy.signal import dlsim, lfilter

from evopem.files.json_form import from_json, to_json
from evopem.models.orders import Orders, orders_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel, save_model_mat
from evopem.models.response_tables import response_interval

ONE = np.ones(1)
A = np.array([1.0, -1.2, 0.8])
F = (np.array([1.0, -1.6, 0.9]), np.array([1.0, -0.7]))
C, D = np.array([1.0, 0.5, 0.2, -0.1]), np.array([1.0, -0.9])
B = (np.array([1.0, 0.5]), np.array([-0.7, 0.3, 0.2, 0.1]))

MODELS = {
    "fir": (ONE, ONE, ONE, (ONE, ONE)),
    "arx": (A, ONE, ONE, (ONE, ONE)),
    "armax": (A, C, ONE, (ONE, ONE)),
    "ararx": (A, ONE, D, (ONE, ONE)),
    "ararmax": (A, C, D, (ONE, ONE)),
    "oe": (ONE, ONE, ONE, F),
    "bj": (ONE, C, D, F),
    "general": (A, C, D, F),
}


def model_of(structure, **changes):
    a, c, d, f = MODELS[structure]
    model = PolynomialModel(
        *(a, B, c, d, f, (0, 3)),
        structure=structure,
        sampling_rate=100.0,
        level=2.0,
        noise_variance=0.04,
        input_names=("u1", "u2"),
        output_names=("y",),
    )
    return replace(model, **changes)


@pytest.mark.parametrize("structure", MODELS)
def test_the_state_space_form_is_the_same_model(structure):
    model = model_of(structure)
    state_space = model.state_space()
    generator = np.random.default_rng(1)
    u, y = generator.standard_normal((300, 2)), generator.standard_normal(300)
    f = np.linspace(0.0, 50.0, 9)
    assert np.allclose(model.simulate(u), state_space.simulate(u)[:, 0], atol=1e-11)
    assert np.allclose(model.frequency_response(f), state_space.frequency_response(f), atol=1e-11)
    # The unknown past differs: a state space model at rest stands at its level.
    errors = state_space.residuals(u, y[:, None])[:, 0]
    assert np.allclose(model.residuals(u, y)[250:], errors[250:], atol=1e-7)
    assert model.plant_states <= state_space.order
    z = np.exp(2j * np.pi * f / 100.0)
    a, c, d, _ = MODELS[structure]
    noise = np.polyval(c[::-1], 1 / z) / np.polyval(np.convolve(a, d)[::-1], 1 / z)
    assert np.allclose(state_space.noise_response(f)[:, 0, 0], noise, atol=1e-10)


@pytest.mark.parametrize("structure", ["armax", "oe", "bj", "general"])
def test_intervals_of_gains_are_those_of_the_coefficients(structure):
    model = model_of(structure)
    count = len(model.parameters)
    factor = 1e-3 * np.random.default_rng(2).standard_normal((count, count))
    model = replace(model, covariance=ParameterCovariance(factor, np.zeros((count, 0))))
    f = np.linspace(1.0, 49.0, 7)
    low, high, phase_error = response_interval(model.state_space(), f)

    def gains(parameters):
        return np.abs(model.with_parameters(parameters).frequency_response(f))

    steps = 1e-6 * np.eye(count)
    slopes = [
        (gains(model.parameters + step) - gains(model.parameters - step)) / 2e-6 for step in steps
    ]
    errors = np.linalg.norm(np.einsum("pfij,pr->rfij", slopes, factor), axis=0)
    expected = 1.959963984540054 * errors / gains(model.parameters)
    assert np.allclose(0.5 * np.log(high / low), expected, rtol=1e-6)
    for own, form in zip(response_interval(model, f), (low, high, phase_error), strict=True):
        assert np.allclose(own, form, rtol=1e-6)


def test_modes_are_those_of_a_and_f_with_residues_as_participation():
    model = model_of("general")
    modes = model.modes()
    poles = [each for each in model.poles() if each.imag > 0]
    assert sorted(np.round([mode.pole for mode in modes], 10), key=abs) == sorted(
        np.round(poles, 10), key=abs
    )
    of_f = min(modes, key=lambda mode: abs(mode.pole - np.roots(F[0])[0]))
    # The second input does not reach the poles of the first one.
    assert abs(of_f.input_participation[1]) < 1e-12
    z = of_f.pole * (1 + 1e-7)
    above = np.polyval(B[0][::-1], 1 / z)
    below = np.polyval(np.convolve(A, F[0])[::-1], 1 / z)
    assert of_f.input_participation[0] == pytest.approx((z - of_f.pole) * above / below, rel=1e-5)


def test_more_coefficients_of_b_than_poles_do_not_disturb_the_modes():
    short = model_of("arx", B=(np.array([1.0, 0.5]), np.array([0.3])))
    long = model_of("arx", B=(np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.array([0.3])))
    (one,), (other,) = short.modes(), long.modes()
    assert other.frequency_hz == pytest.approx(one.frequency_hz, rel=1e-12)
    assert np.allclose(one.input_participation, other.input_participation, atol=1e-12)
    assert np.allclose(one.output_shares, other.output_shares, atol=1e-12)


def test_exports_give_the_same_responses(tmp_path):
    model = model_of("bj")
    u = np.random.default_rng(3).standard_normal((80, 2))
    simulated = model.simulate(u) - model.level
    assert np.allclose(dlsim(model.to_scipy(), u)[1][:, 0], simulated, atol=1e-9)
    pytest.importorskip("control")
    transfer = model.to_control()
    assert (transfer.noutputs, transfer.ninputs) == (1, 2)
    assert np.allclose(transfer(np.exp(0.4j * np.pi)), model.frequency_response(20.0), atol=1e-9)
    save_model_mat(model, tmp_path / "model.mat")
    stored = loadmat(tmp_path / "model.mat")
    assert stored["B"].shape == stored["F"].shape == (1, 2)
    driven = sum(
        lfilter(stored["B"][0, i].ravel(), stored["F"][0, i].ravel(), u[:, i]) for i in (0, 1)
    )
    assert np.allclose(driven, simulated)
    assert stored["Ts"].item() == 0.01
    assert stored["Level"].item() == 2.0


def test_json_gives_the_model_back():
    model = model_of("bj", covariance=covariance_of_matrix(np.eye(17)))
    again = from_json(PolynomialModel, to_json(model))
    assert np.array_equal(again.parameters, model.parameters)
    assert again.orders == model.orders
    assert np.array_equal(again.covariance.factor, model.covariance.factor)


def test_orders_in_all_notations():
    expected = Orders("oe", nb=(2, 2), nf=(3, 1), nk=(1, 1))
    assert orders_of("oe", {"nb": 2, "nf": [3, 1], "nk": 1}, 2) == expected
    assert orders_of("oe", (2, (3, 1), 1), 2) == expected
    assert str(expected) == "OE([2 2],[3 1],[1 1])"


@pytest.mark.parametrize(
    ("structure", "orders", "says"),
    [
        ("arma", {"na": 1}, "structure must be one of"),
        ("oe", {"nb": 2, "na": 1}, "not na"),
        ("oe", {"nb": [1, 2, 3], "nf": 1}, "2 inputs need 2 orders nb"),
        ("armax", {"nb": 1, "na": [1, 2], "nc": 1}, "one number for all inputs"),
        ("armax", {"nb": 1.5, "na": 1}, "whole number"),
        ("arx", {"na": 2, "nb": [1, 0]}, "nb must be at least 1"),
        ("arx", (1, 2), "takes the orders"),
    ],
)
def test_wrong_orders_are_refused(structure, orders, says):
    with pytest.raises(ValueError, match=says):
        orders_of(structure, orders, 2)
