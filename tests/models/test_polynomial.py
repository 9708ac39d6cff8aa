"""Polynomial models against difference equations and SciPy."""

import numpy as np
import pytest
from scipy import signal

from evopem.models.orders import STRUCTURES, Orders, orders_of
from evopem.models.polynomial import PolynomialModel, state_space_of

ONE = np.ones(1)
MODEL = PolynomialModel(
    A=np.array([1.0, -0.6]),
    B=np.array([1.0, 0.4, -0.2]),
    C=np.array([1.0, 0.5, 0.3]),
    D=np.array([1.0, -0.7]),
    F=np.poly([0.9 * np.exp(0.7j), 0.9 * np.exp(-0.7j)]).real,
    nk=2,
    sampling_rate=50.0,
    level=0.3,
)


def record(model, samples=300, noise=0.2, seed=1):
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    y = model.simulate(u) + signal.lfilter(model.C, model.noise_denominator, noise * e)
    return u, y, noise * e


def test_residuals_are_the_innovations_that_made_the_output():
    u, y, e = record(MODEL, 2000)
    residuals = MODEL.residuals(u, y)
    assert np.isnan(residuals[:4]).all()
    np.testing.assert_allclose(residuals[200:], e[200:], atol=1e-9)


@pytest.mark.parametrize("horizon", [1, 2, 5, 12])
def test_a_prediction_is_the_mean_of_the_future_given_the_past(horizon):
    """Run the model on from the sample ``horizon`` before, without further innovations."""
    u, y, e = record(MODEL, 120)
    predicted = MODEL.predict(u, y, horizon)
    # The same past as the predictor's: nothing before the first residual.
    first = MODEL.orders.first_residual
    e = np.nan_to_num(MODEL.residuals(u, y))
    x = np.zeros(len(u))
    x[first:] = signal.lfilter(ONE, MODEL.F[0], signal.lfilter(MODEL.delayed_b(), ONE, u)[first:])
    for t in (60, 90, 119):
        known = t - horizon
        innovations = np.where(np.arange(len(u)) <= known, e, 0.0)
        noise = np.zeros(len(u))
        noise[first:] = signal.lfilter(MODEL.C, MODEL.D, innovations[first:])
        future = y.copy()
        for s in range(known + 1, t + 1):
            future[s] = x[s] + noise[s] + MODEL.level - MODEL.A[1] * future[s - 1]
        assert predicted[t] == pytest.approx(future[t], abs=1e-9)


def test_one_step_prediction_leaves_the_residuals():
    u, y, _ = record(MODEL)
    predicted = MODEL.predict(u, y)
    np.testing.assert_allclose((y - predicted)[4:], MODEL.residuals(u, y)[4:], atol=1e-12)


def test_an_output_is_given_with_or_without_a_second_dimension():
    u, y, _ = record(MODEL, 50)
    for model in (MODEL, MODEL.state_space()):
        for of in (model.residuals, model.predict):
            np.testing.assert_array_equal(of(u[:, None], y[:, None]), of(u, y))
    with pytest.raises(ValueError, match=r"output must be \(N, 1\), not \(50, 2\)"):
        MODEL.predict(u, np.column_stack([y, y]))
    with pytest.raises(ValueError, match="inputs have 49 samples, the output has 50"):
        MODEL.residuals(u[1:], y)


def test_a_prediction_over_a_long_horizon_is_the_simulation():
    u, y, _ = record(MODEL, 600)
    far = MODEL.predict(u, y, 500)
    np.testing.assert_allclose(far[-50:], MODEL.simulate(u)[-50:], atol=1e-6)


def test_simulation_follows_the_difference_equations():
    u, _, _ = record(MODEL, 200)
    x, y = np.zeros((2, 200))
    for t in range(200):
        x[t] = sum(MODEL.B[0][j] * u[t - 2 - j] for j in range(3) if t - 2 - j >= 0)
        x[t] -= sum(MODEL.F[0][k] * x[t - k] for k in (1, 2) if t >= k)
        y[t] = x[t] - (MODEL.A[1] * y[t - 1] if t else 0.0)
    np.testing.assert_allclose(MODEL.simulate(u), y + 0.3 / 0.4, atol=1e-9)


def test_the_initial_state_is_found_from_a_stretch():
    u, _, _ = record(MODEL, 400)
    whole = MODEL.simulate(u)
    found = MODEL.plant().state_space().simulate_from_fitted_state(u[100:, None], whole[100:, None])
    np.testing.assert_allclose(found[:, 0], whole[100:], atol=1e-8)


def test_responses_are_scipys():
    plant = MODEL.to_scipy()
    frequencies = np.linspace(0.1, 24.0, 20)
    _, expected = signal.freqz(
        MODEL.delayed_b(), MODEL.plant_denominator, worN=frequencies, fs=50.0
    )
    np.testing.assert_allclose(MODEL.frequency_response(frequencies)[:, 0, 0], expected, rtol=1e-9)
    _, expected = signal.freqz(MODEL.C, MODEL.noise_denominator, worN=frequencies, fs=50.0)
    np.testing.assert_allclose(MODEL.noise_response(frequencies)[:, 0, 0], expected, rtol=1e-9)
    _, (impulse,) = signal.dimpulse(plant, n=40)
    _, (step,) = signal.dstep(plant, n=40)
    np.testing.assert_allclose(MODEL.impulse_response(40)[:, 0], impulse, atol=1e-9)
    np.testing.assert_allclose(MODEL.step_response(40)[:, 0], step, atol=1e-9)


@pytest.mark.parametrize("model", [MODEL, state_space_of(MODEL)])
def test_a_response_above_half_the_sampling_rate_is_warned_of(model, recwarn):
    """As of a model of a recording that was resampled, whose signals reach higher."""
    model.frequency_response([0.0, 25.0])
    assert not list(recwarn)
    with pytest.warns(UserWarning, match="30 Hz is above half the sampling rate of the model, 25"):
        model.frequency_response([1.0, 30.0])


def test_poles_and_zeros_of_plant_and_noise():
    np.testing.assert_allclose(
        np.sort_complex(MODEL.poles()),
        np.sort_complex([0.6, 0.9 * np.exp(0.7j), 0.9 * np.exp(-0.7j)]),
        atol=1e-12,
    )
    np.testing.assert_allclose(np.sort(MODEL.noise_poles().real), [0.6, 0.7], atol=1e-12)
    np.testing.assert_allclose(np.poly(MODEL.zeros()).real, [1.0, 0.4, -0.2], atol=1e-12)
    np.testing.assert_allclose(np.poly(MODEL.noise_zeros()).real, MODEL.C, atol=1e-12)
    (mode,) = MODEL.modes()
    assert mode.pole == pytest.approx(0.9 * np.exp(0.7j))
    assert MODEL.noise_modes() == []


@pytest.mark.parametrize(
    ("structure", "tuple_of_orders", "expected"),
    [
        ("fir", (5, 1), {"nb": 5, "nk": 1}),
        ("arx", (2, 3, 1), {"na": 2, "nb": 3, "nk": 1}),
        ("arma", (2, 1), {"na": 2, "nc": 1}),
        ("armax", (2, 3, 1, 0), {"na": 2, "nb": 3, "nc": 1, "nk": 0}),
        ("ararx", (2, 3, 4, 1), {"na": 2, "nb": 3, "nd": 4, "nk": 1}),
        ("ararmax", (2, 3, 1, 4, 1), {"na": 2, "nb": 3, "nc": 1, "nd": 4, "nk": 1}),
        ("oe", (4, 3, 1), {"nb": 4, "nf": 3, "nk": 1}),
        ("bj", (4, 2, 1, 3, 1), {"nb": 4, "nc": 2, "nd": 1, "nf": 3, "nk": 1}),
        ("general", (1, 2, 3, 4, 5, 6), dict(zip(STRUCTURES["general"], range(1, 7), strict=True))),
    ],
)
def test_orders_come_as_matlabs_tuples_or_as_mappings(structure, tuple_of_orders, expected):
    orders = orders_of(structure, tuple_of_orders)
    assert orders == orders_of(structure, expected) == Orders(**expected)
    assert orders_of(structure, orders) == orders


@pytest.mark.parametrize(
    ("structure", "orders", "message"),
    [
        ("tf", (1, 1), "structure must be one of"),
        ("oe", (1, 1), r"takes the orders \(nb, nf, nk\)"),
        ("fir", 8, r"takes the orders \(nb, nk\), not 8"),
        ("oe", {"nb": 1, "nc": 2}, "has the orders nb, nf, nk, not nc"),
        ("oe", {"nb": 0, "nf": 2}, "nb must be at least 1"),
        ("arx", {"na": -1, "nb": 1}, "negative order"),
        ("arx", {"na": 1.5, "nb": 1}, "na must be a whole number"),
        ("fir", {}, "no parameter"),
    ],
)
def test_orders_that_make_no_sense_are_refused(structure, orders, message):
    with pytest.raises(ValueError, match=message):
        orders_of(structure, orders)


def test_orders_name_their_structure_and_contain_smaller_ones():
    assert Orders(nb=2, nf=2).structure == "oe"
    assert Orders(na=2, nb=2, nc=1, nk=1).structure == "armax"
    assert Orders(na=2, nb=2, nf=1).structure == "general"
    larger = Orders(nb=4, nc=1, nd=1, nf=3, nk=1)
    assert larger.contains(Orders(nb=2, nf=3, nk=2))
    assert not larger.contains(Orders(nb=4, nf=3, nk=2))
    assert not larger.contains(Orders(na=1, nb=1, nk=1))
