"""Stretches, folds, and one model fitted to several stretches."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from records import error_percent, output_error_record
from scipy.optimize import approx_fprime
from scipy.signal import lfilter

from evopem.automatic.cross_validation.folds import _errors_on, decide_folds, held_out_scores
from evopem.automatic.cross_validation.simulation import (
    errors_simulated_on,
    errors_with_levels,
    simulated,
)
from evopem.automatic.cross_validation.stretches import folds_of
from evopem.automatic.fit import fit, likeliest_arx
from evopem.config.structures import ORDER_NAMES
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.models.orders import Orders
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Segment, total_samples


def test_folds_hold_out_each_sample_once():
    samples = np.arange(100.0)
    stretches = (Segment(samples[:60], samples[:60]), Segment(samples[60:], samples[60:], 1))
    folds = folds_of(stretches, 2, 3, shortest=5)
    held = np.sort(np.concatenate([s.output for fold in folds for s in fold.held_out]))
    assert np.array_equal(held, samples)
    for fold in folds:
        trained = np.concatenate([s.output for s in fold.training])
        assert not set(trained) & {v for s in fold.held_out for v in s.output}
        assert all(s.samples >= 5 for s in fold.training)
        assert total_samples(fold.training) + total_samples(fold.held_out) >= 90


def test_a_tenth_before_held_out_samples_tells_their_state_unless_an_input_rests_there():
    u = np.random.default_rng(7).standard_normal((1000, 2))
    pasts = []
    for rests in (False, True):
        u[400:500, 1] *= not rests
        pasts += [
            fold.before[0].samples for fold in folds_of((Segment(u, u[:, 0]),), 2, 1, 25, None, 25)
        ]
    assert pasts == [0, 100, 0, 500]


def test_a_rest_of_a_stretch_is_no_part_that_is_held_out():
    """The few samples before it, fewer than the delay, tell no state: simulations of it explode."""
    u, y, _ = output_error_record(1612)
    stretches = [Segment(u[:272], y[:272]), Segment(u[312:], y[312:])]
    plan = replace(decide_folds(stretches, delay=20), designs=((2, 3),))
    held_out = []

    def estimate(trainings):
        return [fit(training, Orders(nb=2, nf=2, nk=1)).model for training in trainings]

    def errors_on(model, before, stretch, absolute):
        held_out.append((before.samples, stretch.samples))
        return _errors_on(model, before, stretch, absolute)

    with patch("evopem.automatic.cross_validation.folds._errors_on", errors_on):
        held_out_scores(stretches, replace(plan, shortest=0), estimate, False)
        assert np.min(held_out) == 10
        held_out.clear()
        held_out_scores(stretches, plan, estimate, False)
        assert np.min(held_out) >= plan.shortest == 45
        # Of a part with too few samples before it the first ones stand in for them.
        stretches = [Segment(u[:770], y[:770]), Segment(u[780:], y[780:])]
        held_out.clear()
        held_out_scores(stretches, replace(plan, designs=((2, 1),)), estimate, False)
    assert held_out == [(45, 832 - 45)]
    # A longer past would tell the state better than the first tenth of a validation record does.
    held_out.clear()
    with patch("evopem.automatic.cross_validation.folds._errors_on", errors_on):
        held_out_scores([Segment(u, y)], replace(plan, designs=((2, 1),)), estimate, False)
    assert held_out == [(len(y) // 10, len(y) - len(y) // 2)]


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_the_gradient_over_stretches_is_that_of_the_values(objective):
    u, y, _ = output_error_record(300)
    stretches = [Segment(u[:120], y[:120]), Segment(u[150:], y[150:] + 3.0, 1)]
    orders = Orders(nb=2, nc=1, nd=1, nf=2, nk=1)
    errors = PolynomialErrors(stretches, orders, objective, 0.99, 0.99, True)
    assert errors.parameters == orders.parameters + 2
    point = np.random.default_rng(1).normal(0.0, 0.1, errors.dimension)
    smoothing, none = np.full(1, 0.5), np.zeros(1)

    def value(x):
        return errors.values_and_gradients(x[None, :], smoothing, none)[0][0]

    gradient = errors.values_and_gradients(point[None, :], smoothing, none)[1][0]
    assert gradient == pytest.approx(approx_fprime(point, value, 1e-7), rel=1e-3, abs=1e-4)


def test_recordings_with_their_own_levels_give_one_model():
    u, y, truth = output_error_record(600, percent=5.0)
    stretches = [Segment(u[:250], y[:250] + 7.0, 0), Segment(u[300:], y[300:] - 4.0, 1)]
    found = fit(stretches, Orders(nb=2, nf=2, nk=1))
    assert found.parameters == 4 + 2
    assert found.model.level == pytest.approx(7.0, abs=0.2)
    assert found.model.F[0] == pytest.approx([1.0, -1.5, 0.8], abs=0.02)
    assert error_percent(truth, simulated(found.model, Segment(u, truth + 7.0))[:, 0] - 7.0) < 3.0


def test_a_level_as_a_state_follows_other_samples():
    u, y, _ = output_error_record(400, percent=5.0)
    found = fit([Segment(u, y)], Orders(nb=2, nf=2, nk=1)).model
    shifted = Segment(u, y + 50.0)
    assert error_percent(shifted.output, simulated(found, shifted, fitted_level=True)[:, 0]) < 10.0
    assert error_percent(shifted.output, simulated(found, shifted)[:, 0]) > 100.0


def test_an_integrator_is_fitted_and_simulated():
    u, e = np.random.default_rng(5).standard_normal((2, 500))
    y = 0.1 * np.concatenate([[0.0], np.cumsum(u - u.mean())[:-1]])
    y = y + 0.02 * y.std() * e
    found = fit([Segment(u[:300], y[:300])], Orders(nb=1, nf=1, nk=1))
    held = Segment(u[300:], y[300:])
    assert abs(found.model.poles()[0]) > 0.99
    assert error_percent(held.output, simulated(found.model, held, fitted_level=True)[:, 0]) < 20.0


def with_level_as_state(model):
    """The same model with ``1 - q^-1`` in numerator and denominator, and no level.

    The further state is a constant, fitted along by the estimate of the initial state.
    """
    difference = np.array([1.0, -1.0])
    b = np.convolve(model.B[0], difference)
    if model.orders.single.nf or not model.orders.na:
        return replace(model, B=(b,), F=(np.convolve(model.F[0], difference),), level=0.0)
    a, c = np.convolve(model.A, difference), np.convolve(model.C, difference)
    return replace(model, A=a, B=(b,), C=c, level=0.0)


@pytest.mark.parametrize("orders", [(0, 2, 0, 0, 2, 1), (2, 2, 1, 0, 0, 1)])
def test_a_level_state_is_the_free_level_of_a_simulation(orders):
    u, y, _ = output_error_record(300)
    model = fit([Segment(u, y)], Orders(**dict(zip(ORDER_NAMES, orders, strict=True)))).model
    shifted = Segment(u, y + 5.0)
    form = with_level_as_state(model).plant().state_space()
    by_state = form.simulate_from_fitted_state(u[:, None], y[:, None] + 5.0)[:, 0]
    assert by_state == pytest.approx(simulated(model, shifted, fitted_level=True)[:, 0], abs=1e-6)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("orders", [(0, 2, 0, 0, 2, 1), (2, 2, 1, 0, 0, 1)])
def test_errors_with_both_levels_are_those_of_two_simulations(orders, robust):
    u, y, _ = output_error_record(300)
    model = fit([Segment(u, y)], Orders(**dict(zip(ORDER_NAMES, orders, strict=True)))).model
    parts = model, Segment(u[:200], y[:200]), Segment(u[200:], y[200:] + 1.0)
    for fitted, errors in enumerate(errors_with_levels(*parts, (False, True), robust)):
        alone = errors_simulated_on(*parts, bool(fitted), robust)
        np.testing.assert_allclose(errors, alone, atol=1e-9)
        assert abs(np.mean(errors)) < 0.5 if fitted else np.mean(errors) < -0.5


@pytest.mark.parametrize("pole", [0.9999, 0.99])
def test_no_predictor_begins_a_simulation(pole):
    """A report simulates from the state that fits: a drift that noise moves is missed there."""
    u, e = np.random.default_rng(4).standard_normal((2, 400, 1))
    A, column = np.diag([pole, 0.5]), np.ones((2, 1))
    model = StateSpaceModel(
        A, column, column.T, np.zeros((1, 1)), 0.5 * column, 1.0, np.zeros(1), np.eye(1)
    )
    y = model.simulate(u) + lfilter([1.0], [1.0, -pole], e, axis=0)
    parts = Segment(u[:300], y[:300]), Segment(u[300:], y[300:])
    fitted = model.simulate_from_fitted_state(u, y, known=300)[300:] - y[300:]
    assert np.allclose(errors_simulated_on(model, *parts), fitted)


def test_what_a_resting_input_cannot_tell_stays_small():
    """Coefficients of B and the level are then one number."""
    u = np.repeat([5.0, 9.0, 3.0], 100)
    e = np.random.default_rng(0).standard_normal(300)
    y = lfilter([0.0, 0.4, 0.3], [1.0, -0.9], u) + 0.1 * lfilter([1.0], [1.0, -0.9], e)
    whole, orders = Segment(u, y), Orders(na=1, nb=2, nk=1)
    model = fit([whole], orders).model
    resting = fit([whole.between(110, 200)], orders, models=[model], own_starts=False).model
    assert max(np.abs(resting.B[0]).max(), abs(resting.level)) < 10.0


def test_the_likeliest_arx_model_is_that_of_one_regression_for_each_order():
    generator, first, stretches = np.random.default_rng(2), 6, []
    for recording, samples in enumerate((900, 9000)):  # the second in two blocks of rows
        u, e = generator.standard_normal((samples, 2)), generator.standard_normal(samples)
        y = lfilter([1.0], [1.0, -1.5, 0.7], u[:, 0] + 0.5 * e) + 3.0 * recording
        stretches.append(Segment(u, y, recording))
    fits = []
    for order in range(1, 6):
        rows = [
            np.r_[
                -stretch.output[t - order : t][::-1],
                stretch.inputs[t - order : t + 1][::-1].ravel(),
                *(stretch.recording == r for r in range(2)),
            ]
            for stretch in stretches
            for t in range(first, stretch.samples)
        ]
        target = np.concatenate([stretch.output[first:] for stretch in stretches])
        found = np.linalg.lstsq(np.array(rows), target)[0]
        e = target - rows @ found
        bic = len(e) * np.log(e @ e / len(e)) + len(found) * np.log(len(e))
        fits.append((bic, e, found[:order]))
    bic, e, a = min(fits, key=lambda each: each[0])
    likeliest = likeliest_arx(stretches, range(1, 6), first)
    assert likeliest.bic == pytest.approx(bic, rel=1e-12)
    assert likeliest.model.A[1:] == pytest.approx(a, rel=1e-9)
    assert likeliest.residuals == pytest.approx(e, abs=1e-9)
