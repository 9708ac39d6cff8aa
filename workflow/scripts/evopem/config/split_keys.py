"""Checks of the keys under ``split:``, of one channel and of several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.values import ALL_SAMPLES
from evopem.errors import InputError


def check_fractions(split: Mapping[str, Any], source: str, place: str) -> None:
    """Refuse a number of samples that is neither whole nor a fraction of all.

    Parameters
    ----------
    split : mapping of str to Any
        The keys, those that are not written with their built-in values.
    source, place : str
        The file and the data set, for an error to name.

    Raises
    ------
    InputError
    """
    for key, value in split.items():
        if isinstance(value, float) and value > 1:
            raise InputError(
                source,
                f"{value} is neither a whole number nor a fraction",
                "give a whole number of samples or a fraction between 0 and 1",
                f"{place}.split.{key}",
            )


def check_something_left(
    estimation: float, has_validation_file: bool, source: str, place: str
) -> None:
    """Refuse to estimate on all samples of a recording that is also to be validated on.

    Raises
    ------
    InputError
    """
    takes_all = isinstance(estimation, float) and estimation == ALL_SAMPLES
    if takes_all and not has_validation_file:
        raise InputError(
            source,
            f"{estimation} takes all samples, so none are left to validate on",
            "give a smaller fraction such as 0.8, or a validation_file",
            f"{place}.split.estimation",
        )
