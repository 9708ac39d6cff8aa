"""The keys ``focus`` and ``constraints`` of a data set with several channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evopem.config.settings import is_pattern
from evopem.config.strict_yaml import Keys
from evopem.config.structures import is_fitted_for, is_polynomial
from evopem.errors import InputError

GAINS = ("static_gain", "static_gain_bounds")
# Constraints of one input that models with several do not have, and why.
_REFUSED = {
    "fixed_coefficients": "orders and delays of each input follow from the recording, and with them"
    " what a coefficient stands for",
    "priors": "they are for one input and one output",
}


def check_focus(own: Keys, source: str, place: str) -> None:
    """Refuse a focus that no form which is written is fitted for.

    Raises
    ------
    InputError
    """
    focus = own.get("focus")
    if focus is None:
        return
    if focus not in ("prediction", "simulation"):
        raise InputError(
            source,
            f"errors {focus} samples ahead are for one input and one output",
            "write prediction or simulation",
            f"{place}.focus",
        )
    if focus == "simulation" and own.get("input") == "none":
        raise InputError(
            source,
            "without an input there is nothing to simulate",
            "write prediction, or remove the key",
            f"{place}.focus",
        )
    form = own.get("form", own.get("structure"))
    white = focus == "prediction" and form in ("oe", "fir")  # then both are the same
    if form in (None, "state_space") or white or is_fitted_for(form, focus):
        return
    better = "ss_oe" if focus == "simulation" else "ss"
    if is_polynomial(form):
        better = "oe"
    key = "form" if "form" in own else "structure"
    raise InputError(
        source,
        f"{form} is fitted for {'prediction' if focus == 'simulation' else 'simulation'}",
        f"write {key}: {better}, or another focus",
        f"{place}.focus",
    )


def check_input_constraints(
    written: Keys, structure: str | None, inputs: Sequence[object], source: str, place: str
) -> None:
    """Refuse constraints that a model of several channels does not have.

    Raises
    ------
    InputError
    """
    constraints = written.get("constraints")
    if constraints is None:
        return
    place = f"{place}.constraints"
    form = written.get("form")
    if (structure is None or not is_polynomial(structure)) and form in (None, "ss_bj"):
        raise InputError(
            source,
            "what constraints mean depends on the structure: of ss_bj it is not said whether poles"
            " of the plant or of its noise model are meant",
            "write form: ss_oe or ss, or a polynomial structure such as oe",
            place,
        )
    for key, reason in _REFUSED.items():
        if constraints.get(key):
            raise InputError(
                source, f"several inputs do not have it: {reason}", "remove it", f"{place}.{key}"
            )
    if constraints.get("stability") == "free":
        raise InputError(
            source,
            "models with several inputs are stable",
            "remove the key, or identify one input alone",
            f"{place}.stability",
        )
    for key in GAINS:
        _check_names(constraints.get(key, {}), inputs, source, f"{place}.{key}")


def _check_names(given: Any, inputs: Sequence[object], source: str, place: str) -> None:
    if not isinstance(given, Mapping):
        raise InputError(
            source,
            "there are several inputs, each with a gain of its own",
            "write a mapping from their names, such as {hot: 2.0}",
            place,
        )
    named = [each for each in inputs if isinstance(each, str) and not is_pattern(each)]
    unknown = [name for name in given if name not in named]
    if unknown and len(named) == len(inputs):
        raise InputError(
            source, f"there is no input {unknown[0]}", f"name one of {', '.join(named)}", place
        )


def check_one_input(written: Keys, source: str, place: str) -> None:
    """Refuse gains by the names of inputs where there is one.

    Raises
    ------
    InputError
    """
    for key in GAINS:
        if isinstance(written.get("constraints", {}).get(key), Mapping):
            raise InputError(
                source,
                "a mapping from inputs belongs to a data set with several",
                "write the value alone",
                f"{place}.constraints.{key}",
            )
