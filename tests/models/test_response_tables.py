"""A model's tables against the model itself."""

from dataclasses import replace

import numpy as np
import pytest
from covariances import covariance_of_matrix, response_standard_errors

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import (
    NORMAL_95,
    frequency_response_table,
    response_interval,
    time_response_table,
)
from evopem.models.state_space import StateSpaceModel
from evopem.synthesis import true_model


def test_the_response_runs_from_zero_to_half_the_rate():
    model = true_model()
    table = frequency_response_table(model, ("u",), ("y",))
    assert (table["frequency_hz"][0], table["frequency_hz"][-1]) == (0.0, 50.0)
    turned = table["gain"] * np.exp(1j * np.radians(table["phase_deg"]))
    response = model.frequency_response(table["frequency_hz"])[:, 0, 0]
    np.testing.assert_allclose(turned, response, atol=1e-9)
    assert np.abs(np.diff(table["phase_deg"])).max() < 180.0


def test_a_slow_and_lightly_damped_peak_is_resolved():
    rate, frequency, damping = 100.0, 0.02, 0.01
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency / rate)
    model = PolynomialModel(
        A=np.array([1.0, -2.0 * pole.real, abs(pole) ** 2]),
        B=(np.array([1.0]),),
        nk=(1,),
        sampling_rate=rate,
    )
    table = frequency_response_table(model, ("u",), ("y",))
    fine = np.linspace(0.9 * frequency, 1.1 * frequency, 4001)
    largest = np.abs(model.frequency_response(fine)).max()
    assert table["gain"].max() > 0.99 * largest
    assert np.all(np.diff(table["frequency_hz"]) > 0.0)


def test_bands_hold_the_models_that_could_have_been_chosen():
    def gain(factor):
        one = np.array([1.0])
        return PolynomialModel(A=one, B=(factor * one,), nk=(1,), sampling_rate=100.0)

    # Without errors of the coefficients: the band is the spread of ln 1.0 and ln 1.2 around ln 1.0.
    model = replace(gain(1.0), covariance=covariance_of_matrix(np.zeros((1, 1))))
    rivals = (gain(1.0), gain(1.2))
    table = frequency_response_table(model, ("u",), ("y",), rivals=rivals)
    half = NORMAL_95 * np.log(1.2) / np.sqrt(2.0)
    np.testing.assert_allclose(np.log(table["gain_upper"]), half)
    np.testing.assert_allclose(np.log(table["gain_lower"]), -half)
    np.testing.assert_allclose(table["phase_se_deg"], 0.0, atol=1e-12)
    later = (gain(1.0), replace(gain(1.0), nk=(2,)))
    phases = frequency_response_table(model, ("u",), ("y",), rivals=later)
    degrees = 360.0 * np.asarray(phases["frequency_hz"]) / 100.0 / np.sqrt(2.0)
    np.testing.assert_allclose(phases["phase_se_deg"], degrees, atol=1e-9)
    steps = time_response_table(model, ("u",), ("y",), model, rivals)
    half = NORMAL_95 * 0.2 / np.sqrt(2.0)
    np.testing.assert_allclose(np.subtract(steps["step_upper"], steps["step"])[1], half)


def state_space_model():
    generator = np.random.default_rng(3)
    A = np.array([[0.8, 0.4, 0.0], [-0.4, 0.8, 0.0], [0.0, 0.0, 0.5]])
    B, C, K = (0.3 * generator.standard_normal(shape) for shape in ((3, 2), (2, 3), (3, 2)))
    return StateSpaceModel(A, B, C, np.zeros((2, 2)), K, 100.0, np.zeros(2), np.eye(2))


def test_the_noise_of_several_outputs_has_the_bands_of_its_coefficients():
    model, generator = state_space_model(), np.random.default_rng(4)
    factor = 1e-3 * generator.standard_normal((len(model.parameters), 4))
    model = replace(
        model, covariance=ParameterCovariance(factor, np.zeros((len(model.parameters), 0)))
    )
    f = np.linspace(1.0, 49.0, 5)
    table = frequency_response_table(model, ("a", "b"), ("x", "y"), frequencies=f)

    def gains(model):
        return np.abs(np.einsum("tii->it", model.noise_response(f)))

    moved = [[model.with_parameters(model.parameters + s * d) for s in (1, -1)] for d in factor.T]
    slopes = [0.5 * (gains(up) - gains(down)) for up, down in moved]
    errors = np.linalg.norm(slopes, axis=0) / gains(model)
    of_input = [pair == "a" for pair in table["input"]]
    widths = np.log(table["noise_gain_upper"] / table["noise_gain_lower"])[of_input]
    np.testing.assert_allclose(widths, 2.0 * NORMAL_95 * errors.ravel(), rtol=1e-3)


def test_the_noise_responds_to_unit_innovations():
    model = state_space_model()
    expected = [np.eye(2)] + [
        model.C @ np.linalg.matrix_power(model.A, lag) @ model.K for lag in range(9)
    ]
    for samples in (1, 2, 10):
        found = model.noise_impulse_response(samples)
        np.testing.assert_allclose(found, expected[:samples], atol=1e-14)


def of_two_inputs_and_outputs():
    generator = np.random.default_rng(3)
    A = np.array([[0.7, 0.4, 0.0], [-0.4, 0.7, 0.1], [0.0, 0.2, 0.5]])
    parts = [generator.standard_normal(shape) for shape in ((3, 2), (2, 3), (2, 2))]
    K = 0.1 * generator.standard_normal((3, 2))
    model = StateSpaceModel(A, *parts, K, 100.0, np.zeros(2), np.eye(2), input_delays=(0, 2))
    entries = model.parameters.size
    factor = 1e-4 * generator.standard_normal((entries, entries + 3))
    return replace(model, covariance=ParameterCovariance(factor, np.zeros((entries, 0))))


def of_polynomials():
    covariance = covariance_of_matrix(1e-6 * np.diag(np.arange(1.0, 6.0)))
    A, B, C = np.array([1.0, -1.2, 0.8]), np.array([0.5, 0.1]), np.array([1.0, 0.4])
    return PolynomialModel(A, B, C, nk=3, sampling_rate=50.0, covariance=covariance)


@pytest.mark.parametrize("made", [of_two_inputs_and_outputs, of_polynomials])
def test_bands_in_time_are_those_of_central_differences(made):
    model = made()
    count = model.noise_response(0.0).shape[0]
    names = (f"u{k}" for k in range(count)), (f"y{k}" for k in range(count))
    table = time_response_table(model, *map(tuple, names), model)
    samples = len(table["time_s"]) // count**2
    for name, response in (
        ("impulse", lambda some: some.impulse_response(samples)),
        ("step", lambda some: some.step_response(samples)),
        ("noise_impulse", lambda some: some.noise_impulse_response(samples)),
    ):
        half = table[f"{name}_upper"] - table[name]
        half = half.reshape(count, count, samples).transpose(2, 0, 1)
        expected = NORMAL_95 * response_standard_errors(model, response)
        if name == "noise_impulse":
            expected = np.einsum("tii->ti", expected)[:, :, None] * np.ones(count)
        np.testing.assert_allclose(half, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("noise", [False, True])
def test_bands_in_frequency_are_those_of_central_differences(noise):
    model, frequencies = of_two_inputs_and_outputs(), np.linspace(1.0, 49.0, 7)

    def response(some):
        if noise:
            return np.einsum("tii->ti", some.noise_response(frequencies))[..., None]
        return some.frequency_response(frequencies)

    now = response(model)
    _, upper, phases = response_interval(model, frequencies, noise)
    expected = response_standard_errors(model, lambda some: np.log(response(some) / now).imag)
    np.testing.assert_allclose(phases, expected, rtol=1e-5)
    expected = response_standard_errors(model, lambda some: np.log(response(some) / now).real)
    np.testing.assert_allclose(np.log(upper / np.abs(now)), NORMAL_95 * expected, rtol=1e-5)
