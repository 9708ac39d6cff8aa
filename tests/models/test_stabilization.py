"""Poles over the order, against models of known poles."""

import pytest

from evopem.models.mode_matching import persistent_frequencies, stabilization
from evopem.synthesis import true_mode


def modes(frequencies, damping=0.05):
    """Modes of these natural frequencies, sampled at 100 Hz."""
    return [true_mode(frequency, damping, 100.0) for frequency in frequencies]


def test_each_pole_is_compared_with_those_of_the_next_lower_order():
    poles = stabilization(
        {
            6: modes([10.05, 20.1, 40.0], damping=0.09),
            2: modes([10.0]),
            4: modes([10.05, 20.0], damping=0.052),
        }
    )
    assert [pole.order for pole in poles] == [2, 4, 4, 6, 6, 6]
    assert [pole.frequency_hz for pole in poles] == pytest.approx([10, 10.05, 20, 10.05, 20.1, 40])
    # 10 Hz: the damping changes by 4 %, then by 73 %.
    assert [pole.status for pole in poles] == [
        "new",
        "stable",
        "new",
        "frequency",
        "frequency",
        "new",
    ]
    assert [pole.damping_ratio for pole in poles] == pytest.approx(
        [0.05, *[0.052] * 2, *[0.09] * 3]
    )


def test_a_frequency_that_moves_by_two_percent_is_not_stable():
    poles = stabilization({2: modes([10.0]), 4: modes([10.2, 30.0])})
    assert [pole.status for pole in poles] == ["new", "new", "new"]


def test_a_mode_persists_when_it_is_present_at_three_orders():
    drifting = [10.0, 10.02, 10.04, 10.06]
    poles = stabilization(
        {
            order: modes([frequency, 20.0] if order < 6 else [frequency, 35.0])
            for order, frequency in zip((4, 5, 6, 7), drifting, strict=True)
        }
    )
    # 20 Hz is present at two orders, 35 Hz at two, 10 Hz at four.
    assert persistent_frequencies(poles) == pytest.approx([10.04])


def test_without_oscillating_poles_there_is_nothing_to_compare():
    assert stabilization({1: []}) == []
    assert persistent_frequencies([]) == []
