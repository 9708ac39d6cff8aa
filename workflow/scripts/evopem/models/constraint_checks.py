"""Constraints that contradict each other or the structure, refused before any search."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from evopem.config.constraints import Constraints, Prior
from evopem.errors import InputError
from evopem.models.fixed_pole_checks import check_fixed_pole, refused
from evopem.models.structures import Orders

Focus = str | int


def check_fit(
    focus: Focus,
    constraints: Constraints | None,
    orders: Orders,
    sampling_rate: float,
    names: Sequence[str] = (),
) -> int | None:
    """Samples ahead; None for simulation where that differs from prediction.

    InputError when focus and constraints contradict each other or the orders.  ValueError when the
    focus is none of those known.
    """
    horizon = _horizon(focus, orders)
    if constraints is not None:
        check_constraints(constraints, orders, sampling_rate, names)
        if horizon is None:
            _check_simulation(constraints, orders)
    return horizon


def check_constraints(
    constraints: Constraints, orders: Orders, sampling_rate: float, names: Sequence[str] = ()
) -> None:
    """Refuse constraints that no model of these orders meets, or whose meaning is not clear.

    ``names`` are those of the inputs, by default 1, 2, ... of several.

    InputError naming the key of the constraints.
    """
    names = tuple(names) or tuple(str(place + 1) for place in range(orders.inputs))
    check_named_inputs(constraints, names)
    if orders.inputs > 1:
        _check_several_inputs(constraints, orders)
    for place, name in enumerate(names or ("",)):
        own = constraints.of_input(name)
        _check_path(own, orders.of_input(place), sampling_rate)


def check_named_inputs(constraints: Constraints, names: Sequence[str]) -> None:
    """Refuse a static gain of an input that there is not."""
    for key in ("static_gain", "static_gain_bounds"):
        given = getattr(constraints, key)
        unknown = [name for name in given if name not in names] if isinstance(given, dict) else []
        if unknown:
            raise refused(key, f"there is no input {unknown[0]}", f"name one of {', '.join(names)}")


def _check_several_inputs(constraints: Constraints, orders: Orders) -> None:
    """Refuse what does not say which of several inputs it is of."""
    for key in ("static_gain", "static_gain_bounds"):
        if not isinstance(getattr(constraints, key), dict | None):
            raise refused(
                key,
                "there are several inputs, each with a gain of its own",
                "write a mapping from their names, such as {hot: 2.0}",
            )
    if constraints.fixed_poles and any(orders.nf):
        raise refused(
            "fixed_poles",
            "it does not say which of the denominators F_i has the poles",
            "use a structure with A alone, such as armax",
        )
    named = [(f"fixed_coefficients.{name}", name) for name in constraints.fixed_coefficients]
    named += [(f"priors[{k}]", prior.quantity) for k, prior in enumerate(constraints.priors)]
    for key, name in named:
        if name == "static_gain" or (name[:1] in ("b", "f") and name[1:].isdecimal()):
            raise refused(
                key,
                f"each of several inputs has {name}",
                "leave it out, or identify one input alone",
            )


def _check_path(constraints: Constraints, orders: Orders, sampling_rate: float) -> None:
    """Refuse constraints of the path from one input, or of a model without input."""
    _check_words(constraints, orders)
    _check_poles(constraints, orders, sampling_rate)
    _check_gain(constraints, orders)
    _check_coefficients(constraints, orders)
    for number, pole in enumerate(constraints.fixed_poles):
        check_fixed_pole(pole, f"fixed_poles[{number}]", constraints, orders, sampling_rate)
    if sum(2 if pole.real is None else 1 for pole in constraints.fixed_poles) > (
        orders.single.nf or orders.na
    ):
        name = "nf" if orders.single.nf else "na"
        raise refused(
            "fixed_poles",
            f"there are more of them than {name} = {orders.single.nf or orders.na}",
            f"raise {name}, or fix fewer poles",
        )
    for number, prior in enumerate(constraints.priors):
        _check_prior(prior, f"priors[{number}]", constraints, orders, sampling_rate)


def _horizon(focus: Focus, orders: Orders) -> int | None:
    whole = isinstance(focus, int) and not isinstance(focus, bool) and focus >= 1
    if not whole and focus not in ("prediction", "simulation"):
        raise ValueError(
            f'focus must be "prediction", "simulation" or a number of samples, not {focus!r}'
        )
    if focus == "simulation" and orders.inputs == 0:
        raise InputError(
            "focus",
            "a model without input has nothing to simulate",
            "use prediction, or a number of samples",
        )
    if orders.na == 0 and orders.nc == 0 and orders.nd == 0:
        # The noise is white: predictions are simulations, whatever the horizon.
        return 1
    if focus == "simulation":
        return None
    return int(focus) if whole else 1


def _check_simulation(constraints: Constraints, orders: Orders) -> None:
    """Refuse what a fit for simulation, in two stages, cannot meet."""
    if constraints.stability == "free":
        raise refused(
            "stability",
            "simulation errors need a stable plant",
            "fit for prediction, or fix the pole that is not stable",
        )
    if not (orders.na and any(orders.nf)):
        return
    named = [f"fixed_coefficients.{name}" for name in constraints.fixed_coefficients]
    quantities = [prior.quantity for prior in constraints.priors]
    named += [f"priors[{i}]" for i, name in enumerate(quantities) if name[1:].isdecimal()]
    letters = [name[0] for name in constraints.fixed_coefficients]
    letters += [name[0] for name in quantities if name[1:].isdecimal()]
    for key, letter in zip(named, letters, strict=True):
        if letter in "af":
            raise refused(
                key,
                "a fit for simulation determines only the product of A and F",
                "leave it out, or use a structure with one of the two",
            )


def coefficient_index(name: str, orders: Orders) -> tuple[str, int] | None:
    """Polynomial and index, from 0, of a coefficient such as ``a1`` or ``b0``; None for none."""
    letter, digits = name[:1], name[1:]
    if letter not in "abcdf" or letter == "" or not digits.isdecimal():
        return None
    index = int(digits) - (letter != "b")
    count = orders.part(letter).stop - orders.part(letter).start
    return (letter, index) if 0 <= index < count else None


def _check_words(constraints: Constraints, orders: Orders) -> None:
    if constraints.stability not in ("required", "free"):
        raise refused("stability", f"is {constraints.stability!r}", 'use "required" or "free"')
    if constraints.real_poles not in ("any", "positive", "none"):
        raise refused(
            "real_poles", f"is {constraints.real_poles!r}", 'use "any", "positive" or "none"'
        )
    plant = orders.single.nb > 0 and (orders.na > 0 or orders.single.nf > 0)
    for key, given in _of_plant(constraints):
        if given and not plant:
            raise refused(
                key, f"a model of orders {orders} has no plant with poles", "leave it out"
            )
    if constraints.stability == "free" and orders.na == 0 and plant:
        raise refused(
            "stability",
            "the poles of F must be stable, because the predictor filters through 1/F",
            'use a structure with A, such as "armax", or fix the pole that is not stable',
        )
    for key, value in _numbers(constraints):
        if not math.isfinite(value):
            raise refused(key, f"{value} is not a finite number", "give a number")


def _of_plant(constraints: Constraints) -> Iterator[tuple[str, bool]]:
    yield "max_pole_radius", constraints.max_pole_radius is not None
    yield "min_damping_ratio", constraints.min_damping_ratio is not None
    yield "frequency_band", constraints.frequency_band is not None
    yield "forbidden_bands", bool(constraints.forbidden_bands)
    yield "real_poles", constraints.real_poles != "any"
    yield "fixed_poles", bool(constraints.fixed_poles)


def _numbers(constraints: Constraints) -> Iterator[tuple[str, float]]:
    for key in ("max_pole_radius", "min_damping_ratio"):
        if (value := getattr(constraints, key)) is not None:
            yield key, value
    if (gain := constraints.gain_of()) is not None:
        yield "static_gain", gain
    for value in constraints.frequency_band or ():
        yield "frequency_band", value
    for band in constraints.forbidden_bands:
        for value in band:
            yield "forbidden_bands", value
    for bound in constraints.gain_bounds_of() or ():
        if bound is not None:
            yield "static_gain_bounds", bound
    for name, value in constraints.fixed_coefficients.items():
        yield f"fixed_coefficients.{name}", value


def _check_poles(constraints: Constraints, orders: Orders, sampling_rate: float) -> None:
    radius, damping = constraints.max_pole_radius, constraints.min_damping_ratio
    if radius is not None and radius <= 0.0:
        raise refused("max_pole_radius", f"{radius} is not positive", "give a radius above 0")
    if radius is not None and radius >= 1.0 and constraints.stability == "required":
        raise refused(
            "max_pole_radius",
            f"{radius} allows poles that are not stable, and stability is required",
            'give a radius below 1, or set stability to "free"',
        )
    if damping is not None and not 0.0 <= damping < 1.0:
        raise refused(
            "min_damping_ratio", f"{damping} is not a damping ratio", "give one from 0 to below 1"
        )
    nyquist = sampling_rate / 2.0
    bands = [("frequency_band", constraints.frequency_band)] if constraints.frequency_band else []
    for key, band in [*bands, *(("forbidden_bands", b) for b in constraints.forbidden_bands)]:
        lower, upper = band or (0.0, 0.0)
        if not 0.0 <= lower < upper:
            raise refused(key, f"{lower} to {upper} Hz is no band", "give lower below upper")
        if lower >= nyquist:
            raise refused(
                key,
                f"{lower} to {upper} Hz lies above half the sampling rate, {nyquist} Hz",
                "give frequencies in Hz",
            )
    odd = (orders.single.nf or orders.na) - sum(
        2 if pole.real is None else 1 for pole in constraints.fixed_poles
    )
    if constraints.real_poles == "none" and (odd % 2 or (orders.single.nf and orders.na % 2)):
        raise refused(
            "real_poles",
            "a plant with an odd number of free poles has a real one",
            "use even orders",
        )
    if constraints.of_free_poles:
        for name in constraints.fixed_coefficients:
            if name[:1] in ("a", "f"):
                raise refused(
                    f"fixed_coefficients.{name}",
                    "coefficients of A and F cannot be fixed while the positions of poles are "
                    "restricted",
                    "leave out one of the two",
                )


def _check_gain(constraints: Constraints, orders: Orders) -> None:
    bounds = constraints.gain_bounds_of()
    given = [
        key
        for key in ("static_gain", "static_gain_bounds")
        if getattr(constraints, key) is not None
    ]
    if not given:
        return
    if len(given) == 2:
        raise refused("static_gain_bounds", "the static gain is given already", "leave out one")
    if orders.single.nb == 0:
        raise refused(given[0], "a model without input has no static gain", "leave it out")
    if bounds is not None:
        lower, upper = bounds
        if lower is None and upper is None:
            raise refused(given[0], "there is neither a lower nor an upper bound", "give one")
        if lower is not None and upper is not None and lower > upper:
            raise refused(
                given[0], f"the lower bound {lower} exceeds the upper one {upper}", "swap"
            )
    if any(pole.real == 1.0 for pole in constraints.fixed_poles):
        raise refused(given[0], "a plant with a fixed pole at 1 has no static gain", "leave it out")
    if all(f"b{index}" in constraints.fixed_coefficients for index in range(orders.single.nb)):
        raise refused(given[0], "all coefficients of B are fixed", "leave one of them free")


def _check_coefficients(constraints: Constraints, orders: Orders) -> None:
    for name, value in constraints.fixed_coefficients.items():
        found = coefficient_index(name, orders)
        if found is None:
            raise refused(
                f"fixed_coefficients.{name}",
                f"a model of orders {orders} has no such coefficient",
                "name one such as a1, b0 or f2; b0 is the first of B",
            )
        letter, index = found
        held = letter in "af" and constraints.fixed_poles
        if letter == "b" or held or (letter == "a" and constraints.stability == "free"):
            continue
        order = getattr(orders.single, f"n{letter}")
        # A sum of products of roots, each within the unit circle.
        if abs(value) >= math.comb(order, index + 1):
            raise refused(
                f"fixed_coefficients.{name}",
                f"{value} is more than any polynomial of degree {order} with roots inside the unit "
                "circle has",
                "check the value",
            )


def _check_prior(
    prior: Prior,
    key: str,
    constraints: Constraints,
    orders: Orders,
    sampling_rate: float,
) -> None:
    if not (prior.standard_deviation > 0.0 and math.isfinite(prior.standard_deviation)):
        raise refused(key, "its standard deviation is not positive", "give one above 0")
    if not math.isfinite(prior.mean):
        raise refused(key, "its mean is not a finite number", "give a number")
    if prior.quantity == "static_gain":
        if orders.single.nb == 0:
            raise refused(key, "a model without input has no static gain", "leave it out")
        if constraints.static_gain is not None:
            raise refused(key, "the static gain is given already", "leave out one of the two")
        if any(pole.real == 1.0 for pole in constraints.fixed_poles):
            raise refused(key, "a plant with a fixed pole at 1 has no static gain", "leave it out")
    elif prior.quantity in ("frequency", "damping"):
        if max(orders.na, orders.single.nf) < 2 or orders.single.nb == 0:
            raise refused(key, f"a model of orders {orders} has no mode", "leave it out")
        if prior.quantity == "damping" and prior.mode_hz is None:
            raise refused(key, "it does not say which mode", "give mode_hz, in Hz")
        near = prior.mean if prior.mode_hz is None else prior.mode_hz
        if not 0.0 < near < sampling_rate / 2.0:
            raise refused(
                key,
                f"{near} Hz does not lie between 0 and half the sampling rate",
                "give a frequency in Hz",
            )
    elif coefficient_index(prior.quantity, orders) is None:
        raise refused(
            key,
            f"a model of orders {orders} has no {prior.quantity!r}",
            "name a coefficient such as a1 or b0, static_gain, frequency or damping",
        )
    elif prior.quantity in constraints.fixed_coefficients:
        raise refused(key, f"{prior.quantity} is fixed already", "leave out one of the two")
