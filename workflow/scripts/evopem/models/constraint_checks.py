"""Constraints that contradict each other or the structure, refused before any search."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import NoReturn

from evopem.config.constraints import (
    Constraints,
    FixedPole,
    Prior,
    Rule,
    gains_of_other_inputs,
    of_no_input,
)
from evopem.config.schema import checked, normalized
from evopem.config.structures import samples_ahead
from evopem.errors import InputError
from evopem.models.orders import Orders

Focus = str | int
GAINS = ("static_gain", "static_gain_bounds")
LEAVE_OUT, LEAVE_ONE, CHANGE = "leave it out", "leave out one of the two", "change one of the two"
IN_HZ, RATIO = "give a frequency in Hz", "give one from 0 to below 1"


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
    horizon = samples_ahead(focus)
    if horizon is None and orders.inputs == 0:
        problem = "a model without input has nothing to simulate"
        raise InputError("focus", problem, "use prediction, or a number of samples")
    if orders.na == 0 and orders.nc == 0 and orders.nd == 0:
        horizon = 1  # the noise is white: predictions are simulations, whatever the horizon
    if constraints is not None:
        check_constraints(constraints, orders, sampling_rate, names)
        if horizon is None:
            _check_simulation(constraints, orders)
    return horizon


def in_plain_numbers(constraints: Constraints) -> Constraints:
    """Constraints as a configuration has them, whose numbers are not those of numpy."""
    from evopem.config.keys import ANALYSIS  # which takes a while, and few models have constraints

    given = {key: value for key, value in asdict(constraints).items() if value is not None}
    types = ANALYSIS["constraints"].__origin__
    return Constraints(**checked(types, normalized(given, "constraints"), "constraints"))


def check_constraints(
    constraints: Constraints, orders: Orders, sampling_rate: float, names: Sequence[str] = ()
) -> None:
    """Refuse constraints that no model of these orders meets, or whose meaning is not clear.

    ``names`` are those of the inputs, by default 1, 2, ... of several.  InputError names the key.
    """
    names = tuple(names) or tuple(str(place + 1) for place in range(orders.inputs))
    refuse(gains_of_other_inputs(constraints, names))
    if orders.inputs > 1:
        if constraints.fixed_poles and any(orders.nf):
            problem = "it does not say which of the denominators F_i has the poles"
            _refuse("fixed_poles", problem, "use a structure with A alone, such as armax")
        refuse(of_no_input(constraints))
    for place, name in enumerate(names or ("",)):
        of_input, path = constraints.of_input(name), orders.of_input(place)
        _check_stability(of_input, path)
        _check_poles(of_input, path, sampling_rate)
        _check_gain(of_input, path)
        _check_coefficients(of_input, path)
        _check_fixed_poles(of_input, path, sampling_rate)
        for number, prior in enumerate(of_input.priors):
            _check_prior(prior, f"priors[{number}]", of_input, path, sampling_rate)


def refuse(rules: Iterable[Rule]) -> None:
    """InputError of the first rule that holds; those behind it are not looked at."""
    for holds, key, problem, remedy in rules:
        if holds:
            _refuse(key, problem, remedy)


def coefficient_index(name: str, orders: Orders) -> tuple[str, int] | None:
    """Polynomial and index, from 0, of a coefficient such as ``a1`` or ``b0``; None for none."""
    if not _is_of(name, "abcdf"):
        return None
    letter, index = name[0], int(name[1:]) - (name[0] != "b")
    count = orders.part(letter).stop - orders.part(letter).start
    return (letter, index) if 0 <= index < count else None


def _refuse(key: str, problem: str, remedy: str) -> NoReturn:
    raise InputError("constraints", problem, remedy, key)


def _is_of(name: str, letters: str) -> bool:
    """Whether a name is that of a coefficient of some polynomials, such as a1."""
    return name[:1] != "" and name[:1] in letters and name[1:].isdecimal()


def _check_simulation(constraints: Constraints, orders: Orders) -> None:
    """What a fit for simulation, in two stages, cannot meet."""
    if constraints.stability == "free":
        remedy = "fit for prediction, or fix the pole that is not stable"
        _refuse("stability", "simulation errors need a stable plant", remedy)
    for key, name in constraints.of_coefficients if orders.na and any(orders.nf) else ():
        if _is_of(name, "af"):
            problem = "a fit for simulation determines only the product of A and F"
            _refuse(key, problem, "leave it out, or use a structure with one of the two")


def _fixed(constraints: Constraints) -> int:
    """Number of fixed poles."""
    return sum(2 if pole.real is None else 1 for pole in constraints.fixed_poles)


def _check_stability(constraints: Constraints, orders: Orders) -> None:
    """Poles of a plant without any, and unstable ones of F."""
    has_poles = orders.single.nb > 0 and (orders.na > 0 or orders.single.nf > 0)
    for key in (
        *("max_pole_radius", "min_damping_ratio", "frequency_band", "forbidden_bands"),
        *("real_poles", "fixed_poles"),
    ):
        if not has_poles and getattr(constraints, key) not in (None, (), [], "any"):
            _refuse(key, f"a model of orders {orders} has no plant with poles", LEAVE_OUT)
    if constraints.stability == "free" and orders.na == 0 and has_poles:
        problem = "the poles of F must be stable, because the predictor filters through 1/F"
        remedy = 'use a structure with A, such as "armax", or fix the pole that is not stable'
        _refuse("stability", problem, remedy)


def _check_poles(constraints: Constraints, orders: Orders, sampling_rate: float) -> None:
    radius = constraints.max_pole_radius
    if radius is not None and radius >= 1.0 and constraints.stability == "required":
        problem = f"{radius} allows poles that are not stable, and stability is required"
        _refuse("max_pole_radius", problem, 'give a radius below 1, or set stability to "free"')
    nyquist, band = sampling_rate / 2.0, constraints.frequency_band
    bands = [("frequency_band", band)] if band else []
    bands += [("forbidden_bands", forbidden) for forbidden in constraints.forbidden_bands]
    for key, (lower, upper) in bands:
        if not 0.0 <= lower < upper:
            _refuse(key, f"{lower} to {upper} Hz is no band", "give lower below upper")
        if lower >= nyquist:
            problem = f"{lower} to {upper} Hz lies above half the sampling rate, {nyquist} Hz"
            _refuse(key, problem, "give frequencies in Hz")
    odd = (orders.single.nf or orders.na) - _fixed(constraints)
    if constraints.real_poles == "none" and (odd % 2 or (orders.single.nf and orders.na % 2)):
        problem = "a plant with an odd number of free poles has a real one"
        _refuse("real_poles", problem, "use even orders")
    for name in constraints.fixed_coefficients if constraints.of_free_poles else ():
        if name[:1] in ("a", "f"):
            problem = "coefficients of A and F cannot be fixed while the positions of poles are"
            _refuse(f"fixed_coefficients.{name}", f"{problem} restricted", LEAVE_ONE)


def _check_has_gain(key: str, constraints: Constraints, orders: Orders) -> None:
    if orders.single.nb == 0:
        _refuse(key, "a model without input has no static gain", LEAVE_OUT)
    if any(pole.real == 1.0 for pole in constraints.fixed_poles):
        _refuse(key, "a plant with a fixed pole at 1 has no static gain", LEAVE_OUT)


def _check_gain(constraints: Constraints, orders: Orders) -> None:
    given = [key for key in GAINS if getattr(constraints, key) is not None]
    if not given:
        return
    key, (lower, upper) = given[0], constraints.gain_bounds_of() or (0.0, 0.0)
    if len(given) == 2:
        _refuse(GAINS[1], "the static gain is given already", "leave out one")
    _check_has_gain(key, constraints, orders)
    if lower is None and upper is None:
        _refuse(key, "there is neither a lower nor an upper bound", "give one")
    if lower is not None and upper is not None and lower > upper:
        _refuse(key, f"the lower bound {lower} exceeds the upper one {upper}", "swap")
    if all(f"b{index}" in constraints.fixed_coefficients for index in range(orders.single.nb)):
        _refuse(key, "all coefficients of B are fixed", "leave one of them free")


def _check_coefficients(constraints: Constraints, orders: Orders) -> None:
    for name, value in constraints.fixed_coefficients.items():
        place, key = coefficient_index(name, orders), f"fixed_coefficients.{name}"
        if place is None:
            problem = f"a model of orders {orders} has no such coefficient"
            _refuse(key, problem, "name one such as a1, b0 or f2; b0 is the first of B")
        letter, index = place
        held = letter in "af" and constraints.fixed_poles
        if letter == "b" or held or (letter == "a" and constraints.stability == "free"):
            continue
        order = getattr(orders.single, f"n{letter}")
        # A sum of products of roots, each within the unit circle.
        if abs(value) >= math.comb(order, index + 1):
            problem = f"{value} is more than any polynomial of degree {order} with roots inside"
            _refuse(key, f"{problem} the unit circle has", "check the value")


def _check_fixed_poles(constraints: Constraints, orders: Orders, sampling_rate: float) -> None:
    for number, pole in enumerate(constraints.fixed_poles):
        _check_fixed_pole(pole, f"fixed_poles[{number}]", constraints, orders, sampling_rate)
    name, order = ("nf", orders.single.nf) if orders.single.nf else ("na", orders.na)
    if _fixed(constraints) > order:
        problem = f"there are more of them than {name} = {order}"
        _refuse("fixed_poles", problem, f"raise {name}, or fix fewer poles")


def _check_fixed_pole(
    pole: FixedPole, key: str, constraints: Constraints, orders: Orders, sampling_rate: float
) -> None:
    """A fixed pole that is none, or that other constraints or the structure forbid."""
    given = [number is not None for number in (pole.real, pole.frequency_hz, pole.damping_ratio)]
    if given not in ([True, False, False], [False, True, True]):
        remedy = "give real, or frequency_hz and damping_ratio"
        _refuse(key, "it is neither a real pole nor a pair", remedy)
    frequency, damping = pole.frequency_hz or 0.0, pole.damping_ratio or 0.0
    if pole.real is not None:
        radius = abs(pole.real)
        if pole.real <= 0.0 and constraints.real_poles == "positive":
            _refuse(key, "real poles must be positive", LEAVE_ONE)
        if constraints.real_poles == "none":
            _refuse(key, "real poles are forbidden", LEAVE_ONE)
    else:
        turn = 2.0 * math.pi * frequency / sampling_rate
        if not (0.0 <= damping < 1.0 and 0.0 < turn * math.sqrt(1.0 - damping**2) < math.pi):
            problem = f"{frequency} Hz with a damping ratio of {damping} is no mode below half the"
            remedy = "give a frequency in Hz and a damping ratio from 0 to below 1"
            _refuse(key, f"{problem} sampling rate, {sampling_rate / 2.0} Hz", remedy)
        radius = math.exp(-turn * damping)
    if orders.single.nf > 0 and radius > 1.0:
        problem = "a pole of F outside the unit circle makes the predictor unstable"
        _refuse(key, problem, 'use a structure with A, such as "armax"')
    limit, least = constraints.max_pole_radius, constraints.min_damping_ratio
    if limit is not None and radius > limit:
        _refuse(key, f"its radius {radius:.6g} exceeds max_pole_radius {limit}", CHANGE)
    if pole.real is None:
        if least is not None and damping < least:
            _refuse(key, f"its damping ratio {damping} is below min_damping_ratio {least}", CHANGE)
        _check_frequency("it", frequency, key, constraints)


def _check_frequency(what: str, frequency: float, key: str, constraints: Constraints) -> None:
    """A natural frequency that no mode within the constraints has."""
    band = constraints.frequency_band
    if band is not None and not band[0] <= frequency <= band[1]:
        _refuse(key, f"{what} lies outside frequency_band", CHANGE)
    if any(lower < frequency < upper for lower, upper in constraints.forbidden_bands):
        _refuse(key, f"{what} lies in a forbidden band", CHANGE)


def _check_prior(
    prior: Prior, key: str, constraints: Constraints, orders: Orders, sampling_rate: float
) -> None:
    deviation, quantity, mean = prior.standard_deviation, prior.quantity, prior.mean
    if deviation <= 0.0:
        _refuse(key, "its standard deviation is not positive", "give one above 0")
    if [prior.subject for prior in constraints.priors].count(prior.subject) > 1:
        _refuse(key, f"there are two priors of its {quantity}", LEAVE_ONE)
    if quantity == "static_gain":
        _check_has_gain(key, constraints, orders)
        if constraints.static_gain is not None:
            _refuse(key, "the static gain is given already", LEAVE_ONE)
        lower, upper = constraints.gain_bounds_of() or (None, None)
        if (lower is not None and mean < lower) or (upper is not None and mean > upper):
            _refuse(key, f"{mean} lies outside static_gain_bounds", CHANGE)
    elif quantity in ("frequency", "damping"):
        if max(orders.na, orders.single.nf) < 2 or orders.single.nb == 0:
            _refuse(key, f"a model of orders {orders} has no mode", LEAVE_OUT)
        if quantity == "damping" and prior.mode_hz is None:
            _refuse(key, "it does not say which mode", "give mode_hz, in Hz")
        nearest = mean if prior.mode_hz is None else prior.mode_hz
        for frequency in (nearest, mean) if quantity == "frequency" else (nearest,):
            if not 0.0 < frequency < sampling_rate / 2.0:
                problem = f"{frequency} Hz does not lie between 0 and half the sampling rate"
                _refuse(key, problem, IN_HZ)
        if quantity == "frequency":
            _check_frequency(f"{mean} Hz", mean, key, constraints)
            return
        lowest = -1.0 if constraints.stability == "free" else 0.0
        if not lowest <= mean < 1.0:
            _refuse(key, f"{mean} is no damping ratio of a mode of a stable plant", RATIO)
        if (least := constraints.min_damping_ratio or lowest) > mean:
            _refuse(key, f"{mean} is below min_damping_ratio, {least}", CHANGE)
    elif coefficient_index(quantity, orders) is None:
        remedy = "name a coefficient such as a1 or b0, static_gain, frequency or damping"
        _refuse(key, f"a model of orders {orders} has no {quantity!r}", remedy)
    elif quantity in constraints.fixed_coefficients:
        _refuse(key, f"{quantity} is fixed already", LEAVE_ONE)
