"""Distances from a reference: their distribution without a change, and how they grow with one."""

import numpy as np
import pytest
from scipy.stats import binom, f

from evopem.validation.damage_index import Frequencies

SLOPES = np.array([-2.0, 1.0, 3.0])


def frequencies(seed, reference, others, *, missing=0.0, change=0.0, bend=0.0, scatter=1.0):
    """Three modes under temperature with shared scatter; the others are changed, in errors."""
    generator = np.random.default_rng([8, seed])
    count = reference + others
    temperature = generator.uniform(-1.0, 1.0, (count, 1))
    errors = generator.uniform(0.5, 1.5, (count, 3))
    shared, own, noise = generator.standard_normal((3, count, 3))
    values = 100.0 + 3.0 * SLOPES * temperature + bend * SLOPES * temperature**2
    values += errors * noise + scatter * (0.8 * shared[:, :1] + 0.6 * own)
    values[reference:] += change
    gone = generator.uniform(size=values.shape) < missing
    values[gone] = errors[gone] = np.nan
    return Frequencies(values, errors, temperature, np.arange(count) < reference)


def test_without_conditions_the_distance_is_hotelling_s():
    generator = np.random.default_rng(1)
    values = 50.0 + generator.standard_normal((21, 3)) @ generator.standard_normal((3, 3))
    known = Frequencies(values, np.full((21, 3), 1e-9), np.empty((21, 0)), np.arange(21) < 20)
    left = values[20] - values[:20].mean(axis=0)
    covariance = np.cov(values[:20].T) * (1.0 + 1.0 / 20.0)
    statistic = 17.0 / (19.0 * 3.0) * left @ np.linalg.solve(covariance, left)
    found = known.distance(20, 0.05)
    assert found.p_value == pytest.approx(f.sf(statistic, 3, 17), rel=1e-6)
    assert found.index == pytest.approx(np.sqrt(statistic / f.isf(0.05, 3, 17)), rel=1e-6)
    # One of the reference is compared with the nineteen others.
    row = known.distance(4, 0.05)
    others = np.delete(values[:20], 4, axis=0)
    left = values[4] - others.mean(axis=0)
    distance = left @ np.linalg.solve(np.cov(others.T) * (20.0 / 19.0), left)
    assert row.p_value == pytest.approx(f.sf(16.0 / (18.0 * 3.0) * distance, 3, 16), rel=1e-6)


@pytest.mark.parametrize(("missing", "bend"), [(0.0, 0.0), (0.15, 2.0)])
def test_false_alarms_are_as_frequent_as_was_set(missing, bend):
    """One recording of each fleet, so that they are independent."""
    p_values = []
    for seed in range(400):
        found = frequencies(seed, 25, 1, missing=missing, bend=bend).distance(25, 0.01)
        if not found.reason:
            assert (found.index > 1.0) == (found.p_value < 0.01)
            p_values.append(found.p_value)
    assert len(p_values) > 330
    for level in (0.01, 0.05):
        alarms = sum(value < level for value in p_values)
        assert alarms <= binom.isf(0.001, len(p_values), level)
    # Nor are they so few that a change would be hidden.
    assert sum(value < 0.2 for value in p_values) >= binom.ppf(0.001, len(p_values), 0.12)


def test_a_change_below_the_effect_of_the_temperature_is_found():
    """The change has the direction of a temperature two thirds of the range away."""
    known = frequencies(1, 40, 40, change=2.0 * SLOPES)
    found = [known.distance(number, 0.01) for number in range(40, 80)]
    judged = [each for each in found if not each.reason]
    assert np.mean([each.index > 1.0 for each in judged]) > 0.9
    plain = Frequencies(known.values, known.errors, np.empty((80, 0)), known.is_reference)
    assert np.mean([plain.distance(number, 0.01).index > 1.0 for number in range(40, 80)]) < 0.8


def test_what_cannot_be_judged_says_why():
    known = frequencies(2, 20, 4)
    known.conditions[20] = 1.5
    known.values[21] = known.errors[21] = np.nan
    known.values[:14, 2] = known.errors[:14, 2] = np.nan
    found = [known.distance(number, 0.01) for number in range(20, 24)]
    assert [each.reason for each in found] == ["condition", "no mode", "", ""]
    # Six recordings of the reference say too little of the third mode.
    assert found[2].modes == (0, 1)
    few = Frequencies(known.values, known.errors, known.conditions, np.arange(24) < 5)
    assert few.distance(22, 0.01).reason in ("reference", "condition")
    none = Frequencies(known.values, known.errors, known.conditions, np.zeros(24, dtype=bool))
    assert none.distance(22, 0.01).reason == "reference"
