"""Limits of the orders that a configuration sets."""

import pytest

from evopem.automatic.candidates import OrderLimits
from evopem.automatic.orders import orders_of_size
from evopem.config.settings import OrderRanges
from evopem.errors import InputError
from evopem.models.orders import Orders


def limits(structure=None, names=("input",), **ranges):
    return OrderLimits(structure, OrderRanges(**ranges), names)


def orders(**given):
    return Orders(**given)


def test_without_limits_everything_is_allowed():
    path = [[orders(na=1, nb=1)], [orders(na=2, nb=2)]]
    assert list(OrderLimits().within("arx", path)) == path
    assert OrderLimits().allow("arx", orders(na=30, nb=1))


def test_a_path_moves_inside_the_limits_without_repetitions():
    path = [[orders(na=n, nb=n, nc=n)] for n in (1, 2, 3, 4, 5, 6)]
    moved = [each for (each,) in limits(plant=(3, 4), nk=(1, 1)).within("armax", path)]
    assert [each.na for each in moved] == [3, 3, 3, 4, 4, 4]
    assert len(set(moved)) == 6
    assert {each.nk for each in moved} == {(1,)}
    fixed = limits(plant=(3, 3), nb=(2, 2), nc=(1, 1), nk=(1, 1))
    assert len(list(fixed.within("armax", path))) == 1


def test_a_structure_without_an_order_has_no_limit_of_it():
    given = limits(plant=(2, 3), nc=(1, 2))
    assert given.allow("oe", orders(nb=4, nf=2))
    assert not given.allow("oe", orders(nb=4, nf=4))
    assert given.allow("fir", orders(nb=40))
    assert not given.allow("bj", orders(nb=2, nf=2, nd=1))


def test_each_input_has_limits_of_its_own():
    nb = {"hot": (1, 2)}
    given = OrderLimits(None, OrderRanges(nb=nb), ("hot", "cold"))
    assert given.allow("arx", orders(na=2, nb=(2, 9), nk=(1, 1)))
    assert not given.allow("arx", orders(na=2, nb=(3, 1), nk=(1, 1)))


def test_only_the_structure_that_is_given_may_be_chosen():
    assert limits("arx").allow("arx", orders(na=2, nb=2))
    assert not limits("arx").allow("armax", orders(na=2, nb=2, nc=2))
    assert not limits("arx").allow("ss", None)


def test_orders_follow_the_joint_order_within_their_limits():
    given = limits(names=("hot", "cold"), nb=(1, 3), nf={"cold": (0, 0)}, nc=(2, 2))
    sizes = (orders_of_size("bj", n, (1, 2))[1] for n in (1, 3, 5))
    followed = [str(given.clamped("bj", each)) for each in sizes]
    assert followed[0] == "BJ([1 1],2,2,[1 0],[1 2])"
    assert followed[1] == "BJ([3 3],2,2,[3 0],[1 2])"
    assert followed[2] == "BJ([3 3],2,2,[5 0],[1 2])"
    assert given.at_upper_ends(Orders("arx", nb=(2, 3), nk=(1, 1), na=4)) == ("nb of cold",)


def test_other_inputs_are_refused_by_their_key():
    orders = Orders("arx", na=1, nb=(1, 1))
    with pytest.raises(InputError, match=r"orders.nb: there is no input warm; name one of hot"):
        limits(names=("hot", "cold"), nb={"warm": (1, 1)}).clamped("arx", orders)
    with pytest.raises(InputError, match=r"delay.nk: there are 1 values and 2 inputs"):
        limits(names=("hot", "cold"), nk=((1, 1),)).clamped("arx", orders)
