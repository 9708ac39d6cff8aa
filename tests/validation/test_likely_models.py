"""Modes of other likely models beside those of the chosen one."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.models.mode_matching import OrderModel
from evopem.models.polynomial import PolynomialModel
from evopem.validation.likely_models import beside_rival
from evopem.validation.mode_evidence import table_of_models

RATE = 100.0


def table_of(*modes, doubts=(), orders=(2, 3, 4)):
    """A table of modes of given frequency and damping ratio, all trusted or all in doubt."""
    poles = [
        np.exp(2 * np.pi * f / RATE * complex(-damping, np.sqrt(1 - damping**2)))
        for f, damping in modes
    ]
    one = np.ones(1)
    plant = PolynomialModel(
        one, one, F=np.real(np.poly([*poles, *np.conj(poles)])), sampling_rate=RATE
    )
    order = 2 * len(modes)
    table = table_of_models([OrderModel.of(order, 0.0, plant)], order)
    rows = (replace(row, doubts=doubts, orders=orders) for row in table.modes)
    return replace(table, modes=tuple(rows))


def beside(table, other, gain=0.0):
    joined = beside_rival(table, other, "ARX(2,2,1)", gain)
    assert np.shape(joined.assurance) == (len(joined.modes),) * 2
    return [(round(row.mode.frequency_hz, 3), row.trusted, row.model) for row in joined.modes]


@pytest.mark.parametrize(
    ("doubts", "orders", "added"),
    [((), (2, 3, 4), True), ((), (2, 3), False), (("it is",), (2, 3, 4), False)],
)
def test_a_trusted_mode_that_three_orders_have_is_added(doubts, orders, added):
    other = table_of((10.0, 0.02), (21.0, 0.02), doubts=doubts, orders=orders)
    rows = beside(table_of((10.0, 0.02)), other)
    assert rows == [(10.0, True, "")] + [(21.0, True, "ARX(2,2,1)")] * added


def test_it_takes_the_place_of_the_same_one_in_doubt():
    table = table_of((10.0, 0.02), (21.0, 0.02), doubts=("it is",))
    assert beside(table, table_of((10.05, 0.02))) == [
        (10.05, True, "ARX(2,2,1)"),
        (21.0, False, ""),
    ]


@pytest.mark.parametrize(("gain", "doubted"), [(10.1, True), (9.9, False)])
def test_a_mode_that_a_smaller_and_far_likelier_model_lacks_is_doubted(gain, doubted):
    chosen, smaller = table_of((10.0, 0.02), (21.0, 0.02)), table_of((10.1, 0.02))
    assert beside(chosen, smaller, gain) == [(10.0, True, ""), (21.0, not doubted, "")]
    # A larger model may have lost it among others.
    larger = table_of((10.1, 0.02), (30.0, 0.02), (40.0, 0.02), orders=(6,))
    assert beside(chosen, larger, gain) == [(10.0, True, ""), (21.0, True, "")]


def test_no_mode_keeps_a_plane_with_one_that_another_model_replaces():
    known = table_of((10.0, 0.02), (21.0, 0.02), doubts=("it is",))
    rows = tuple(replace(row, pair=1 - k) for k, row in enumerate(known.modes))
    joined = beside_rival(replace(known, modes=rows), table_of((10.05, 0.02)), "R", 0.0)
    assert [(row.model, row.pair) for row in joined.modes] == [("R", None), ("", None)]


def test_modes_of_two_models_are_in_the_order_of_their_frequencies():
    rows = beside(table_of((10.0, 0.02)), table_of((5.0, 0.02), (10.0, 0.02)))
    assert rows == [(5.0, True, "ARX(2,2,1)"), (10.0, True, "")]
