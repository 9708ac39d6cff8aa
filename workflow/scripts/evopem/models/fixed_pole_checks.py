"""Fixed poles that are none, or that other constraints or the structure forbid."""

from __future__ import annotations

import math

from evopem.config.constraints import Constraints, FixedPole
from evopem.errors import InputError
from evopem.models.structures import Orders


def refused(key: str, problem: str, remedy: str) -> InputError:
    """The refusal of a key of constraints."""
    return InputError("constraints", problem, remedy, key)


def check_fixed_pole(
    pole: FixedPole,
    key: str,
    constraints: Constraints,
    orders: Orders,
    sampling_rate: float,
) -> None:
    """Refuse a fixed pole of a path, named by its key."""
    pair = pole.frequency_hz is not None and pole.damping_ratio is not None
    if (pole.real is None) != pair or (
        pole.real is not None and (pole.frequency_hz, pole.damping_ratio) != (None, None)
    ):
        raise refused(
            key,
            "it is neither a real pole nor a pair",
            "give real, or frequency_hz and damping_ratio",
        )
    if pole.real is not None:
        radius = _radius_of_real_pole(pole.real, key, constraints)
    else:
        radius = _radius_of_pair(pole, key, sampling_rate)
    if orders.single.nf and radius > 1.0:
        raise refused(
            key,
            "a pole of F outside the unit circle makes the predictor unstable",
            'use a structure with A, such as "armax"',
        )
    limit = constraints.max_pole_radius
    if limit is not None and radius > limit:
        raise refused(
            key, f"its radius {radius:.6g} exceeds max_pole_radius {limit}", "change one of the two"
        )
    if pair:
        _check_pair(pole.frequency_hz or 0.0, pole.damping_ratio or 0.0, key, constraints)


def _radius_of_real_pole(pole: float, key: str, constraints: Constraints) -> float:
    if not math.isfinite(pole):
        raise refused(key, f"{pole} is not a finite number", "give a number")
    if pole <= 0.0 and constraints.real_poles == "positive":
        raise refused(key, "real poles must be positive", "leave out one of the two")
    if constraints.real_poles == "none":
        raise refused(key, "real poles are forbidden", "leave out one of the two")
    return abs(pole)


def _radius_of_pair(pole: FixedPole, key: str, sampling_rate: float) -> float:
    frequency, damping = pole.frequency_hz or 0.0, pole.damping_ratio or 0.0
    turn = 2.0 * math.pi * frequency / sampling_rate
    if not (0.0 <= damping < 1.0 and 0.0 < turn * math.sqrt(1.0 - damping**2) < math.pi):
        raise refused(
            key,
            f"{frequency} Hz with a damping ratio of {damping} is no mode below half the "
            f"sampling rate, {sampling_rate / 2.0} Hz",
            "give a frequency in Hz and a damping ratio from 0 to below 1",
        )
    return math.exp(-turn * damping)


def _check_pair(frequency: float, damping: float, key: str, constraints: Constraints) -> None:
    """Refuse a pair of poles that the constraints of modes forbid."""
    least = constraints.min_damping_ratio
    if least is not None and damping < least:
        raise refused(
            key,
            f"its damping ratio {damping} is below min_damping_ratio {least}",
            "change one of the two",
        )
    band = constraints.frequency_band
    if band is not None and not band[0] <= frequency <= band[1]:
        raise refused(key, "it lies outside frequency_band", "change one of the two")
    if any(lower < frequency < upper for lower, upper in constraints.forbidden_bands):
        raise refused(key, "it lies in a forbidden band", "change one of the two")
