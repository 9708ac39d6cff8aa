"""Steps and outlying estimates: where they are, and how often there are none."""

import math

import numpy as np
import pytest

from evopem.validation.level_changes import excess_scatter, find_levels, step_probability


def test_a_step_is_found_at_its_place_with_its_size():
    generator = np.random.default_rng(1)
    errors = generator.uniform(0.5, 1.5, 60)
    values = 100.0 + errors * generator.standard_normal(60) - 4.0 * (np.arange(60) >= 25)
    found = find_levels(values, errors, 0.01)
    (change,) = found.changes
    assert change.index == 25
    weights = errors**-2.0
    before, after = (
        np.average(values[part], weights=weights[part])
        for part in (slice(None, 25), slice(25, None))
    )
    assert change.before == pytest.approx(before)
    assert change.after == pytest.approx(after)
    expected = math.hypot(weights[:25].sum() ** -0.5, weights[25:].sum() ** -0.5)
    assert 0.999 * expected < change.standard_error < 1.5 * expected
    assert found.values[24] == change.before
    assert found.outlying == ()


def test_a_single_estimate_away_from_the_others_is_no_step():
    values = np.random.default_rng(2).standard_normal(30)
    values[12] += 9.0
    found = find_levels(values, np.ones(30), 0.05)
    assert found.changes == ()
    assert found.outlying == (12,)


@pytest.mark.parametrize(("count", "scatter"), [(6, 1.0), (30, 0.0), (30, 1.0), (100, 3.0)])
def test_false_alarms_stay_within_the_significance(count, scatter):
    """Scatter that no standard error knows of makes no alarms either: 300 sequences each."""
    generator = np.random.default_rng([3, count])
    alarms = 0
    for _ in range(300):
        errors = generator.uniform(0.5, 1.5, count)
        values = np.hypot(errors, scatter) * generator.standard_normal(count)
        found = find_levels(values, errors, 0.05)
        alarms += bool(found.changes or found.outlying)
    # 5 % of 300 are 15; more than 26 have a probability of 0.3 %.
    assert alarms <= 26


def test_the_probability_of_a_step_is_an_upper_bound_of_a_simulated_one():
    generator = np.random.default_rng(4)
    count, splits = 40, np.arange(2, 39)
    sums = np.cumsum(generator.standard_normal((20_000, count)), axis=1)
    left = sums[:, splits - 1]
    difference = (sums[:, -1:] - left) / (count - splits) - left / splits
    largest = np.abs(difference / np.sqrt(1.0 / splits + 1.0 / (count - splits))).max(axis=1)
    for statistic in (2.5, 3.0, 3.5):
        bound = step_probability(statistic, len(splits), 2 / count, 38 / count)
        assert np.mean(largest > statistic) <= bound < 2.5 * np.mean(largest > statistic)


def test_scatter_is_not_made_by_a_step():
    generator = np.random.default_rng(5)
    noise = generator.standard_normal(200)
    step = 20.0 * (np.arange(200) > 99)
    assert excess_scatter(noise + step, np.ones(200)) < 0.8
    assert excess_scatter(5.0 * noise, np.ones(200)) == pytest.approx(5.0, rel=0.25)
    assert excess_scatter(np.zeros(200), np.ones(200)) == 0.0
