"""Origin of modes on truths with one mode of the input and one of the noise."""

import numpy as np
import pytest
from scipy.signal import lfilter, residuez

from evopem import SearchSettings, estimate
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import estimate_prediction_states
from evopem.signals.recording import Recording
from evopem.signals.spectral.frequency_response import frequency_response
from evopem.validation.mode_evidence import (
    modal_residue,
    modal_response,
    mode_evidence,
    mode_recurrence,
)

RATE = 100.0
SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=8, nu=4, evaluations=2000)


def pole(frequency, damping):
    w = 2 * np.pi * frequency / RATE
    return np.exp(w * complex(-damping, np.sqrt(1 - damping**2)))


OF_INPUT, OF_NOISE = pole(10.0, 0.02), pole(25.0, 0.02)


def factor(root):
    return np.real(np.poly([root, np.conj(root)]))


def record(seed, samples=3000, noise=0.5):
    u, e = np.random.default_rng([1, seed]).standard_normal((2, samples + 500))
    x = lfilter([0.0, 1.0, 0.5], factor(OF_INPUT), u)
    v = lfilter([1.0, 0.3], factor(OF_NOISE), e)
    y = x + noise * np.std(x) / np.std(v) * v
    return u[500:], y[500:]


def evidence(seed, order):
    u, y = record(seed)
    cut = 2000
    model = estimate(u[:cut], y[:cut], (order,) * 3 + (1,), RATE, settings=SEARCH).model
    response = frequency_response(Recording(u[:cut], y[:cut], RATE))
    states = estimate_prediction_states(model, u[:cut], y[:cut])
    return mode_evidence(model, u, y, cut, states, response)


def test_each_mode_has_its_origin_at_the_true_order():
    for seed in range(5):
        of_input, of_noise = evidence(seed, 4)
        assert of_input.origin == "input"
        assert of_input.reached is True
        assert of_input.coherence > of_input.coherence_limit
        assert of_input.residue_se < 0.1 * abs(of_input.residue)
        assert of_noise.origin == "noise"
        assert of_noise.reached is False
        assert abs(of_noise.residue) < 4 * of_noise.residue_se


def test_superfluous_modes_have_no_origin():
    origins = []
    for seed in range(4):
        for found in evidence(seed, 10):
            frequency = found.mode.frequency_hz
            if abs(frequency - 10.0) < 0.3 and found.mode.damping_ratio < 0.1:
                assert found.reached is True
            elif abs(frequency - 25.0) > 1.0:
                origins.append(found.origin)
    assert len(origins) >= 8
    # Two tests at 1 % each: three of some dozen are very unlikely.
    assert sum(origin != "neither" for origin in origins) <= 2


def example():
    a = np.convolve(factor(OF_INPUT), factor(pole(30.0, 0.1)))
    return PolynomialModel(a, np.array([1.0, -0.4, 0.2]), np.ones(1), nk=2, sampling_rate=RATE)


def test_residues_are_those_of_scipy():
    model = example()
    residues, poles, _ = residuez(model.b, model.a)
    for mode in model.modes():
        expected = residues[np.argmin(np.abs(poles - mode.pole))]
        assert modal_residue(model, mode.pole)[0] == pytest.approx(expected, rel=1e-8)


def test_modal_responses_add_up_to_the_simulation():
    model = example()
    u = np.random.default_rng(2).standard_normal(200)
    total = sum(modal_response(model, mode.pole, u) for mode in model.modes())
    np.testing.assert_allclose(total, model.simulate(u), atol=1e-10)


def test_the_error_of_a_residue_is_the_first_order_propagation():
    model = example()
    root = 1e-7 * np.random.default_rng(3).standard_normal((7, 7))
    uncertain = PolynomialModel(
        model.a,
        model.b,
        model.c,
        nk=2,
        sampling_rate=RATE,
        covariance=ParameterCovariance(root, np.zeros((7, 0))),
    )
    for mode in model.modes():
        change = []
        for column in root.T:
            sides = []
            for sign in (1, -1):
                a = model.a + sign * np.r_[0.0, column[:4]]
                moved = PolynomialModel(
                    a, model.b + sign * column[4:], model.c, nk=2, sampling_rate=RATE
                )
                near = min(moved.modes(), key=lambda m, z=mode.pole: abs(m.pole - z))
                sides.append(abs(modal_residue(moved, near.pole)[0]))
            change.append((sides[0] - sides[1]) / 2)
        error = modal_residue(uncertain, mode.pole)[1]
        assert error == pytest.approx(np.linalg.norm(change), rel=1e-4)


def test_without_covariance_or_spectrum_their_numbers_are_not_known():
    model = example()
    u = np.random.default_rng(4).standard_normal(300)
    found = mode_evidence(model, u, model.simulate(u) + 0.01 * np.roll(u, 50), 100)[0]
    assert np.isnan(found.residue_se)
    assert np.isnan(found.coherence)
    assert found.stable is None
    assert found.reached is True


def test_recurrence_is_the_share_of_models_that_have_the_mode():
    def model(frequency, damping):
        return PolynomialModel(
            factor(pole(frequency, damping)), np.ones(1), np.ones(1), nk=1, sampling_rate=RATE
        )

    others = [model(10.1, 0.02), model(10.1, 0.05), model(12.0, 0.02), model(9.95, 0.018)]
    first_order = PolynomialModel(
        np.array([1.0, 0.5]), np.ones(1), np.ones(1), nk=1, sampling_rate=RATE
    )
    mode = Mode(10.0, 0.02, OF_INPUT)
    assert mode_recurrence(mode, [*others, first_order]) == 0.5
    # An uncertain damping does not tell the second one from it.
    uncertain = Mode(10.0, 0.02, OF_INPUT, 0.01, 0.02)
    assert mode_recurrence(uncertain, others) == 0.75
    assert np.isnan(mode_recurrence(mode, [first_order]))
