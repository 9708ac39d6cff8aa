"""Constraints that contradict each other or the structure, refused before any search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from evopem.config.constraints import (
    Constraints,
    FixedPole,
    Prior,
    Rule,
    gains_of_other_inputs,
    of_no_input,
)
from evopem.config.structures import samples_ahead
from evopem.errors import InputError
from evopem.models.structures import Orders

Focus = str | int

LEAVE_OUT, LEAVE_ONE, CHANGE = "leave it out", "leave out one of the two", "change one of the two"


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
            refuse(_of_simulation(constraints, orders))
    return horizon


def check_constraints(
    constraints: Constraints, orders: Orders, sampling_rate: float, names: Sequence[str] = ()
) -> None:
    """Refuse constraints that no model of these orders meets, or whose meaning is not clear.

    ``names`` are those of the inputs, by default 1, 2, ... of several.  InputError names the key.
    """
    names = tuple(names) or tuple(str(place + 1) for place in range(orders.inputs))
    refuse(gains_of_other_inputs(constraints, names))
    if orders.inputs > 1:
        refuse(_of_several_inputs(constraints, orders))
    for place, name in enumerate(names or ("",)):
        own, path = constraints.of_input(name), orders.of_input(place)
        refuse(_of_path(own, path, sampling_rate))


def refuse(rules: Iterable[Rule]) -> None:
    """InputError of the first rule that holds; those behind it are not looked at."""
    for holds, key, problem, remedy in rules:
        if holds:
            raise InputError("constraints", problem, remedy, key)


def coefficient_index(name: str, orders: Orders) -> tuple[str, int] | None:
    """Polynomial and index, from 0, of a coefficient such as ``a1`` or ``b0``; None for none."""
    letter, digits = name[:1], name[1:]
    if letter not in "abcdf" or letter == "" or not digits.isdecimal():
        return None
    index = int(digits) - (letter != "b")
    count = orders.part(letter).stop - orders.part(letter).start
    return (letter, index) if 0 <= index < count else None


def _horizon(focus: Focus, orders: Orders) -> int | None:
    ahead = samples_ahead(focus)
    if ahead is None and orders.inputs == 0:
        problem = "a model without input has nothing to simulate"
        raise InputError("focus", problem, "use prediction, or a number of samples")
    if orders.na == 0 and orders.nc == 0 and orders.nd == 0:
        # The noise is white: predictions are simulations, whatever the horizon.
        return 1
    return ahead


def _of_several_inputs(constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    yield (
        bool(constraints.fixed_poles) and any(orders.nf),
        "fixed_poles",
        "it does not say which of the denominators F_i has the poles",
        "use a structure with A alone, such as armax",
    )
    yield from of_no_input(constraints)


def _of_simulation(constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    """What a fit for simulation, in two stages, cannot meet."""
    yield (
        constraints.stability == "free",
        "stability",
        "simulation errors need a stable plant",
        "fit for prediction, or fix the pole that is not stable",
    )
    for key, name in constraints.of_coefficients if orders.na and any(orders.nf) else ():
        yield (
            name[:1] in ("a", "f") and name[1:].isdecimal(),
            key,
            "a fit for simulation determines only the product of A and F",
            "leave it out, or use a structure with one of the two",
        )


def _of_path(constraints: Constraints, orders: Orders, sampling_rate: float) -> Iterator[Rule]:
    """Constraints of the path from one input, or of a model without input."""
    yield from _of_words(constraints, orders)
    yield from _of_poles(constraints, orders, sampling_rate)
    yield from _of_gain(constraints, orders)
    yield from _of_coefficients(constraints, orders)
    for number, pole in enumerate(constraints.fixed_poles):
        key = f"fixed_poles[{number}]"
        yield from _of_fixed_pole(pole, key, constraints, orders, sampling_rate)
    name, order = ("nf", orders.single.nf) if orders.single.nf else ("na", orders.na)
    yield (
        _fixed(constraints) > order,
        "fixed_poles",
        f"there are more of them than {name} = {order}",
        f"raise {name}, or fix fewer poles",
    )
    for number, prior in enumerate(constraints.priors):
        yield from _of_prior(prior, f"priors[{number}]", constraints, orders, sampling_rate)


def _fixed(constraints: Constraints) -> int:
    """Number of fixed poles."""
    return sum(2 if pole.real is None else 1 for pole in constraints.fixed_poles)


def _of_words(constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    for key, words in (
        ("stability", ("required", "free")),
        ("real_poles", ("any", "positive", "none")),
    ):
        word = getattr(constraints, key)
        quoted = [f'"{each}"' for each in words]
        choice = f"use {', '.join(quoted[:-1])} or {quoted[-1]}"
        yield word not in words, key, f"is {word!r}", choice
    plant = orders.single.nb > 0 and (orders.na > 0 or orders.single.nf > 0)
    for key in (
        *("max_pole_radius", "min_damping_ratio", "frequency_band", "forbidden_bands"),
        *("real_poles", "fixed_poles"),
    ):
        given = getattr(constraints, key) not in (None, (), [], "any")
        problem = f"a model of orders {orders} has no plant with poles"
        yield given and not plant, key, problem, LEAVE_OUT
    yield (
        constraints.stability == "free" and orders.na == 0 and plant,
        "stability",
        "the poles of F must be stable, because the predictor filters through 1/F",
        'use a structure with A, such as "armax", or fix the pole that is not stable',
    )
    numbers: list[tuple[str, float | None]] = [
        ("max_pole_radius", constraints.max_pole_radius),
        ("min_damping_ratio", constraints.min_damping_ratio),
        ("static_gain", constraints.gain_of()),
        *(("frequency_band", value) for value in constraints.frequency_band or ()),
        *(("forbidden_bands", value) for band in constraints.forbidden_bands for value in band),
        *(("static_gain_bounds", value) for value in constraints.gain_bounds_of() or ()),
        *((f"fixed_coefficients.{name}", x) for name, x in constraints.fixed_coefficients.items()),
    ]
    for key, value in numbers:
        infinite = value is not None and not math.isfinite(value)
        yield infinite, key, f"{value} is not a finite number", "give a number"


def _of_poles(constraints: Constraints, orders: Orders, sampling_rate: float) -> Iterator[Rule]:
    radius, damping = constraints.max_pole_radius, constraints.min_damping_ratio
    if radius is not None:
        positive = "give a radius above 0"
        yield radius <= 0.0, "max_pole_radius", f"{radius} is not positive", positive
        yield (
            radius >= 1.0 and constraints.stability == "required",
            "max_pole_radius",
            f"{radius} allows poles that are not stable, and stability is required",
            'give a radius below 1, or set stability to "free"',
        )
    if damping is not None:
        problem, remedy = f"{damping} is not a damping ratio", "give one from 0 to below 1"
        yield not 0.0 <= damping < 1.0, "min_damping_ratio", problem, remedy
    nyquist = sampling_rate / 2.0
    bands = [("frequency_band", constraints.frequency_band)] if constraints.frequency_band else []
    for key, band in [*bands, *(("forbidden_bands", b) for b in constraints.forbidden_bands)]:
        lower, upper = band or (0.0, 0.0)
        text = f"{lower} to {upper} Hz"
        yield not 0.0 <= lower < upper, key, f"{text} is no band", "give lower below upper"
        above = f"{text} lies above half the sampling rate, {nyquist} Hz"
        yield lower >= nyquist, key, above, "give frequencies in Hz"
    odd = (orders.single.nf or orders.na) - _fixed(constraints)
    yield (
        constraints.real_poles == "none" and bool(odd % 2 or (orders.single.nf and orders.na % 2)),
        "real_poles",
        "a plant with an odd number of free poles has a real one",
        "use even orders",
    )
    for name in constraints.fixed_coefficients:
        yield (
            constraints.of_free_poles and name[:1] in ("a", "f"),
            f"fixed_coefficients.{name}",
            "coefficients of A and F cannot be fixed while the positions of poles are restricted",
            LEAVE_ONE,
        )


def _without_gain(key: str, constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    """What has no static gain."""
    yield orders.single.nb == 0, key, "a model without input has no static gain", LEAVE_OUT
    integrator = any(pole.real == 1.0 for pole in constraints.fixed_poles)
    yield integrator, key, "a plant with a fixed pole at 1 has no static gain", LEAVE_OUT


def _of_gain(constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    keys = ("static_gain", "static_gain_bounds")
    given = [key for key in keys if getattr(constraints, key) is not None]
    if not given:
        return
    key = given[0]
    yield len(given) == 2, keys[1], "the static gain is given already", "leave out one"
    yield from _without_gain(key, constraints, orders)
    bounds = constraints.gain_bounds_of()
    if bounds is not None:
        lower, upper = bounds
        neither = lower is None and upper is None
        yield neither, key, "there is neither a lower nor an upper bound", "give one"
        crossed = lower is not None and upper is not None and lower > upper
        yield crossed, key, f"the lower bound {lower} exceeds the upper one {upper}", "swap"
    fixed = all(f"b{index}" in constraints.fixed_coefficients for index in range(orders.single.nb))
    yield fixed, key, "all coefficients of B are fixed", "leave one of them free"


def _of_coefficients(constraints: Constraints, orders: Orders) -> Iterator[Rule]:
    for name, value in constraints.fixed_coefficients.items():
        found, key = coefficient_index(name, orders), f"fixed_coefficients.{name}"
        yield (
            found is None,
            key,
            f"a model of orders {orders} has no such coefficient",
            "name one such as a1, b0 or f2; b0 is the first of B",
        )
        letter, index = found or ("", 0)
        held = letter in "af" and constraints.fixed_poles
        if letter == "b" or held or (letter == "a" and constraints.stability == "free"):
            continue
        order = getattr(orders.single, f"n{letter}")
        # A sum of products of roots, each within the unit circle.
        yield (
            abs(value) >= math.comb(order, index + 1),
            key,
            f"{value} is more than any polynomial of degree {order} with roots inside the unit"
            " circle has",
            "check the value",
        )


def _of_fixed_pole(
    pole: FixedPole, key: str, constraints: Constraints, orders: Orders, sampling_rate: float
) -> Iterator[Rule]:
    """A fixed pole that is none, or that other constraints or the structure forbid."""
    of_pair = (pole.frequency_hz, pole.damping_ratio)
    yield (
        (pole.real is None) == (None in of_pair)
        or (pole.real is not None and of_pair != (None, None)),
        key,
        "it is neither a real pole nor a pair",
        "give real, or frequency_hz and damping_ratio",
    )
    frequency, damping = pole.frequency_hz or 0.0, pole.damping_ratio or 0.0
    if pole.real is not None:
        radius = abs(pole.real)
        yield not math.isfinite(radius), key, f"{pole.real} is not a finite number", "give a number"
        negative = pole.real <= 0.0 and constraints.real_poles == "positive"
        yield negative, key, "real poles must be positive", LEAVE_ONE
        yield constraints.real_poles == "none", key, "real poles are forbidden", LEAVE_ONE
    else:
        turn = 2.0 * math.pi * frequency / sampling_rate
        yield (
            not (0.0 <= damping < 1.0 and 0.0 < turn * math.sqrt(1.0 - damping**2) < math.pi),
            key,
            f"{frequency} Hz with a damping ratio of {damping} is no mode below half the"
            f" sampling rate, {sampling_rate / 2.0} Hz",
            "give a frequency in Hz and a damping ratio from 0 to below 1",
        )
        radius = math.exp(-turn * damping)
    yield (
        orders.single.nf > 0 and radius > 1.0,
        key,
        "a pole of F outside the unit circle makes the predictor unstable",
        'use a structure with A, such as "armax"',
    )
    limit = constraints.max_pole_radius
    beyond = limit is not None and radius > limit
    yield beyond, key, f"its radius {radius:.6g} exceeds max_pole_radius {limit}", CHANGE
    if pole.real is None:
        least, band = constraints.min_damping_ratio, constraints.frequency_band
        below = least is not None and damping < least
        problem = f"its damping ratio {damping} is below min_damping_ratio {least}"
        yield below, key, problem, CHANGE
        outside = band is not None and not band[0] <= frequency <= band[1]
        yield outside, key, "it lies outside frequency_band", CHANGE
        forbidden = any(lower < frequency < upper for lower, upper in constraints.forbidden_bands)
        yield forbidden, key, "it lies in a forbidden band", CHANGE


def _of_prior(
    prior: Prior, key: str, constraints: Constraints, orders: Orders, sampling_rate: float
) -> Iterator[Rule]:
    deviation, quantity = prior.standard_deviation, prior.quantity
    positive = deviation > 0.0 and math.isfinite(deviation)
    yield not positive, key, "its standard deviation is not positive", "give one above 0"
    yield not math.isfinite(prior.mean), key, "its mean is not a finite number", "give a number"
    alike = [each for each in constraints.priors if each.quantity == quantity]
    alike = [each for each in alike if each is not prior and each.mode_hz == prior.mode_hz]
    yield bool(alike), key, f"there are two priors of its {quantity}", LEAVE_ONE
    if quantity == "static_gain":
        yield from _without_gain(key, constraints, orders)
        given = constraints.static_gain is not None
        yield given, key, "the static gain is given already", LEAVE_ONE
    elif quantity in ("frequency", "damping"):
        none = max(orders.na, orders.single.nf) < 2 or orders.single.nb == 0
        yield none, key, f"a model of orders {orders} has no mode", LEAVE_OUT
        unnamed = quantity == "damping" and prior.mode_hz is None
        yield unnamed, key, "it does not say which mode", "give mode_hz, in Hz"
        near = prior.mean if prior.mode_hz is None else prior.mode_hz
        yield (
            not 0.0 < near < sampling_rate / 2.0,
            key,
            f"{near} Hz does not lie between 0 and half the sampling rate",
            "give a frequency in Hz",
        )
        yield from _of_mean(prior, key, constraints, sampling_rate)
    else:
        yield (
            coefficient_index(quantity, orders) is None,
            key,
            f"a model of orders {orders} has no {quantity!r}",
            "name a coefficient such as a1 or b0, static_gain, frequency or damping",
        )
        fixed = quantity in constraints.fixed_coefficients
        yield fixed, key, f"{quantity} is fixed already", LEAVE_ONE


def _of_mean(
    prior: Prior, key: str, constraints: Constraints, sampling_rate: float
) -> Iterator[Rule]:
    """The mean of a frequency or damping ratio that no mode within the constraints has."""
    mean, band = prior.mean, constraints.frequency_band
    if prior.quantity == "damping":
        lowest = -1.0 if constraints.stability == "free" else 0.0
        problem = f"{mean} is no damping ratio of a mode of a stable plant"
        yield not lowest <= mean < 1.0, key, problem, "give one from 0 to below 1"
        if (least := constraints.min_damping_ratio or lowest) > mean:
            yield True, key, f"{mean} is below min_damping_ratio, {least}", CHANGE
        return
    problem = f"{mean} Hz does not lie between 0 and half the sampling rate"
    yield not 0.0 < mean < sampling_rate / 2.0, key, problem, "give a frequency in Hz"
    if band is not None:
        yield not band[0] <= mean <= band[1], key, f"{mean} Hz lies outside frequency_band", CHANGE
    for lower, upper in constraints.forbidden_bands:
        yield lower < mean < upper, key, f"{mean} Hz lies in a forbidden band", CHANGE
