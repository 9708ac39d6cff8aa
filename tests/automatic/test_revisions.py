"""Revisions of failed checks."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic.candidates import Scorer
from evopem.automatic.cross_validation.folds import decide_folds
from evopem.automatic.fit import CommonSettings
from evopem.automatic.revision_orders import with_noise_models
from evopem.automatic.revisions import act_on_checks
from evopem.automatic.structures import Choice
from evopem.models.orders import Orders
from evopem.signals.recording import Segment
from evopem.validation.checks.inputs import EXCITATION_ADEQUATE
from evopem.validation.checks.residuals import WHITE
from evopem.validation.checks.roots import DISTINCT

A = np.poly([0.92 * np.exp(0.6j), 0.92 * np.exp(-0.6j)]).real
D = np.poly([0.8 * np.exp(1.5j), 0.8 * np.exp(-1.5j)]).real


def revised(y, u, structure, **orders):
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings())
    candidate = scorer.candidate(structure, Orders(**orders))
    return scorer, candidate, act_on_checks(scorer, Choice("simulation", candidate, "constant"))


def test_common_roots_of_an_arx_model_are_those_of_the_noise():
    u, e = np.random.default_rng(1).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.6], A, u) + lfilter([1.0], np.convolve(A, D), e)
    scorer, before, found = revised(y, u, "arx", na=4, nb=4, nk=1)
    assert DISTINCT in scorer.checks(before).failed
    assert found.failed == ()
    after = found.choice.candidate
    assert (after.structure, after.orders) == (
        "ararx",
        Orders(na=2, nb=2, nd=2, nk=1),
    )
    np.testing.assert_allclose(after.model.D, D, atol=0.1)


def test_ends_of_b_that_are_zero_are_left_out():
    u, e = np.random.default_rng(2).standard_normal((2, 1000))
    y = lfilter([0.0, 0.0, 1.0, 0.6], A, u) + 0.3 * e
    _, _, found = revised(y, u, "oe", nb=4, nf=2, nk=1)
    assert found.choice.candidate.orders == Orders(nb=2, nf=2, nk=2)


def test_what_stays_failed_is_said_in_words():
    generator = np.random.default_rng(3)
    u = np.tile(generator.standard_normal(200), 4)
    y = lfilter([0.0, 1.0, 0.6], A, u + 0.3 * u**3) + 1e-3 * generator.standard_normal(len(u))
    _, _, found = revised(y, u, "arx", na=2, nb=2, nk=1)
    assert len(found.statements) == len(found.failed) > 0
    assert any("did not hold for" in each for each in found.statements)


def test_a_plant_keeps_its_simulations_beside_a_noise_model_of_its_own():
    u, e = np.random.default_rng(4).standard_normal((2, 1000))
    y = lfilter([0.0, 1.0, 0.6], A, u) + lfilter([1.0], [1.0, -0.9], e)
    stretches = [Segment(u, y)]
    scorer = Scorer(stretches, decide_folds(stretches), CommonSettings())
    plant = scorer.candidate("oe", Orders(nb=2, nf=2, nk=1))
    order, described = next(with_noise_models(scorer, plant))
    assert order == 1
    assert np.roots(described.model.D)[0].real == pytest.approx(0.9, abs=0.05)
    np.testing.assert_array_equal(described.model.F[0], plant.model.F[0])


def test_little_excitation_is_acted_on_after_residuals():
    """The input alone tells that it fails: it leaves the trials to what may be mended."""
    t, e = np.arange(600), np.random.default_rng(5).standard_normal(600)
    u = np.sin(0.3 * t) + np.sin(0.7 * t)
    y = lfilter([0.0, 1.0, 0.6], A, u) + 0.1 * lfilter([1.0], D, e)
    scorer, before, found = revised(y, u, "arx", na=3, nb=3, nk=1)
    assert {WHITE, EXCITATION_ADEQUATE} <= set(scorer.checks(before).failed)
    acted_on = [trial.check for trial in found.trials]
    assert acted_on.index(WHITE) < acted_on.index(EXCITATION_ADEQUATE)
