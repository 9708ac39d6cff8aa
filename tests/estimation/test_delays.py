"""Delays of the inputs by the criterion of ARX models, against simulated truths."""

from itertools import product

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.estimation import impulse_response
from evopem.estimation.delays import delays_by_criterion, estimate_delays, longest_delay
from evopem.signals.recording import Recording, Segment

PLANT = (1.0, -1.5, 0.7)


def response(u, delay, b=(1.0, 0.5)):
    return lfilter(np.concatenate([np.zeros(delay), b]), PLANT, u)


def measured(u, x, generator, noise=0.1):
    return Recording(u, x + noise * x.std() * generator.standard_normal(x.shape), 1.0)


def drawn(kind, generator, samples, count):
    """Inputs, (samples, count): white, coloured, and binary ones of each length of a step."""
    white = generator.standard_normal((samples, count))
    if kind == "coloured":
        return lfilter([1.0], [1.0, -1.6, 0.8], white, axis=0)
    if kind == "slow":
        return lfilter([1.0], [1.0, -0.95], white, axis=0)
    return white if kind == "white" else np.sign(np.repeat(white, kind, axis=0)[:samples])


NOISE = {"white": (1.0,), "slow": (1.0, -0.9), "of the equation": PLANT}


@pytest.mark.parametrize(("inputs", "repeats"), [(1, 4), (2, 1)])
def test_delays_to_60_samples_are_found(inputs, repeats):
    """Of inputs and noises of several colours; models that share na = nb end too early."""
    wrong, cases = 0, 0
    for kind, colour, seed in product(("white", "coloured", "slow", 1, 4), NOISE, range(repeats)):
        generator = np.random.default_rng([seed, cases])
        delays = generator.integers(0, 61, inputs)
        u = drawn(kind, generator, 1000, inputs)
        parts = [response(*each) for each in zip(u.T, delays, strict=True)]
        x = np.sum([each / each.std() for each in parts], axis=0)
        e = lfilter([1.0], NOISE[colour], generator.standard_normal(1000))
        found = estimate_delays(Recording(u, x + 0.1 * x.std() / e.std() * e, 1.0))
        assert np.max(np.abs(found - delays)) <= 2, (kind, colour, seed, delays, found)
        wrong, cases = wrong + any(found != delays), cases + 1
    assert wrong <= cases // 10


def test_of_delays_that_do_as_well_the_smallest_is_taken():
    """A mode a thousand samples long: no delay of its input explains more than chance does."""
    pole = np.exp(2.0 * np.pi / 1000 * (-0.1 + 0.995j))
    found = []
    for seed in range(10):
        generator = np.random.default_rng(seed)
        u = generator.standard_normal(3500)
        x = lfilter([0.0, 1.0, 1.0], np.poly([pole, pole.conj()]).real, u)[500:]
        found.append(estimate_delays(measured(u[500:], x, generator))[0])
    assert sum(delay <= 1 for delay in found) >= 9, found


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


def test_an_input_that_acts_before_a_long_delay_too_has_a_short_one():
    u = np.random.default_rng(4).standard_normal((1000, 2))
    x = (response(u[:, 0], 0) + 0.3 * response(u[:, 1], 2) + response(u[:, 1], 60))[:, None]
    assert estimate_delays(measured(u, x, np.random.default_rng(5))) == (0, 2)


def test_long_delays_of_short_records():
    """A delay of up to a third of the samples is found, a short one is not taken for a long one."""
    generator = np.random.default_rng(6)
    for delay in (0, 1, 9, 33, 48, 60):
        u, e = generator.standard_normal((2, 200))
        y = response(u, delay) + 0.2 * e
        assert abs(estimate_delays(Recording(u, y, 1.0))[0] - delay) <= 2


def test_recordings_have_means_of_their_own_and_limits_hold():
    generator = np.random.default_rng(4)
    segments = []
    for number in range(3):
        u = generator.standard_normal(300)
        y = response(u, 12) + 100.0 * number + 0.1 * generator.standard_normal(300)
        segments.append(Segment(u, y, number))
    assert longest_delay(segments) == 100
    assert delays_by_criterion(segments, [(0, 100)])[0].delay == 12
    (known,) = delays_by_criterion(segments, [(2, 6)])
    assert 2 <= known.delay <= 6
    assert len(known.criteria) == 5
    assert known.longest == 6


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


def test_only_delays_beside_near_ones_are_compared_one_by_one(monkeypatch):
    u, e = np.random.default_rng(0).standard_normal((2, 1500))
    y = lfilter([0.0] * 20 + [1.0], [1.0, -0.7], u) + 0.3 * e
    rows, made = np.arange(310, 1500), []
    past = np.column_stack([y[rows - k] for k in range(1, 41)])
    lagged = np.column_stack([u[rows - k] for k in range(301)])
    evidence = impulse_response.Evidence
    monkeypatch.setattr(
        impulse_response, "Evidence", lambda *given: made.append(given) or evidence(*given)
    )
    found = impulse_response.delay_evidence(past, lagged, y[rows], len(rows), range(201))
    assert np.argmin(found) == 20
    assert len(made) < 60
    monkeypatch.setattr(impulse_response, "FAR", np.inf)
    every = impulse_response.delay_evidence(past, lagged, y[rows], len(rows), range(201))
    near = every < every.min() + 50.0
    assert np.array_equal(found[near], every[near])
