"""Steps and outlying estimates: where they are, and how often there are none."""

import math

import numpy as np
import pytest

from evopem.validation.level_changes import find_levels


def test_a_step_is_found_at_its_place_with_its_size():
    generator = np.random.default_rng(1)
    errors = generator.uniform(0.5, 1.5, 60)
    values = 100.0 + errors * generator.standard_normal(60) - 4.0 * (np.arange(60) >= 25)
    found = find_levels(values, errors, 0.01)
    (change,) = found.changes
    assert change.index == 25
    weights = 1.0 / (errors**2 + found.scatter**2)
    before, after = (
        np.average(values[part], weights=weights[part])
        for part in (slice(None, 25), slice(25, None))
    )
    assert change.before == pytest.approx(before)
    assert change.after == pytest.approx(after)
    expected = math.hypot(weights[:25].sum() ** -0.5, weights[25:].sum() ** -0.5)
    assert 0.999 * expected < change.standard_error < 1.001 * expected
    assert found.values[24] == change.before
    assert found.outlying == ()


def test_a_single_estimate_away_from_the_others_is_no_step():
    values = np.random.default_rng(2).standard_normal(30)
    values[12] += 9.0
    found = find_levels(values, np.ones(30), 0.05)
    assert found.changes == ()
    assert found.outlying == (12,)


@pytest.mark.parametrize(("count", "scatter"), [(6, 1.0), (30, 0.0), (30, 1.0), (50, 3.0)])
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


def test_a_change_that_passes_is_two_steps():
    """The mean of the rest hides one step where the other is not taken as well."""
    generator = np.random.default_rng(4)
    passing = 4.0 * ((np.arange(30) >= 10) & (np.arange(30) < 20))
    found = [
        tuple(change.index for change in find_levels(noise + passing, np.ones(30), 0.05).changes)
        for noise in generator.standard_normal((50, 30))
    ]
    assert found.count((10, 20)) >= 45


def test_scatter_is_not_made_by_a_step():
    generator = np.random.default_rng(5)
    noise = generator.standard_normal(100)
    step = 20.0 * (np.arange(100) > 49)
    assert find_levels(noise + step, np.ones(100), 0.05).scatter < 0.5
    scattered = find_levels(5.0 * noise + step, np.ones(100), 0.05)
    assert scattered.scatter == pytest.approx(math.sqrt(24.0), rel=0.2)
    assert [change.index for change in scattered.changes] == [50]
    assert find_levels(np.zeros(100), np.ones(100), 0.05).scatter == 0.0
