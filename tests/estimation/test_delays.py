"""Delays of the inputs by the criterion of ARX models, against simulated truths."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.estimation.delays import delays_by_criterion, estimate_delays, longest_delay
from evopem.signals.recording import Recording, Segment

PLANT = (1.0, -1.5, 0.7)


def response(u, delay, b=(1.0, 0.5)):
    return lfilter(np.concatenate([np.zeros(delay), b]), PLANT, u)


def measured(u, x, generator, noise=0.1):
    return Recording(u, x + noise * x.std() * generator.standard_normal(x.shape), 1.0)


@pytest.mark.parametrize("kind", ["white", "binary"])
def test_delays_up_to_120_samples_are_found(kind):
    """A range that grew only from a choice near its end missed most delays from 18 on."""
    found = []
    for delay in range(0, 121, 8):
        generator = np.random.default_rng(delay)
        u = generator.standard_normal(1000)
        u = np.sign(u) if kind == "binary" else u
        x = response(u, delay)
        found.append(estimate_delays(measured(u, x, generator))[0] - delay)
    assert set(found) <= {-1, 0}
    assert found.count(0) >= 11


def test_inputs_have_delays_of_their_own():
    generator = np.random.default_rng(1)
    u = generator.standard_normal((1200, 3))
    x = sum(response(u[:, k], delay) for k, delay in enumerate((1, 40, 90)))
    found = np.subtract(estimate_delays(measured(u, x, generator)), (1, 40, 90))
    assert set(found.tolist()) <= {-1, 0}


def test_a_delay_is_that_of_the_first_output_that_answers():
    generator = np.random.default_rng(2)
    u = generator.standard_normal(1000)
    x = np.column_stack([response(u, 30), response(u, 22)])
    assert estimate_delays(measured(u, x, generator)) == (22,)


def test_an_input_that_does_nothing_has_no_long_delay():
    """The best of 76 delays seems to explain something in about one recording of a hundred."""
    generator = np.random.default_rng(3)
    found = []
    for _ in range(30):
        u, e = generator.standard_normal((2, 600))
        y = lfilter([1.0], [1.0, -0.9], e)
        found.append(estimate_delays(Recording(u, y, 1.0))[0])
    assert sum(delay <= 10 for delay in found) >= 28


def test_recordings_have_means_of_their_own_and_limits_hold():
    generator = np.random.default_rng(4)
    segments = []
    for number in range(3):
        u = generator.standard_normal(300)
        y = response(u, 12) + 100.0 * number + 0.1 * generator.standard_normal(300)
        segments.append(Segment(u, y, number))
    assert longest_delay(segments) == 37
    assert delays_by_criterion(segments, [(0, 37)])[0][0] == 12
    delay, criteria = delays_by_criterion(segments, [(2, 6)])[0]
    assert 2 <= delay <= 6
    assert len(criteria) == 5


def test_few_samples_and_resting_inputs_give_the_smallest_delay():
    generator = np.random.default_rng(5)
    assert estimate_delays(Recording(np.ones(60), generator.standard_normal(60), 1.0)) == (0,)
    assert estimate_delays(Recording(np.arange(12.0) % 3, np.arange(12.0) % 5, 1.0), 10) == (0,)
    assert estimate_delays(Recording(np.zeros((50, 0)), generator.standard_normal(50), 1.0)) == ()


def test_a_range_that_is_longer_than_the_recording_leaves_samples_to_compare():
    found = set()
    for seed in range(10):
        generator = np.random.default_rng(seed)
        u = generator.standard_normal(150)
        found |= {estimate_delays(measured(u, response(u, 5), generator), 200)[0]}
    assert found <= {4, 5}


def test_long_recordings_are_taken_in_parts():
    generator = np.random.default_rng(7)
    u = generator.standard_normal(20_000)
    assert estimate_delays(measured(u, response(u, 33), generator), 40) == (33,)
