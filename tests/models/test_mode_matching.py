"""Modes paired by frequency."""

import math
from itertools import permutations

import numpy as np
import pytest

from evopem.models.mode_matching import (
    SAME_MODE,
    damping_deviation,
    frequency_deviation,
    match_modes,
)
from evopem.models.modes import Mode


def modes(*frequencies):
    return [Mode(frequency, 0.01, 0j) for frequency in frequencies]


def test_the_nearest_mode_is_taken():
    assert match_modes(modes(8.8, 10.1), modes(10.0)) == {1: 0}


def test_modes_of_different_frequency_are_not_paired():
    assert match_modes(modes(10.0), modes(11.6, 8.6)) == {}
    assert match_modes(modes(10.0), modes(11.4)) == {0: 0}
    assert match_modes([], modes(1.0)) == match_modes(modes(1.0), []) == {}


@pytest.mark.parametrize("seed", range(20))
def test_pairs_are_those_of_an_exhaustive_search(seed):
    """Most pairs, and among those the least sum of squared distances, over all permutations."""
    generator = np.random.default_rng(seed)
    estimates, references = np.sort(np.exp(generator.uniform(0, 0.5, (2, 4))), axis=1)
    best = None
    for order in permutations(range(4)):
        distances = np.abs(np.log(estimates) - np.log(references[list(order)]))
        near = distances <= math.log(1 + SAME_MODE)
        rank = (-int(near.sum()), float((distances[near] ** 2).sum()))
        if best is None or rank < best[0]:
            best = (rank, {i: order[i] for i in range(4) if near[i]})
    assert match_modes(modes(*estimates), modes(*references)) == best[1]


def test_deviations_are_in_standard_errors():
    truth = Mode(5.36, 0.0100, 0j)
    estimate = Mode(5.40, 0.0095, 0j, frequency_se_hz=0.1, damping_se=0.001)
    assert frequency_deviation(estimate, truth) == pytest.approx(0.4)
    assert damping_deviation(estimate, truth) == pytest.approx(-0.5)


@pytest.mark.parametrize("error", [math.nan, math.inf, 0.0])
def test_deviations_are_not_known_without_a_standard_error(error):
    estimate = Mode(5.4, 0.01, 0j, frequency_se_hz=error, damping_se=error)
    assert math.isnan(frequency_deviation(estimate, Mode(5.36, 0.01, 0j)))
    assert math.isnan(damping_deviation(estimate, Mode(5.36, 0.01, 0j)))
