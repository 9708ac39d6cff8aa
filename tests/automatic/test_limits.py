"""Limits of the orders that a configuration sets."""

from evopem.automatic.limits import OrderLimits
from evopem.models.structures import Orders


def orders(**given):
    return Orders(**given)


def test_without_limits_everything_is_allowed():
    path = [[orders(na=1, nb=1)], [orders(na=2, nb=2)]]
    assert list(OrderLimits().within("arx", path)) == path
    assert OrderLimits().allow("arx", orders(na=30, nb=1))


def test_a_path_moves_inside_the_limits_without_repetitions():
    limits = OrderLimits(joint=(3, 4), nk=(1, 1))
    path = [[orders(na=n, nb=n, nc=n)] for n in (1, 2, 3, 4, 5, 6)]
    moved = [each for (each,) in limits.within("armax", path)]
    assert [each.na for each in moved] == [3, 3, 3, 4, 4, 4]
    assert len(set(moved)) == 6
    assert {each.nk for each in moved} == {(1,)}
    fixed = OrderLimits(joint=(3, 3), nb=(2, 2), nc=(1, 1), nk=(1, 1))
    assert len(list(fixed.within("armax", path))) == 1


def test_a_structure_without_an_order_has_no_limit_of_it():
    limits = OrderLimits(joint=(2, 3), nc=(1, 2))
    assert limits.allow("oe", orders(nb=4, nf=2))
    assert not limits.allow("oe", orders(nb=4, nf=4))
    assert limits.allow("fir", orders(nb=40))
    assert not limits.allow("bj", orders(nb=2, nf=2, nd=1))


def test_only_the_structure_that_is_given_may_be_chosen():
    limits = OrderLimits(structure="arx")
    assert limits.allow("arx", orders(na=2, nb=2))
    assert not limits.allow("armax", orders(na=2, nb=2, nc=2))
