"""Trends, oscillations and scatter: how often they are found where there are none, and where."""

import numpy as np
import pytest
from scipy.stats import binom, nct, t

from evopem.validation.level_changes import constant_probability, find_drift


def sequences(repeats, count, scatter, seed=1):
    generator = np.random.default_rng([seed, count])
    for _ in range(repeats):
        errors = generator.uniform(0.5, 1.5, count)
        yield errors, np.hypot(errors, scatter) * generator.standard_normal(count)


@pytest.mark.parametrize(("count", "scatter"), [(6, 1.0), (13, 0.0), (13, 3.0), (25, 1.0)])
def test_false_alarms_stay_within_the_significance(count, scatter):
    """Nothing drifts; scatter that no standard error knows of makes no alarms either."""
    places = np.arange(count) + 1.0
    kinds = [
        found.kind
        for errors, values in sequences(400, count, scatter)
        if (found := find_drift(values, errors, places, 0.05)) is not None
    ]
    # Of each kind 2.5 %: so many or more of 400 have a probability of 0.1 %.
    most = binom.isf(0.001, 400, 0.025)
    assert kinds.count("trend") <= most
    assert kinds.count("oscillation") <= most


def test_a_constant_is_rejected_as_often_as_the_level_says():
    rejected = [constant_probability(x, errors) < 0.05 for errors, x in sequences(2000, 13, 0.0)]
    assert binom.ppf(0.001, 2000, 0.05) <= sum(rejected) <= binom.isf(0.001, 2000, 0.05)
    scattered = [constant_probability(x, errors) < 0.05 for errors, x in sequences(200, 13, 3.0)]
    assert np.mean(scattered) > 0.95


@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_the_power_against_a_trend_is_that_of_a_t_test(scatter):
    """Of known variances the statistic would have a noncentral distribution of Student."""
    count, repeats = 20, 300
    places = np.arange(count, dtype=float)
    centred = (places - places.mean()) / (count - 1)
    found, expected = 0, []
    for errors, noise in sequences(repeats, count, scatter):
        weights = 1.0 / (errors**2 + scatter**2)
        middle = weights @ centred / weights.sum()
        standard_error = (weights @ (centred - middle) ** 2) ** -0.5
        drift = find_drift(noise + 5.0 * standard_error * centred, errors, places, 0.05)
        found += drift is not None and drift.kind == "trend"
        critical = t.isf(0.0125, count - 2)
        expected.append(nct.sf(critical, count - 2, 5.0))
    assert found / repeats == pytest.approx(np.mean(expected), abs=0.08)


@pytest.mark.parametrize("period", [4.0, 10.0])
def test_an_oscillation_is_found_with_its_period_and_amplitude(period):
    count = 40
    places = np.arange(count, dtype=float)
    wave, found = 2.5 * np.sin(2 * np.pi * places / period), []
    for errors, noise in sequences(100, count, 0.0):
        drift = find_drift(noise + wave, errors, places, 0.05)
        if drift is not None and drift.kind == "oscillation":
            found.append(drift)
    assert len(found) >= 98
    assert np.mean([each.period for each in found]) == pytest.approx(period, rel=0.05)
    assert np.mean([each.size for each in found]) == pytest.approx(2.5, rel=0.1)


def test_places_that_are_all_one_have_no_drift():
    assert find_drift(np.arange(6.0), np.ones(6), np.ones(6), 0.05) is None
