"""The tail of a weighted sum of chi-square variables, against closed forms and draws."""

import numpy as np
import pytest
from scipy.stats import chi2

from evopem.validation.residual_tests import weighted_chi_square_tail


def tail_of(value, weights):
    sums = (float(np.sum(np.asarray(weights, dtype=float) ** power)) for power in (1, 2, 3))
    return weighted_chi_square_tail(value, *sums)


@pytest.mark.parametrize("value", [0.5, 5.0, 13.0, 40.0])
def test_equal_weights_are_a_chi_square_variable(value):
    weights = np.full(7, 1.7)
    assert tail_of(value, weights) == pytest.approx(chi2.sf(value / 1.7, 7))


@pytest.mark.parametrize("value", [11.0, 12.0, 20.0, 30.0])
def test_pairs_of_weights_are_a_sum_of_exponentials(value):
    a, b = 2.0, 0.7
    expected = (a * np.exp(-value / (2 * a)) - b * np.exp(-value / (2 * b))) / (a - b)
    assert tail_of(value, [a, a, b, b]) == pytest.approx(expected, abs=0.002)


def test_drawn_sums_exceed_their_value_as_often_as_it_says():
    weights = np.r_[np.ones(20), 0.6, 0.3, 0.05]
    drawn = np.random.default_rng(1).standard_normal((100_000, weights.size)) ** 2 @ weights
    for share in (0.5, 0.05, 0.01):
        tail = tail_of(np.quantile(drawn, 1 - share), weights)
        assert tail == pytest.approx(share, abs=4 * np.sqrt(share / drawn.size))


def test_values_beyond_the_range_and_sums_of_nothing():
    assert tail_of(-1.0, [1.0, 0.5]) == 1.0
    assert tail_of(1e6, [1.0, 0.5]) == 0.0
    assert np.isnan(tail_of(1.0, []))
    assert np.isnan(tail_of(1.0, [0.0, 0.0]))
    assert np.isnan(tail_of(np.nan, [1.0, 0.5]))
