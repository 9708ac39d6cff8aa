"""Prediction and simulation on systems whose answers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from two_outputs import beside_white_noise

from evopem.models.polynomial import PolynomialModel
from evopem.signals.prepared_data import PreparedData, StretchOrigin, Transforms
from evopem.signals.recording import Recording
from evopem.validation.model_class import NOT_TESTED, ModelClass
from evopem.validation.validate import validate

RATE = 100.0


def lightly_damped(count=3, sampling_rate=RATE):
    poles = []
    for frequency in np.linspace(3, 45, count):
        w = 2 * math.pi * frequency / sampling_rate
        pole = np.exp(w * complex(-0.005, math.sqrt(1 - 0.005**2)))
        poles += [pole, pole.conjugate()]
    b = np.random.default_rng(0).normal(size=4)
    c = np.real(np.poly([0.5, -0.3 + 0.4j, -0.3 - 0.4j]))
    return PolynomialModel(
        np.real(np.poly(poles)), b, c, nk=2, sampling_rate=sampling_rate, noise_variance=1.0
    )


def response(model, samples, noise, seed=0, warm_up=500):
    """A stretch out of the middle of a record: its initial conditions are not zero."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=samples + warm_up)
    e = noise * rng.normal(size=samples + warm_up)
    y = lfilter(model.delayed_b(), model.A, u) + lfilter(model.C, model.A, e)
    return u[warm_up:], y[warm_up:]


def prepared(u, y, cut, contiguous=True):
    transforms = Transforms(
        sampling_rate=RATE,
        resampled_from=None,
        estimation=(StretchOrigin(0, 0, 0.0, cut, (0.0,), (0.0,)),),
        validation=(StretchOrigin(0, cut, cut / RATE, len(u) - cut, (0.0,), (0.0,)),),
        validation_source="cut" if contiguous else "file",
    )
    return PreparedData(
        Recording(u[:cut], y[:cut], RATE), Recording(u[cut:], y[cut:], RATE), transforms
    )


def test_static_gain_by_hand():
    model = PolynomialModel(
        np.ones(1), np.array([2.0]), np.ones(1), nk=0, sampling_rate=RATE, noise_variance=1.0
    )
    u = np.array([1.0, -1.0] * 20)
    y = 2 * u + np.tile([0.0, 0.0, 1.0, 0.0], 10)
    result, _ = validate(model, prepared(u, y, 36))
    # The validation samples are 2, −2, 3, −2; all responses are 2, −2, 2, −2.
    assert result.fitted_state_error_percent == pytest.approx(100 / math.sqrt(20.75))
    assert result.samples == 4
    assert result.prediction_error_percent == pytest.approx(100 / math.sqrt(20.75))
    assert result.simulation_error_percent == pytest.approx(100 / math.sqrt(20.75))


@pytest.mark.parametrize("contiguous", [True, False])
@pytest.mark.parametrize("modes", [1, 10])
def test_without_noise_the_simulation_is_exact_from_unknown_initial_conditions(contiguous, modes):
    model = lightly_damped(modes)
    u, y = response(model, 1500, noise=0.0)
    result, _ = validate(model, prepared(u, y, 1000, contiguous))
    assert result.simulation_error_percent < 1e-8
    assert result.fitted_state_error_percent < 1e-8


@pytest.mark.parametrize("contiguous", [True, False])
@pytest.mark.parametrize("fit_level", [True, False])
def test_the_simulation_sees_no_output_that_is_scored(contiguous, fit_level):
    """Another output changes it by no more than a level, where one is fitted."""
    model = lightly_damped()
    u, y = response(model, 1500, noise=0.1)
    before, _ = simulated(model, u, y, contiguous, fit_level)
    first = 1000 if contiguous else 1050
    spoilt = y.copy()
    spoilt[first:] += 1.0 + np.random.default_rng(1).normal(size=1500 - first)
    after, error = simulated(model, u, spoilt, contiguous, fit_level)
    change = after - before
    assert np.ptp(change) < 1e-9
    assert bool(abs(change[0]) > 0.5) is fit_level
    scored = spoilt[first:]
    assert error == pytest.approx(
        100 * np.linalg.norm(scored - after) / np.linalg.norm(scored - scored.mean())
    )


def simulated(model, u, y, contiguous, fit_level):
    """The scored samples of the simulation, and its error."""
    result, tables = validate(model, prepared(u, y, 1000, contiguous), fit_level=fit_level)
    return tables.simulation[
        "simulated_output"
    ].dropna().to_numpy(), result.simulation_error_percent


def test_a_fitted_state_that_imitates_a_drift_is_told():
    """Poles near the unit circle that zeros nearly cancel; the output drifts after the cut."""
    slow = np.poly([0.999, 0.998])
    zeros = np.poly([0.99901, 0.99799])
    plant = np.array([1.0, -1.5, 0.7])
    model = PolynomialModel(
        *(np.ones(1), zeros, np.ones(1), np.ones(1), np.convolve(plant, slow)),
        nk=1,
        noise_variance=0.01,
    )
    generator = np.random.default_rng(1)
    u = generator.normal(size=1500)
    y = lfilter([0.0, 1.0], plant, u) + 0.1 * generator.normal(size=1500)
    y[1000:] += 5.0 * np.sin(np.linspace(0.0, np.pi, 500))
    result, _ = validate(model, prepared(u, y, 1000))
    assert result.simulation_error_percent > 1.5 * result.fitted_state_error_percent + 2.0
    share = result.fitted_state_error_percent / result.simulation_error_percent
    assert share < result.share_of_noise


def test_fitted_states_gain_as_much_where_noise_passes_through_slow_poles():
    model, cut, gained = lightly_damped(1), 320, []
    for seed in range(5):
        u, y = response(model, cut + 40, noise=0.3, seed=seed)
        result, _ = validate(model, prepared(u, y, cut))
        gained.append(result.fitted_state_error_percent / result.simulation_error_percent)
        assert result.share_of_noise < gained[-1]
        white, _ = validate(replace(model, C=model.A), prepared(u, y, cut))
        assert white.share_of_noise > 0.8
    assert min(gained) < 0.4


def test_what_fitted_states_gain_of_noise_does_not_depend_on_units():
    """The noise of the first output passes through a slow mode, that of the second is white."""
    one, (u, y) = lightly_damped(1).state_space(), response(lightly_damped(1), 360, noise=0.3)
    both = beside_white_noise(one)
    outputs = np.column_stack([y, y + np.random.default_rng(1).normal(size=360)])
    shares = []
    for unit in (1.0, 1e4):
        scales = np.array([1.0, unit])
        scaled = replace(
            both,
            C=scales[:, None] * both.C,
            D=scales[:, None] * both.D,
            K=both.K / scales,
            noise_covariance=np.diag(scales**2),
        )
        result, _ = validate(scaled, prepared(u, scales * outputs, 320))
        shares.append(result.share_of_noise)
    assert shares[1] == pytest.approx(shares[0], rel=1e-6)


def test_the_class_is_not_tested_again_where_it_is_known():
    model, known = lightly_damped(1), ModelClass(NOT_TESTED, NOT_TESTED, NOT_TESTED)
    result, _ = validate(model, prepared(*response(model, 400, noise=0.3), 300), tests=known)
    assert result.model_class is known


@pytest.mark.parametrize("contiguous", [True, False])
def test_predictions_of_an_output_error_model_start_from_the_state_of_the_record(contiguous):
    """A slow mode that moves before the first sample: a predictor at rest would be 100 % wrong."""
    plant = np.real(np.poly([0.999 * np.exp(0.01j), 0.999 * np.exp(-0.01j)]))
    one = np.ones(1)
    model = PolynomialModel(one, one, F=plant, nk=1, noise_variance=1.0)
    u, e = np.random.default_rng(2).normal(size=(2, 3000))
    y = lfilter([0.0, 1.0], plant, 0.01 * u)
    y = y + 30.0 * np.cos(0.01 * np.arange(3000)) * 0.999 ** np.arange(3000) + 0.01 * e
    result, _ = validate(model, prepared(0.01 * u, y, 1000, contiguous))
    spread = np.std(y[1200:])
    assert result.prediction_error_percent < 2.0 * 100.0 * 0.01 / spread + 0.5


def test_the_prediction_of_a_sample_knows_the_output_before_it_only():
    model = lightly_damped()
    u, y = response(model, 3000, noise=0.1)
    before = validate(model, prepared(u, y, 2000))[1].simulation["predicted_output"]
    spoilt = y.copy()
    spoilt[2500:] += 1.0
    after = validate(model, prepared(u, spoilt, 2000))[1].simulation["predicted_output"]
    assert np.array_equal(before[:501], after[:501])
    assert not np.isclose(before[501], after[501])


def test_prediction_continues_the_recursion_over_the_cut():
    """Brute force: C e = A y − B u over the whole record, from any state, which has decayed."""
    model = lightly_damped()
    u, y = response(model, 1300, noise=0.1)
    e = np.zeros(1300)
    b = model.delayed_b()
    for t in range(model.orders.first_residual, 1300):
        e[t] = sum(model.A[i] * y[t - i] for i in range(model.A.size))
        e[t] -= sum(b[i] * u[t - i] for i in range(b.size))
        e[t] -= sum(model.C[i] * e[t - i] for i in range(1, model.C.size))
    result, tables = validate(model, prepared(u, y, 1200))
    np.testing.assert_allclose(tables.simulation["prediction_error_output"], e[1200:], atol=1e-9)
    assert result.prediction_error_percent == pytest.approx(
        100 * np.linalg.norm(e[1200:]) / np.linalg.norm(y[1200:] - y[1200:].mean())
    )


def test_inputs_before_a_record_leave_no_outliers_behind_a_long_delay():
    """The zeros of the noise decay within the delay, so that no initial state makes up for them."""
    model = PolynomialModel(
        np.array([1.0, -1.5, 0.9]), np.ones(1), np.poly([0.6, -0.5]), nk=50, noise_variance=1e-6
    )
    u, e = np.random.default_rng(5).standard_normal((2, 1000))
    y = lfilter(np.ones(1), model.A, np.concatenate([np.zeros(50), u[:-50]]))
    y += 1e-3 * lfilter(model.C, model.A, e)
    result, _ = validate(model, prepared(u[200:], y[200:], 600))
    assert result.outputs[0].outlier_percent < 0.5
    short, _ = validate(model, prepared(u[200:800], y[200:800], 530, contiguous=False))
    assert 0 < short.samples < 20


def test_an_independent_recording_has_unscored_samples():
    model = lightly_damped()
    u, y = response(model, 3000, noise=0.1)
    result, tables = validate(model, prepared(u, y, 2000, contiguous=False))
    first = 100
    assert first > model.orders.first_residual + model.orders.nc
    assert result.unscored_samples == first
    assert result.samples == 1000 - first
    assert tables.simulation["simulated_output"].isna().sum() == first
    assert tables.simulation["predicted_output"].isna().sum() == first
    form, u, y = model.state_space(), u[2000:, None], y[2000:, None]
    restarted = form.predict(u, y, 1, form.prediction_state(u, y))[first:, 0]
    np.testing.assert_array_equal(tables.simulation["predicted_output"][first:], restarted)


def test_the_true_model_predicts_to_the_noise_and_leaves_it_white():
    model = lightly_damped()
    u, y = response(model, 6000, noise=0.5)
    result, _ = validate(model, prepared(u, y, 5000))
    expected = 100 * 0.5 / np.std(y[5000:])
    assert result.prediction_error_percent == pytest.approx(expected, rel=0.1)
    assert result.simulation_error_percent > 2 * result.prediction_error_percent
    assert result.lags == 1200
    assert result.outputs[0].ljung_box.p_value > 0.01
    assert result.outputs[0].autocorrelation_share_inside95 > 0.93
    assert result.pairs[0].p_value > 0.01


def test_a_model_without_its_noise_polynomial_leaves_coloured_residuals():
    model = lightly_damped()
    u, y = response(model, 6000, noise=0.5)
    result, _ = validate(replace(model, C=np.ones(1)), prepared(u, y, 5000))
    assert result.outputs[0].ljung_box.p_value < 1e-6


def test_the_input_of_the_true_model_is_significant_and_reaches_every_mode():
    model = lightly_damped()
    u, y = response(model, 3000, noise=0.1)
    for contiguous in (True, False):
        result, _ = validate(model, prepared(u, y, 2000, contiguous))
        assert result.input_test.significant(0.01)
        assert [each.origin for each in result.modes.modes] == ["input"] * 3
        assert result.inputs[0].split.comparable


def test_each_of_two_inputs_is_tested_beside_the_other():
    """The second one is unrelated, then follows the first."""
    model = lightly_damped()
    u, y = response(model, 1200, noise=0.1)
    both = replace(model, B=(model.B[0], np.array([0.01])), nk=(2, 1))
    other = np.random.default_rng(2).standard_normal(len(u))
    for second, hidden in ((other, False), (np.roll(u, 1) + 1e-3 * other, True)):
        result, _ = validate(both, prepared(np.column_stack([u, second]), y, 1000))
        assert [each.test.significant(0.01) for each in result.inputs] == [True, False]
        assert [bool(each.hidden_hz) for each in result.inputs] == [hidden] * 2


def test_inputs_stay_as_they_are():
    model = lightly_damped()
    u, y = response(model, 600, noise=0.1)
    kept = u.copy(), y.copy()
    validate(model, prepared(u, y, 500))
    validate(model, prepared(u, y, 500, contiguous=False))
    np.testing.assert_array_equal(u, kept[0])
    np.testing.assert_array_equal(y, kept[1])


def test_too_few_samples_are_refused():
    model = lightly_damped()
    u, y = response(model, 60, noise=0.1)
    with pytest.raises(ValueError, match="no stretch has"):
        validate(model, prepared(u, y, 8))
