"""Priors of coefficients, static gain and modes: how far a point deviates from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array
from evopem.config.constraints import Constraints
from evopem.models.constraint_checks import coefficient_index
from evopem.models.modes import modes_of, pole_mode
from evopem.models.orders import Orders
from evopem.models.polynomial_roots import roots


@dataclass(frozen=True)
class PriorTerm:
    """One prior, in the units of a point; frequencies in Hz."""

    quantity: str  # "coefficient", "static_gain", "frequency" or "damping"
    mean: float
    standard_deviation: float
    index: int = 0  # entry of the point that a coefficient is
    mode_hz: float = 0.0  # the mode nearest to this frequency is meant


class Priors:
    """Deviations of a point from its priors, in standard deviations.  ``parts`` says where a, b0,
    ... and f0, ... stand in a point."""

    def __init__(
        self, terms: tuple[PriorTerm, ...], parts: Mapping[str, slice], sampling_rate: float
    ) -> None:
        self.terms, self.parts, self.sampling_rate = terms, parts, sampling_rate
        # Where the polynomials stand whose roots are poles of the plant.
        self.denominators = [part for name, part in parts.items() if name[0] in "af"]

    def deviations(self, point: Array) -> tuple[Array, Array]:
        """Deviations (m,) and their derivatives by the point, (m, n)."""
        deviations = np.zeros(len(self.terms))
        derivatives = np.zeros((len(self.terms), len(point)))
        for row, term in enumerate(self.terms):
            value, gradient = self._quantity(term, point)
            deviations[row] = (value - term.mean) / term.standard_deviation
            derivatives[row] = gradient / term.standard_deviation
        return deviations, derivatives

    def _quantity(self, term: PriorTerm, point: Array) -> tuple[float, Array]:
        gradient = np.zeros(len(point))
        if term.quantity == "coefficient":
            gradient[term.index] = 1.0
            return float(point[term.index]), gradient
        if term.quantity == "static_gain":
            of_b, of_a, of_f = (self.parts[name] for name in ("b0", "a", "f0"))
            b = float(np.sum(point[of_b]))
            a, f = (1.0 + float(np.sum(point[part])) for part in (of_a, of_f))
            gradient[of_b] = 1.0 / (a * f)
            gradient[of_a] = -b / (a * a * f)
            gradient[of_f] = -b / (a * f * f)
            return b / (a * f), gradient
        part, pole = self._mode(term, point)
        values, slopes = pole_mode(point[part], pole, self.sampling_rate)
        row = 0 if term.quantity == "frequency" else 1
        gradient[part] = slopes[row]
        return float(values[row]), gradient

    def _mode(self, term: PriorTerm, point: Array) -> tuple[slice, complex]:
        """The pole nearest in natural frequency: a mode where there is one, or a real pole."""
        modes = [
            (abs(mode.frequency_hz - term.mode_hz), part, mode.pole)
            for part in self.denominators
            for mode in modes_of(point[part], self.sampling_rate)
        ]
        if modes:
            _, part, pole = min(modes, key=lambda mode: mode[0])
            return part, pole
        real = [(part, z) for part in self.denominators for z in roots(point[part]) if z != 0.0]
        wanted = np.exp(2j * np.pi * term.mode_hz / self.sampling_rate)
        without = (self.denominators[-1], 0j)
        return min(real, key=lambda indexed_pole: abs(indexed_pole[1] - wanted), default=without)


def priors_of(
    constraints: Constraints,
    parts: Mapping[str, slice],
    orders: Orders,
    sampling_rate: float,
    b_scales: Sequence[float] | Array = (),
) -> Priors:
    """The priors among constraints, in the units of a point; ``b_scales``: what B_i of it are to be
    multiplied by."""
    terms = []
    b_scale = float(b_scales[0]) if len(b_scales) else 1.0
    for prior in constraints.priors:
        quantity, index = prior.quantity, 0
        near = prior.mean if prior.mode_hz is None else prior.mode_hz
        scale = b_scale if quantity == "static_gain" or quantity[0] == "b" else 1.0
        if (place := coefficient_index(quantity, orders)) is not None:
            quantity, index = "coefficient", orders.part(place[0]).start + place[1]
        mean, deviation = prior.mean / scale, prior.standard_deviation / scale
        terms.append(PriorTerm(quantity, mean, deviation, index, near))
    return Priors(tuple(terms), parts, sampling_rate)
