"""Constraints of a user, in the parametrisation that meets them exactly."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, Flags
from evopem.config.constraints import Constraints, FixedPole
from evopem.errors import InputError
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters, Gain, GivenGain
from evopem.estimation.pem.constrained_polynomials import Linear, RegionSections, null_space
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS, Band, PoleRegion
from evopem.models.constraint_checks import coefficient_index
from evopem.models.orders import Orders


def constrained_parameters(
    constraints: Constraints,
    orders: Orders,
    sampling_rate: float,
    radius: float,
    names: Sequence[str] = (),
    b_scales: Sequence[float] | Array = (),
    rest: int = 0,
    levels: Sequence[float] | Array = (),
    tied: bool = False,
) -> ConstrainedParameters:
    """Coordinates of the points that meet checked constraints; InputError where no polynomial does.
    ``radius``: largest of poles where stability is required. ``b_scales``: what B_i of a point are
    to be multiplied by. ``rest``: levels and states of a point, of which ``levels`` are fixed.
    ``tied``: C is A."""
    o = orders
    names = tuple(names) or ("",) * o.inputs
    paths = [(constraints.of_input(name), o.of_input(k)) for k, name in enumerate(names)]
    polynomials: dict[str, RegionSections | Linear] = {}
    gains: dict[str, GivenGain] = {}
    first = paths[0] if paths else (constraints, o)
    polynomials["a"] = plant_polynomial("a", *first, sampling_rate, radius)
    for k, path in enumerate(paths):
        scale = float(b_scales[k]) if len(b_scales) else 1.0
        polynomials[f"b{k}"], gain = _numerator(*path, scale, f"f{k}")
        if gain is not None:
            gains[f"b{k}"] = gain
    for name in "cd":
        polynomials[name] = _linear(np.ones(1), *_fixed(name, constraints, o))
    if tied:
        polynomials["c"] = Linear(np.zeros(o.nc), np.zeros((o.nc, 0)))
    for k, path in enumerate(paths):
        polynomials[f"f{k}"] = plant_polynomial("f", *path, sampling_rate, radius)
    offset = np.concatenate([levels, np.zeros(rest - len(levels))])
    polynomials["rest"] = Linear(offset, np.eye(rest)[:, len(levels) :])
    return ConstrainedParameters(polynomials, gains, tied)


def _numerator(
    constraints: Constraints, orders: Orders, b_scale: float, f: str
) -> tuple[Linear, GivenGain | None]:
    """A numerator of one path, and the static gain that determines it; ``f`` names its F."""
    free, values = _fixed("b", constraints, orders)
    basis = np.eye(orders.single.nb)[:, free]
    gain = gain_of(constraints, 1.0 / b_scale)
    given = None
    if gain is not None:
        given = GivenGain(gain, free / float(free.sum()), f)
        basis = basis @ null_space(np.ones((1, int(free.sum()))))
    return Linear(np.where(free, 0.0, values / b_scale), basis), given


def equalities(constraints: Constraints) -> list[str]:
    """Names of the equalities and priors among constraints."""
    names = [f"fixed_coefficients.{name}" for name in constraints.fixed_coefficients]
    names += ["fixed_poles"] * bool(constraints.fixed_poles)
    names += ["static_gain"] * (constraints.static_gain is not None)
    return names + ["priors"] * bool(constraints.priors)


def plant_polynomial(
    name: str,
    constraints: Constraints,
    orders: Orders,
    sampling_rate: float,
    stability_radius: float,
) -> RegionSections | Linear:
    """A or F of one path, ``name``; errors as of :func:`constrained_parameters`."""
    order = getattr(orders.single, f"n{name}")
    factor = np.ones(1)
    if order and name == ("f" if orders.single.nf else "a"):
        for pole in constraints.fixed_poles:
            factor = np.convolve(factor, np.poly(poles_of_fixed(pole, sampling_rate)).real)
    free, values = _fixed(name, constraints, orders)
    bounded = constraints.stability == "required" or name == "f"
    radius = stability_radius if bounded else UNBOUNDED_RADIUS
    radius_name = "stability"
    if constraints.max_pole_radius is not None and constraints.max_pole_radius < radius:
        radius, radius_name = constraints.max_pole_radius, "max_pole_radius"
    if constraints.of_free_poles and orders.single.nb:
        region = pole_region(constraints, sampling_rate, radius, radius_name)
        return RegionSections(factor, order - len(factor) + 1, region)
    limit = None if radius == UNBOUNDED_RADIUS else radius
    return _linear(factor, free, values, limit, radius_name)


def pole_region(
    constraints: Constraints, sampling_rate: float, radius: float, radius_name: str
) -> PoleRegion:
    damping = constraints.min_damping_ratio or 0.0
    decay = damping / float(np.sqrt(1.0 - damping**2))
    in_radians = 2.0 * np.pi / sampling_rate
    low, high = constraints.frequency_band or (0.0, np.inf)
    whole_band = low * in_radians, high * in_radians
    bands: list[Band] = [whole_band]
    forbidden = [(low * in_radians, high * in_radians) for low, high in constraints.forbidden_bands]
    for low, high in forbidden:
        bands = [
            part
            for lower, upper in bands
            for part in ((lower, min(upper, low)), (max(lower, high), upper))
            if part[0] < part[1]
        ]
    restricted = damping > 0.0 or bands != [(0.0, np.inf)]
    real: Band | None = None
    if constraints.real_poles != "none":
        negative = constraints.real_poles == "any" and np.isinf(bands[-1][1] if bands else 0.0)
        negative = negative and not any(low < np.pi < high for low, high in forbidden)
        real = (-min(radius, float(np.exp(-decay * np.pi))) if negative else 0.0, radius)
    region = PoleRegion(
        radius=radius,
        mode_radius=min(radius, 1.0) if restricted else radius,
        decay_per_radian=decay,
        bands=tuple(bands),
        real=real,
        radius_name=radius_name,
        whole_band=whole_band,
    )
    # A band that no pole of an allowed radius reaches is empty.
    open_bands = tuple(band for band in bands if region.largest_angle(band) > 0.0)
    if not open_bands:
        problem = "no mode has a natural frequency that is allowed, at the radius that is allowed"
        raise InputError("constraints", problem, "widen the band", "frequency_band")
    return replace(region, bands=open_bands)


def poles_of_fixed(pole: FixedPole, sampling_rate: float) -> tuple[complex, ...]:
    """The poles of a fixed real pole, or of a fixed pair."""
    if pole.real is not None:
        return (complex(pole.real),)
    damping, turn = pole.damping_ratio or 0.0, 2.0 * np.pi * (pole.frequency_hz or 0.0)
    upper = np.exp(complex(-damping, np.sqrt(1.0 - damping**2)) * turn / sampling_rate)
    return complex(upper), complex(upper.conjugate())


def _fixed(name: str, constraints: Constraints, orders: Orders) -> tuple[Flags, Array]:
    """Which coefficients of a polynomial are free, and the values of the others."""
    count = orders.part(name).stop - orders.part(name).start
    free, values = np.ones(count, dtype=bool), np.zeros(count)
    for key, value in constraints.fixed_coefficients.items():
        place = coefficient_index(key, orders)
        if place is not None and place[0] == name:
            free[place[1]], values[place[1]] = False, value
    return free, values


def _linear(
    factor: Array,
    free: Flags,
    values: Array,
    radius: float | None = None,
    radius_name: str = "stability",
) -> Linear:
    """A monic polynomial with a fixed factor and fixed coefficients."""
    order = len(free)
    inner = order - len(factor) + 1
    columns = scipy.linalg.convolution_matrix(factor, inner) if inner else np.zeros((order, 0))
    start = np.zeros(order)
    start[: len(factor) - 1] = factor[1:]
    fixed = ~free
    rows, target = columns[fixed], values[fixed] - start[fixed]
    inner_offset = np.zeros(inner)
    if inner:
        inner_offset = np.asarray(np.linalg.lstsq(rows, target, rcond=None)[0], dtype=float)
    if np.any(np.abs(rows @ inner_offset - target) > 1e-9 * (1.0 + np.abs(target))):
        problem = "no polynomial has both the fixed poles and the fixed coefficients"
        raise InputError("constraints", problem, "leave out one of them", "fixed_coefficients")
    inner_basis = null_space(rows) if fixed.any() and inner else np.eye(inner)
    offset, basis = start + columns @ inner_offset, columns @ inner_basis
    offset[fixed], basis[fixed] = values[fixed], 0.0
    return Linear(offset, basis, radius, inner_offset, inner_basis, radius_name)


def gain_of(constraints: Constraints, scale: float, name: str = "") -> Gain | None:
    """The bounds of the static gain from an input, if any, times a scale."""
    gain, bounds = constraints.gain_of(name), constraints.gain_bounds_of(name)
    if gain is not None:
        bounds = gain, gain
    if bounds is None:
        return None
    lower, upper = bounds
    lower, upper = -np.inf if lower is None else lower, np.inf if upper is None else upper
    return Gain(scale * lower, scale * upper)
