"""Modes paired by frequency, and grouped over models of several orders."""

import math
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from evopem.models.mode_matching import (
    SAME_MODE,
    cluster_modes,
    deviations,
    match_modes,
    mode_distance,
    with_spread,
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
    assert deviations(estimate, truth) == pytest.approx((0.4, -0.5))


@pytest.mark.parametrize("error", [math.nan, math.inf, 0.0])
def test_deviations_are_not_known_without_a_standard_error(error):
    estimate = Mode(5.4, 0.01, 0j, frequency_se_hz=error, damping_se=error)
    assert all(map(math.isnan, deviations(estimate, Mode(5.36, 0.01, 0j))))


FIRST, SECOND = np.array([1.0, 0.3, -0.5]) + 0j, np.array([-0.2, 1.0, 0.4]) + 0j


def shaped(frequency, damping=0.02, shape=FIRST, error=0.01):
    errors = np.full(3, 0.02)
    return Mode(
        frequency_hz=frequency,
        damping_ratio=damping,
        pole=0j,
        shape=shape,
        frequency_se_hz=error,
        damping_se=0.003,
        shape_se_real=errors,
        shape_se_imag=errors,
    )


def test_two_modes_of_every_order_within_their_tolerance_stay_apart():
    """Both lie within 1 % with the same shape: only that each order has two tells them apart."""
    orders = {n: [shaped(10.0 + 0.01 * n), shaped(10.1 + 0.01 * n)] for n in (4, 6, 8)}
    groups = cluster_modes(orders)
    assert groups == [{4: 0, 6: 0, 8: 0}, {4: 1, 6: 1, 8: 1}]


def test_the_shape_tells_modes_of_one_frequency_apart():
    orders = {4: [shaped(10.0)], 6: [shaped(10.0, shape=SECOND), shaped(10.02)], 8: [shaped(10.01)]}
    assert sorted(map(sorted, (g.items() for g in cluster_modes(orders)))) == [
        [(4, 0), (6, 1), (8, 0)],
        [(6, 0)],
    ]


def test_a_distance_is_judged_by_its_standard_errors_where_these_are_large():
    assert mode_distance(shaped(10.0), shaped(10.5)) > 1.0
    assert mode_distance(shaped(10.0, error=0.2), shaped(10.5)) < 1.0
    unknown = mode_distance(shaped(10.0, error=np.nan), shaped(10.15, error=np.nan))
    assert unknown < 1.0
    # Of two models of which one has no covariance, those of the other one.
    assert mode_distance(shaped(10.0, error=0.2), shaped(10.5, error=np.nan)) < 1.0


def test_standard_errors_contain_the_spread_of_models_that_do_as_well():
    (mode,) = [shaped(10.0)]
    rivals = [[mode], [shaped(10.2), shaped(30.0)], [shaped(30.0)], []]
    (wide,) = with_spread([mode], rivals)
    # Two of the models have the mode, one of them 0.2 Hz higher.
    assert wide.frequency_se_hz == pytest.approx(np.hypot(mode.frequency_se_hz, 0.2 / np.sqrt(2)))
    assert wide.damping_se == mode.damping_se
    assert with_spread([mode], [[shaped(30.0)]]) == (mode,)


def test_standard_errors_of_shapes_contain_the_spread_of_models_as_well():
    """The other shape is scaled by -2j and has 0.1 more at its second output."""
    mode = replace(
        shaped(10.0, shape=np.array([1.0, 0.5])),
        shape_se_real=np.array([0.0, 0.02]),
        shape_se_imag=np.array([0.0, 0.03]),
        shape_assurance=0.999,
    )
    other = shaped(10.0, shape=-2j * np.array([1.0, 0.6]))
    (wide,) = with_spread([mode], [[mode], [other]])
    np.testing.assert_allclose(wide.shape_se_real, [0.0, np.hypot(0.02, 0.1 / np.sqrt(2.0))])
    np.testing.assert_allclose(wide.shape_se_imag, [0.0, 0.03], atol=1e-15)
    loss = (1.0 - 1.3**2 / (1.25 * 1.36)) / 2.0
    assert wide.shape_assurance == pytest.approx(0.999 - loss)


def test_no_modes_make_no_groups():
    assert cluster_modes({2: [], 4: []}) == []
