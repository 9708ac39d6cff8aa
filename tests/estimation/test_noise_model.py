"""Plant and noise model side by side: the same simulations, and predictions of the filters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.settings import SearchSettings
from evopem.estimation.state_space.estimate import (
    estimate_state_space,
    estimates_of_orders,
    noise_models,
)
from evopem.estimation.state_space.local_estimates import StateSpaceTask, best_descent, descend_from
from evopem.models.conversions import plant_of, side_by_side
from evopem.signals.recording import Recording

N = 700
SETTINGS = SearchSettings(objective="quadratic", evaluations=0)


@pytest.fixture(scope="module")
def record():
    """One input, two outputs through a resonance, and noise through a pole of its own."""
    generator = np.random.default_rng(4)
    u = generator.standard_normal((N, 1))
    x = np.zeros(2)
    coloured = np.zeros((N, 2))
    y = np.zeros((N, 2))
    A = 0.97 * np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
    for k in range(N):
        y[k] = [[1.0, 0.2], [-0.4, 1.0]] @ x
        x = A @ x + np.array([0.0, 1.0]) * u[k]
        e = 0.3 * generator.standard_normal(2)
        coloured[k] = 0.85 * coloured[k - 1] + e if k else e
    return u, y + coloured


@pytest.fixture(scope="module")
def plant(record):
    recording = Recording(*record, 10.0)
    return estimate_state_space(recording, 2, structure="ss_oe", settings=SETTINGS).model


@pytest.fixture(scope="module")
def both(plant, record):
    noise, *_ = noise_models(plant, Recording(*record, 10.0), SETTINGS)
    return side_by_side(plant, noise)


def test_simulations_stay_those_of_the_plant(plant, both, record):
    u, _ = record
    np.testing.assert_allclose(both.simulate(u), plant.simulate(u), rtol=1e-10)
    f = np.linspace(0.1, 4.9, 7)
    np.testing.assert_allclose(both.frequency_response(f), plant.frequency_response(f), rtol=1e-10)
    assert both.order == 4


def test_predictions_use_the_colour_of_the_noise(plant, both, record):
    u, y = record
    white = both.residuals(u, y, both.prediction_state(u, y))[20:]
    assert np.all(white.std(axis=0) < 0.7 * (y - plant.simulate(u))[20:].std(axis=0))
    lagged = np.sum(white[1:] * white[:-1], axis=0) / np.sum(white**2, axis=0)
    assert np.all(np.abs(lagged) < 3.0 / np.sqrt(N))
    assert np.sort(np.linalg.eigvalsh(both.noise_covariance))[0] > 0.0


def test_the_plant_comes_back_with_its_standard_errors(plant, both):
    again = plant_of(both, plant.order)
    (mode,), (own,) = again.modes(), plant.modes()
    assert mode.frequency_hz == pytest.approx(own.frequency_hz, rel=1e-12)
    assert mode.frequency_se_hz == pytest.approx(own.frequency_se_hz, rel=1e-9)
    np.testing.assert_allclose(mode.shape_se_real, own.shape_se_real, rtol=1e-9)


def test_a_descent_begins_at_the_model(both, record):
    u, y = record
    found = descend_from(both, Recording(u, y, 10.0), StateSpaceTask())
    at = np.linalg.slogdet(np.cov(both.residuals(u, y, both.prediction_state(u, y)).T))[1]
    after = np.linalg.slogdet(np.cov(found.residuals[0].T))[1]
    assert after <= at + 1e-6
    assert found.model.modes()[0].frequency_hz == pytest.approx(0.7 / 2 / np.pi * 10, rel=0.02)


def test_no_noise_model_where_residuals_are_white(record):
    u, _ = record
    generator = np.random.default_rng(9)
    truth = next(estimates_of_orders(Recording(*record, 1.0), (2,), structure="ss_oe")).model
    y = truth.simulate(u) + generator.standard_normal((N, 2))
    assert noise_models(truth, Recording(u, y, 1.0), SETTINGS)[0] is None


def test_far_smaller_noise_models_than_the_likeliest_are_not_fitted(plant, record):
    """Of noise with three resonances none of one or two states is."""
    white = np.random.default_rng(2).standard_normal((2, N))
    poles = 0.95 * np.exp(1j * np.array([0.3, 1.2, 2.3]))
    noise = 0.3 * lfilter([1.0], np.poly([*poles, *poles.conj()]).real, white)
    recording = Recording(record[0], plant.simulate(record[0]) + noise.T, 10.0)
    first, *others = noise_models(plant, recording, SETTINGS, covariances=False)
    assert first.order >= 6
    assert all(model is None or model.order >= first.order - 3 for model in others)


@pytest.mark.parametrize("searched", [False, True])
def test_a_plant_beside_its_noise_model_is_a_structure(record, searched):
    """Its orders are those of the plant, and its errors are smaller than those of the plant."""
    recording = Recording(*record, 10.0)
    if searched:
        found = estimate_state_space(recording, 2, structure="ss_bj", settings=SETTINGS)
    else:
        (found,) = estimates_of_orders(recording, (2,), structure="ss_bj", settings=SETTINGS)
    plain = estimate_state_space(recording, 2, settings=SETTINGS)
    assert found.order == 2
    assert found.model.order > 2
    assert found.model.structure == "ss"
    assert found.bic < plain.bic


@pytest.mark.parametrize(("shares", "order"), [((1.0, 0.8), 11), ((1.0,), 4)])
def test_a_noise_model_with_zeros_at_the_bound_is_begun_with_less_gain(monkeypatch, shares, order):
    """With all of it no descent ends stable, but that of the plant alone."""
    monkeypatch.setattr("evopem.estimation.state_space.estimate.GAIN_SHARES", shares)
    generator = np.random.default_rng(3)
    f = np.poly([0.9 * np.exp(0.6j), 0.9 * np.exp(-0.6j), 0.5]).real
    gains, u, y = generator.standard_normal(2), [], []
    for number in range(2):
        u.append(generator.standard_normal(300))
        x = lfilter([0.0, *gains], f, u[-1])
        noise = lfilter([1.0], [1.0, -0.8], generator.standard_normal(300))
        y.append(x + 0.2 * x.std() * noise + 0.5 * number)
    recording = Recording(
        *(np.concatenate(parts)[:, None] for parts in (u, y)),
        10.0,
        segment_starts=(0, 300),
        segment_recordings=(0, 1),
    )
    found = estimate_state_space(recording, 4, structure="ss_bj", settings=SETTINGS)
    assert np.abs(found.model.poles()).max() < 1.0
    assert found.model.order == order
    # The share of the innovations in the outputs, of which the fit takes some away.
    assert order == 4 or 2.5 < found.objective < 100.0 * 0.04 / (1.0 + 0.04 / (1.0 - 0.8**2))


@pytest.mark.parametrize("first", [0, 1])
def test_the_best_of_several_starts_goes_on(both, record, first):
    recording = Recording(*record, 10.0)
    task = StateSpaceTask.of(recording, "ss_bj", 1)
    near = replace(both, structure="ss", covariance=None)
    far = replace(near, A=np.diag([0.9999, 0.9998, 0.9, -0.9]), K=0.0 * both.K)
    starts = [far, near] if first else [near, far]
    alone = [descend_from(start, recording, task).bic for start in (near, far)]
    found = best_descent(starts, recording, task, 100)
    assert alone[1] > alone[0] + 0.1
    assert found.bic < alone[0] + 1e-6
