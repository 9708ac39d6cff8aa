"""Limits of the orders of polynomial models with several inputs."""

import pytest

from evopem.config.settings import OrderRanges
from evopem.errors import InputError
from evopem.estimation.order_scan import OrderLimits, joint_orders
from evopem.models.structures import Orders

NAMES = ("hot", "cold")


def limits(**ranges):
    return OrderLimits.of(OrderRanges(**ranges), NAMES)


def test_orders_follow_the_joint_order_within_their_limits():
    given = limits(nb=(1, 3), nf={"cold": (0, 0)}, nc=(2, 2))
    followed = [str(joint_orders("bj", k, (1, 2), given)) for k in (1, 3, 5)]
    assert followed[0] == "BJ([1 1],2,1,[1 0],[1 2])"
    assert followed[1] == "BJ([3 3],2,3,[3 0],[1 2])"
    assert followed[2] == "BJ([3 3],2,4,[5 0],[1 2])"


def test_what_a_structure_does_not_have_stays_out():
    given = limits(nf=(2, 2), nd=(1, 1))
    assert joint_orders("armax", 2, (0, 0), given) == joint_orders("armax", 2, (0, 0))


def test_what_lies_within_the_limits():
    given = limits(nb=(2, 3), nk=((0, 1), (1, 1)))
    orders = Orders("arx", nb=(2, 3), nf=(0, 0), nk=(1, 1), na=4)
    assert given.allow(orders)
    assert given.at_upper_ends(orders, NAMES) == ("nb of cold",)
    assert not given.allow(Orders("arx", nb=(1, 3), nf=(0, 0), nk=(1, 1), na=4))
    assert not given.allow(Orders("arx", nb=(2, 3), nf=(0, 0), nk=(1, 2), na=4))


def test_other_inputs_are_refused_by_their_key():
    with pytest.raises(InputError, match=r"orders.nb: there is no input warm; name one of hot"):
        limits(nb={"warm": (1, 1)})
    with pytest.raises(InputError, match=r"delay.nk: there are 1 values and 2 inputs"):
        limits(nk=((1, 1),))
