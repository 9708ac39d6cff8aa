"""Grouping of the modes of models of several orders."""

import numpy as np

from evopem.models.mode_clusters import cluster_modes, mode_distance
from evopem.models.state_space_modes import ShapedMode

FIRST, SECOND = np.array([1.0, 0.3, -0.5]) + 0j, np.array([-0.2, 1.0, 0.4]) + 0j


def mode(frequency, damping=0.02, shape=FIRST, error=0.01):
    errors = np.full(3, 0.02)
    return ShapedMode(
        frequency_hz=frequency,
        damping_ratio=damping,
        pole=0j,
        shape=shape,
        input_participation=np.empty(0, dtype=complex),
        noise_participation=np.zeros(3, dtype=complex),
        output_shares=np.full(3, 0.5),
        phase_collinearity=1.0,
        mean_phase_deg=0.0,
        phase_deviation_deg=0.0,
        frequency_se_hz=error,
        damping_se=0.003,
        shape_se_real=errors,
        shape_se_imag=errors,
    )


def test_two_modes_of_every_order_within_their_tolerance_stay_apart():
    """Both lie within 1 % with the same shape: only that each order has two tells them apart."""
    orders = {n: [mode(10.0 + 0.01 * n), mode(10.1 + 0.01 * n)] for n in (4, 6, 8)}
    groups = cluster_modes(orders)
    assert groups == [{4: 0, 6: 0, 8: 0}, {4: 1, 6: 1, 8: 1}]


def test_the_shape_tells_modes_of_one_frequency_apart():
    orders = {4: [mode(10.0)], 6: [mode(10.0, shape=SECOND), mode(10.02)], 8: [mode(10.01)]}
    assert sorted(map(sorted, (g.items() for g in cluster_modes(orders)))) == [
        [(4, 0), (6, 1), (8, 0)],
        [(6, 0)],
    ]


def test_a_distance_is_judged_by_its_standard_errors_where_these_are_large():
    assert mode_distance(mode(10.0), mode(10.5)) > 1.0
    assert mode_distance(mode(10.0, error=0.2), mode(10.5)) < 1.0
    unknown = mode_distance(mode(10.0, error=np.nan), mode(10.15, error=np.nan))
    assert unknown < 1.0


def test_no_modes_make_no_groups():
    assert cluster_modes({2: [], 4: []}) == []
