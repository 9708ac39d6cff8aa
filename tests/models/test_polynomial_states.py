"""Initial states of polynomial models: against truths, and where poles cluster."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.models.polynomial import PolynomialModel
from evopem.models.states import levels_moved

ONE = np.ones(1)
MODEL = PolynomialModel(ONE, np.array([1.0, 0.5]), ONE, ONE, np.array([1.0, -1.5, 0.7]), nk=1)


def simulate_from_first(model, u, y, known, fit_level=False, robust=False):
    form = model.plant().state_space()
    (found,) = form.simulations(u[:, None], y[:, None], (fit_level,), robust, known)
    return found[:, 0]


def signals(model, samples, noise, seed=1):
    """Input, output without and with noise, of the last samples of a longer record."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal(samples + 200)
    x = lfilter(model.delayed_b(), model.plant_denominator, u)
    y = x + noise * x.std() * generator.standard_normal(len(x))
    return u[200:], x[200:], y[200:]


@pytest.mark.parametrize("fit_level", [False, True])
@pytest.mark.parametrize("robust", [False, True])
def test_without_noise_the_first_samples_give_the_state(fit_level, robust):
    u, x, _ = signals(MODEL, 400, 0.0)
    found = simulate_from_first(MODEL, u, x + 3.0 * fit_level, 30, fit_level, robust)
    np.testing.assert_allclose(found, x + 3.0 * fit_level, atol=1e-9)


def test_no_output_behind_the_first_ones_counts():
    u, _, y = signals(MODEL, 400, 0.3)
    changed = np.where(np.arange(400) < 40, y, 1e3)
    np.testing.assert_array_equal(
        simulate_from_first(MODEL, u, y, 40), simulate_from_first(MODEL, u, changed, 40)
    )


def test_a_few_noisy_samples_give_a_better_state_than_least_squares_and_than_rest():
    """Two slow poles that zeros nearly cancel: the first samples hardly determine their states."""
    slow, zeros = np.poly([0.999, 0.998]), np.poly([0.9991, 0.9979])
    model = PolynomialModel(ONE, zeros, ONE, ONE, np.convolve([1.0, -1.5, 0.7], slow), nk=1)
    errors = []
    for seed in range(20):
        u, x, y = signals(model, 600, 0.3, seed)
        form = model.state_space()
        driven = y[:40, None] - form.simulate(u[:40, None])
        free = form.free_responses(form.A, 600)
        least_squares = free @ np.linalg.lstsq(free[:40, 0], driven[:, 0])[0]
        ways = (
            simulate_from_first(model, u, y, 40),
            model.simulate(u) + least_squares[:, 0],
            model.simulate(u),
        )
        errors.append([np.std(each - x) / np.std(x) for each in ways])
    probable, least_squares, rest = np.mean(errors, axis=0)
    assert probable < 0.5 * least_squares
    assert probable < rest


def test_a_fitted_level_beside_an_integrator_draws_no_ramp():
    """Of the first samples the noise alone would tell that the level has moved, not the state."""
    model, errors = replace(MODEL, A=ONE, F=np.poly([0.8, 0.999]).real), []
    for seed in range(20):
        u, x, y = signals(model, 1000, 0.5, seed)
        found = simulate_from_first(model, u, y, 100, fit_level=True)
        errors.append(np.std(found - x) / np.std(x))
    assert np.mean(errors) < 0.02


def test_states_of_clustered_poles_are_no_worse_than_rest():
    """The least-squares states reach 4e9, and rounding makes their errors larger than at rest."""
    angles = np.array([0.01, 0.011, 0.012, 0.013, 0.014])
    poles = 0.995 * np.exp(1j * np.concatenate([angles, -angles]))
    generator = np.random.default_rng(0)
    model = PolynomialModel(
        ONE,
        1e-3 * generator.standard_normal(5),
        np.array([1.0, 0.5]),
        np.array([1.0, -0.3]),
        np.real(np.poly(poles)),
        nk=1,
    )
    u, _, y = signals(model, 3500, 0.1)
    form, u, y = model.state_space(), u[:, None], y[:, None]
    state = form.prediction_state(u, y)
    assert np.sum(form.residuals(u, y, state) ** 2) <= np.sum(form.residuals(u, y) ** 2)
    assert np.abs(state[: model.plant_states]).max() < 1e6


def test_a_state_that_is_hardly_seen_is_fitted_where_the_outputs_need_it():
    """Seen 5e11 times less than others, it makes outputs that no other states make."""
    poles = 0.97 * np.exp(1j * (0.1 + 0.05 * np.arange(6)))
    denominator = np.poly([*poles, *poles.conj()]).real
    form = PolynomialModel(ONE, ONE, ONE, ONE, denominator, nk=1).plant().state_space()
    seen = form.free_responses(form.A, 300)
    left, sizes, _ = np.linalg.svd(seen[:, 0] / np.linalg.norm(seen[:, 0], axis=0))
    assert 1e-13 < sizes[-1] / sizes[0] < 1e-11
    rest, y = np.zeros((300, 1)), left[:, [len(sizes) - 1]]
    state = form.prediction_state(rest, y)
    assert np.linalg.norm(form.residuals(rest, y, state)) < 0.01 * np.linalg.norm(y)


def test_close_poles_are_simulated_over_long_records():
    """Powers of a companion matrix of eight poles rise to 1e7; their squares leave the floats."""
    radii, angles = [0.975, 0.997, 0.978, 0.993], [0.61, 0.19, 0.20, 0.02]
    poles = np.array(radii) * np.exp(1j * np.array(angles))
    a = np.poly([*poles, *poles.conj()]).real
    model = PolynomialModel(a, 1e-4 * np.array([1.0, -0.9]), ONE, nk=1)
    u = np.random.default_rng(1).standard_normal(40_000)
    y = model.simulate(u)
    simulated = simulate_from_first(model, u, y, 4_000)
    np.testing.assert_allclose(simulated, y, atol=0.01 * y.std())


def test_states_are_found_where_singular_values_are_not(monkeypatch):
    u, x, _ = signals(MODEL, 400, 0.0)
    form, given = MODEL.state_space(), (u[:, None], x[:, None])
    expected = form.simulate_from_fitted_state(*given)
    failing = Mock(side_effect=np.linalg.LinAlgError("SVD did not converge"))
    monkeypatch.setattr(np.linalg, "lstsq", failing)
    np.testing.assert_allclose(form.simulate_from_fitted_state(*given), expected, atol=1e-9)
    assert failing.called


def test_a_state_that_overflows_fails_as_other_decompositions_do():
    """A structure with such a model has no candidates; a ValueError would end the whole search."""
    form = MODEL.state_space()
    growing = replace(form, A=9.0 * np.eye(form.order))
    u, x, _ = signals(MODEL, 400, 0.0)
    with pytest.raises(np.linalg.LinAlgError), np.errstate(all="ignore"):
        growing.prediction_state(u[:, None], x[:, None])


def test_a_simulation_whose_states_overflow_is_infinite():
    form = MODEL.plant().state_space()
    grown = replace(form, B=1e200 * form.B, C=1e-200 * form.C)
    u, x, _ = signals(MODEL, 400, 0.0)
    found = grown.simulate_from_fitted_state(u[:, None], x[:, None], known=40)
    assert not np.isfinite(found).any()


def test_slow_poles_of_a_companion_matrix_are_those_of_its_coefficients():
    """A product that leads over many samples rounds them to poles outside the circle."""
    poles = [0.9936 * np.exp(0.0212j), 0.9999 * np.exp(0.0371j), 0.98 * np.exp(0.0104j)]
    f = np.poly([*poles, *np.conj(poles), 0.979, 0.981]).real
    model = PolynomialModel(ONE, np.array([1.0, -0.9]), F=f, nk=1)
    u = np.random.default_rng(1).standard_normal(8000)
    expected, form = model.simulate(u), model.state_space()
    difference = form.simulate(u[:, None])[:, 0] - expected
    assert np.std(difference) < 0.02 * np.std(expected)
    expected = lfilter([1.0], f, np.r_[1.0, np.zeros(7999)])
    difference = form.free_responses(form.A, 8000)[:, 0, 0] - expected
    assert np.std(difference) < 0.02 * np.std(expected)


def test_coloured_errors_seldom_refute_a_level_that_holds():
    """As independent ones they refuted 117 of 200."""
    refuted = found = 0
    for seed in range(200):
        noise = np.random.default_rng(seed).standard_normal((500, 1))
        slow = lfilter([1.0], [1.0, -0.95], noise, axis=0)[200:]
        refuted += levels_moved(slow, slow - slow.mean(axis=0), np.ones(1), False)
        moved = noise[200:] + 1.0
        found += levels_moved(moved, moved - moved.mean(axis=0), np.ones(1), False)
    assert refuted <= 20
    assert found == 200
