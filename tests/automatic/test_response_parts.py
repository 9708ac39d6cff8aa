"""Held-out parts of a record with a single blow."""

import numpy as np
import pytest
from records import output_error_record
from scipy.signal import lfilter

from evopem.automatic.cross_validation.folds import SHORTEST_BLOCK, decide_folds
from evopem.automatic.cross_validation.stretches import REASON, folds_of, response_parts
from evopem.signals.recording import Segment

SAMPLES, DECAY = 1000, np.array([1.0, -2.0 * 0.985 * np.cos(0.4), 0.985**2])


def blow(at, noise=0.02):
    """Input and output, (N, 1) each: a blow of two samples, and noise in percent of the peak."""
    generator = np.random.default_rng(5)
    u = np.zeros(SAMPLES)
    u[at : at + 2] = 1.0
    y = lfilter([0.0, 1.0], DECAY, u)
    u += 0.1 * noise * generator.standard_normal(SAMPLES)
    y += noise * np.abs(y).max() * generator.standard_normal(SAMPLES)
    return u[:, None], y[:, None]


@pytest.mark.parametrize("at", [40, 300, 700])
@pytest.mark.parametrize("count", [2, 5])
def test_parts_have_equal_shares_of_the_response_behind_the_blow(at, count):
    u, y = blow(at)
    edges = response_parts(u, y, count, 25)
    assert edges[0] == 0
    assert edges[1] > at + 2
    assert edges[-1] < at + 250  # 3 % of the peak are left there
    energy = np.add.reduceat(y[: edges[-1], 0] ** 2, edges[:-1])
    assert (energy[1:] > 0.02 * energy.sum()).all()
    assert min(np.diff(edges)) >= 25


def test_ordinary_records_and_drifts_are_no_responses_to_a_blow():
    u, y, _ = output_error_record(SAMPLES)
    drift = y + np.linspace(-20.0, 20.0, SAMPLES) * y.std()
    for each in (y, drift):
        assert response_parts(u[:, None], each[:, None], 5, 25) is None
    assert response_parts(np.empty((SAMPLES, 0)), blow(40)[1], 5, 25) is None


def test_the_folds_of_one_input_always_fit_the_blow():
    u, y = blow(40)
    stretch = Segment(u[:, 0], y[:, 0])
    plan = decide_folds((stretch,))
    assert plan.by_energy
    assert "single blow" in plan.decision.sentence
    edges = tuple(response_parts(u, y, 5, SHORTEST_BLOCK))
    for fold in folds_of((stretch,), 5, 1, SHORTEST_BLOCK, edges):
        assert max(each.input.max() for each in fold.training) > 0.9
        (held,) = fold.held_out
        assert held.output.std() > 0.05 * np.abs(y).max()
    ordinary, answer, _ = output_error_record(SAMPLES)
    assert not decide_folds((Segment(ordinary, answer),)).by_energy


def test_a_pause_between_excited_parts_makes_no_single_blow():
    u, y, _ = output_error_record(SAMPLES)
    rest = slice(400, 600)
    u[rest] = 0.0
    y[rest] *= 0.01
    assert response_parts(u[:, None], y[:, None], 5, SHORTEST_BLOCK) is not None
    plan = decide_folds((Segment(u, y),))
    assert (plan.designs, plan.by_energy) == (((2, 1), (5, 1), (2, 3)), False)


def test_no_fold_is_fitted_to_a_rest_alone():
    u, y, _ = output_error_record(SAMPLES)
    u[450:] = 0.0
    y[500:] *= 0.01
    assert decide_folds((Segment(u, y),)).designs == ((5, 1), (2, 3))


def test_several_channels_say_by_which_parts_they_are_scored():
    u, y = blow(40)
    about = decide_folds((Segment(u, np.hstack([y, -y])),)).decision
    assert (about.choice, about.sentence) == ("2 folds of 1 block and 5 folds of 1 block", REASON)
    ordinary, answer, _ = output_error_record(SAMPLES)
    plan = decide_folds((Segment(ordinary, np.column_stack([answer, -answer])),))
    assert (plan.designs, plan.by_energy) == (((5, 1),), False)
