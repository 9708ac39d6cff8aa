"""The model class against brute force, scipy and python-control."""

import numpy as np
import pytest

from evopem.models.orders import armax_orders
from evopem.models.polynomial import PolynomialModel
from evopem.synthesis import true_model


@pytest.fixture
def model():
    return PolynomialModel(
        A=np.array([1.0, -1.2, 0.8]),
        B=np.array([0.5, -0.3, 0.1]),
        C=np.array([1.0, 0.4]),
        nk=2,
        sampling_rate=50.0,
        noise_variance=1.0,
    )


def brute_force_residuals(model, u, y):
    """The difference equation, term by term."""
    o = model.orders
    e = np.zeros(len(y))
    for t in range(o.first_residual, len(y)):
        e[t] = sum(model.A[i] * y[t - i] for i in range(o.na + 1))
        e[t] -= sum(model.B[0][j] * u[t - o.single.nk - j] for j in range(o.single.nb))
        e[t] -= sum(model.C[k] * e[t - k] for k in range(1, o.nc + 1))
    return e


def test_residuals_follow_the_difference_equation(model):
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((2, 60))
    t0 = model.orders.first_residual
    residuals = model.residuals(u, y)
    assert t0 == 4
    assert np.isnan(residuals[:t0]).all()
    np.testing.assert_allclose(
        residuals[t0:], brute_force_residuals(model, u, y)[t0:], rtol=1e-12, atol=1e-12
    )


def test_prediction_and_residual_add_up_to_the_output(model):
    rng = np.random.default_rng(2)
    u, y = rng.standard_normal((2, 60))
    known = slice(model.orders.first_residual, None)
    total = model.predict(u, y) + model.residuals(u, y)
    np.testing.assert_allclose(total[known], y[known], rtol=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("b", "nk"),
    [([0.5, -0.3, 0.1], 0), ([0.5], 1), ([0.5, -0.3], 5), ([0.0, 0.5], 2)],
)
def test_transfer_functions_of_other_libraries_keep_the_dynamics_and_the_delay(b, nk):
    import control

    model = PolynomialModel(
        A=np.array([1.0, -1.2, 0.8]),
        B=np.array(b),
        C=np.ones(1),
        nk=nk,
        sampling_rate=50.0,
    )
    frequencies = np.array([0.0, 3.0, 11.0, 25.0])
    z = np.exp(2j * np.pi * frequencies / 50.0)
    expected = model.frequency_response(frequencies)[:, 0, 0]
    by_scipy = model.to_scipy()
    assert by_scipy.dt == 1 / 50.0
    ours = np.polyval(by_scipy.num, z) / np.polyval(by_scipy.den, z)
    np.testing.assert_allclose(ours, expected, rtol=1e-12)
    by_control = model.to_control()
    assert by_control.dt == 1 / 50.0
    assert isinstance(by_control, control.TransferFunction)
    np.testing.assert_allclose(by_control(z), expected, rtol=1e-12)
    # The same model as a polynomial model with A in the place of F.
    unit = np.ones(1)
    general = PolynomialModel(unit, model.B[0], unit, unit, model.A, nk, sampling_rate=50.0)
    theirs = general.to_scipy()
    np.testing.assert_allclose(
        np.polyval(theirs.num, z) / np.polyval(theirs.den, z), expected, rtol=1e-12
    )


def test_innovations_come_back_as_residuals():
    from scipy.signal import lfilter

    model = true_model()
    rng = np.random.default_rng(3)
    u, e = rng.standard_normal((2, 4000))
    y = model.simulate(u) + lfilter(model.C, model.A, e)
    # The unknown past innovations are forgotten as the largest root of C, 0.90, decays.
    np.testing.assert_allclose(model.residuals(u, y)[500:], e[500:], atol=1e-8)


def test_an_estimated_noise_state_leaves_no_transient():
    """A stretch cut from a record: its residuals are the innovations from the first one on."""
    from scipy.signal import lfilter

    slow = PolynomialModel(
        A=np.array([1.0, -0.9]), B=np.array([1.0]), C=np.poly([0.995, 0.99]), nk=1
    )
    rng = np.random.default_rng(8)
    u, e = rng.standard_normal((2, 3000))
    y = slow.simulate(u) + lfilter(slow.C, slow.A, e)
    u, y, e = u[1000:], y[1000:], e[1000:]
    plain = slow.residuals(u, y)
    form = slow.state_space()
    state = form.prediction_state(u[:, None], y[:, None])
    settled = form.residuals(u[:, None], y[:, None], state)[:, 0]
    assert np.std(plain[100:] - e[100:]) > 0.5
    # Two states are estimated from 2000 samples of unit variance.
    assert np.sqrt(np.sum((settled[2:] - e[2:]) ** 2)) < 5.0


def test_simulation_and_response_agree_with_control(model):
    control = pytest.importorskip("control")
    u = np.random.default_rng(4).standard_normal(80)
    theirs = control.forced_response(model.to_control(), inputs=u).outputs
    np.testing.assert_allclose(model.simulate(u), theirs, atol=1e-10)
    frequencies = np.array([0.0, 3.0, 11.0, 24.0])
    evaluated = model.to_control()(np.exp(2j * np.pi * frequencies / 50.0))
    np.testing.assert_allclose(
        model.frequency_response(frequencies)[:, 0, 0], evaluated, rtol=1e-10
    )


def test_scipy_system_has_the_same_impulse_response(model):
    from scipy.signal import dlsim

    impulse = np.zeros(30)
    impulse[0] = 1.0
    theirs = dlsim(model.to_scipy(), impulse)[1]
    np.testing.assert_allclose(model.simulate(impulse), theirs[:, 0], atol=1e-12)


def test_a_simulation_goes_on_from_an_estimated_state():
    """A stretch cut from the middle of a noise-free record is reproduced from its first sample."""
    model = true_model()
    u = np.random.default_rng(5).standard_normal(1200)
    y = model.simulate(u)
    form = model.plant().state_space()
    found = form.simulate_from_fitted_state(u[700:, None], y[700:, None])
    np.testing.assert_allclose(found[:, 0], y[700:], atol=1e-6)


def test_arguments_stay_as_they_were(model):
    u, y = np.random.default_rng(6).standard_normal((2, 50))
    before = u.copy(), y.copy()
    model.residuals(u, y)
    model.simulate(u)
    model.state_space().simulate_from_fitted_state(u[:, None], y[:, None])
    np.testing.assert_array_equal(u, before[0])
    np.testing.assert_array_equal(y, before[1])


def test_zeros_do_not_count_the_delay():
    model = true_model()
    assert sorted(np.round(model.zeros().real, 6)) == [-0.2, -0.2, 0.7, 0.7, 0.99]
    assert model.orders == armax_orders(7, 6, 7, 3)
