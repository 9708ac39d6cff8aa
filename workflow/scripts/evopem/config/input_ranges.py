"""Ranges of orders and delays of which each input has its own: checked, and in both forms.

``nb: 2`` and ``nb: [2, 4]`` hold for all inputs, ``nb: [[2, 4], [1, 1]]`` for each in their order,
and ``nb: {hot: [2, 4], cold: 1}`` for those that are named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evopem.config.settings import InputRanges, Range
from evopem.config.strict_yaml import Keys
from evopem.errors import InputError

OF_INPUTS = (("delay", "nk"), ("orders", "nb"), ("orders", "nf"))
"""Groups and names of the keys of which each input has its own."""


def input_ranges_of(written: Any) -> InputRanges:
    """The ranges of a checked value."""
    if isinstance(written, Mapping):
        return InputRanges(by_name={name: _range(each) for name, each in written.items()})
    if _is_by_input(written):
        return InputRanges(in_order=tuple(map(_range, written)))
    return InputRanges() if written is None else InputRanges(_range(written))


def input_range_keys(ranges: InputRanges) -> Any:
    """What stands under the key that gives these ranges; None where none are given."""
    if ranges.all:
        return list(ranges.all)
    in_order = list(map(list, ranges.in_order))
    return in_order or {name: list(each) for name, each in ranges.by_name.items()} or None


def check_input_ranges(keys: Keys, inputs: Sequence[object], source: str, place: str) -> None:
    """Refuse ranges of inputs that are no ranges, or of other inputs.

    Parameters
    ----------
    keys : mapping
        Keys of a data set with several channels.
    inputs : sequence of int or str
        Its references; where some are not names, what is given by name is compared with the
        recording.
    source, place : str
        The configuration and the key of the data set, for an error to name.

    Raises
    ------
    InputError
    """
    by_name = all(isinstance(each, str) for each in inputs)
    known = not any(isinstance(each, str) and "*" in each for each in inputs)
    for group, name in OF_INPUTS:
        written, at = keys.get(group, {}).get(name), f"{place}.{group}.{name}"
        _check_form(written, source, at)
        ranges = input_ranges_of(written)
        for limits in ranges.given:
            check_ends(limits, source, at)
        if known and (by_name or not ranges.by_name):
            try:
                ranges.of_inputs(tuple(map(str, inputs)))
            except InputError as error:
                raise InputError(source, error.problem, error.remedy, at) from None


def _check_form(written: Any, source: str, place: str) -> None:
    """Refuse lists that are neither one range nor ranges of inputs."""
    if not isinstance(written, list):
        return
    if _is_by_input(written) and not all(isinstance(each, list) for each in written):
        raise InputError(
            source,
            f"{written} has numbers beside ranges",
            "write a number n as the range [n, n]",
            place,
        )
    if not _is_by_input(written) and not _is_pair(written):
        raise InputError(
            source,
            f"{written} is no range, which has a lower and an upper end",
            "for one number of each input write ranges, such as [[2, 2], [1, 1]], or a mapping from"
            " their names, such as {hot: 2, cold: 1}",
            place,
        )


def check_one_range(written: Keys, source: str, place: str) -> None:
    """Refuse ranges by input where there is one.

    Raises
    ------
    InputError
    """
    for group, name in OF_INPUTS:
        value = written.get(group, {}).get(name)
        if isinstance(value, Mapping) or (isinstance(value, list) and not _is_pair(value)):
            raise InputError(
                source,
                "one input has one range of it",
                "give two whole numbers, [lower, upper], or one of them",
                f"{place}.{group}.{name}",
            )


def check_ends(limits: Range, source: str, place: str) -> None:
    """Refuse a range whose ends are exchanged.

    Raises
    ------
    InputError
    """
    if limits[0] > limits[1]:
        raise InputError(
            source,
            f"the lower end of {list(limits)} is above the upper one",
            f"write [{limits[1]}, {limits[0]}]",
            place,
        )


def ranges_of_one_input(defaults: Keys) -> dict[str, Any]:
    """What is left of ``defaults:`` without ranges by input, for data sets with one."""
    own = dict(defaults)
    for group, name in OF_INPUTS:
        value = own.get(group, {}).get(name)
        if isinstance(value, Mapping) or _is_by_input(value):
            own[group] = {key: each for key, each in own[group].items() if key != name}
    return own


def _is_by_input(written: Any) -> bool:
    return isinstance(written, list | tuple) and any(
        isinstance(each, list | tuple) for each in written
    )


def _is_pair(written: Sequence[Any]) -> bool:
    return len(written) == 2 and not _is_by_input(written)


def _range(given: Any) -> Range:
    return (given[0], given[1]) if isinstance(given, list | tuple) else (given, given)
