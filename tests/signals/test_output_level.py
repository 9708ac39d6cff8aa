"""The level of an output: free of the ends of a record, and the mean where it is not known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.signals.recording import Recording
from evopem.signals.transforms import output_levels

# A resonance that rings for some fifty samples, and a gain at frequency zero.
A, B = np.real(np.poly(0.95 * np.exp([0.6j, -0.6j]))), [0.0, 1.0, 0.5]
GAIN = sum(B) / sum(A)


def level_of(recording):
    (level,) = output_levels(recording)
    return level


def record(seed, noise, samples=1000, level=3.0):
    """A response that settled before the record and goes on after it, with white noise in C = 1."""
    u, e = np.random.default_rng(seed).standard_normal((2, samples + 500))
    y = level + lfilter(B, A, u + 0.5) + noise * lfilter([1.0], A, e)
    return Recording(u[500:] + 0.5, y[500:], 1.0)


def errors(noise):
    """Errors of the mean and of the level of 40 records, each against the response to the mean."""
    records = [record(seed, noise) for seed in range(40)]
    truths = np.array([3.0 + GAIN * each.input.mean() for each in records])
    means = np.array([each.output.mean() for each in records])
    return means - truths, np.array([level_of(each) for each in records]) - truths


def test_with_little_noise_the_level_is_free_of_the_ends_of_the_record():
    of_mean, of_level = errors(noise=0.001)
    assert np.std(of_level) < 0.05 * np.std(of_mean)
    # What is left is the noise of a mean: deviation of e, over sqrt(N), times the gain of 1/A.
    assert np.std(of_level) < 2.0 * 0.001 / sum(A) / np.sqrt(1000)


def test_with_much_noise_the_level_is_the_mean():
    of_mean, of_level = errors(noise=5.0)
    assert np.mean(of_mean == of_level) > 0.9


@pytest.mark.parametrize("samples", [15, 1000])
def test_what_has_no_level_keeps_its_mean(samples):
    """A record too short for the regression, and a random walk."""
    walk = np.cumsum(np.random.default_rng(2).standard_normal((2, samples)), axis=1)
    drifting = Recording(walk[0], walk[1], 1.0)
    assert level_of(drifting) == drifting.output.mean()


def test_a_unit_changes_nothing_but_the_unit():
    one = record(1, 0.001)
    other = Recording(1e-3 * one.input, 1e6 * one.output, 1.0)
    assert level_of(other) == pytest.approx(1e6 * level_of(one), rel=1e-9)


def test_a_response_that_begins_and_ends_at_rest_keeps_its_level():
    """Its mean is the level already, whatever its input."""
    u, e = np.random.default_rng(3).standard_normal((2, 1000))
    u[800:] = 0.0
    at_rest = Recording(u, lfilter(B, A, u) + 1e-4 * e, 1.0)
    assert level_of(at_rest) == pytest.approx(GAIN * u.mean(), abs=1e-3)


def test_of_several_channels_each_output_has_its_own_level():
    """The level of the sum of two responses, and of one alone beside it."""
    one, other = record(1, 0.001, level=3.0), record(2, 0.001, level=-7.0)
    inputs = np.column_stack([one.input, other.input])
    both = Recording(inputs, np.column_stack([one.output + other.output, other.output]), 1.0)
    truths = -4.0 + GAIN * inputs.mean(axis=0).sum(), -7.0 + GAIN * other.input.mean()
    errors = np.abs(np.array(output_levels(both)) - truths)
    assert np.all(errors < 0.3 * np.abs(both.outputs.mean(axis=0) - truths))
