"""Gaussian priors on numbers that follow from a point of a polynomial model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.modes import modes_of, pole_mode
from evopem.models.polynomials import roots

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PriorTerm:
    """One prior, in the units of a point.

    Attributes
    ----------
    quantity : {"coefficient", "static_gain", "frequency", "damping"}
    mean, standard_deviation : float
        Frequencies in Hz.
    index : int
        Entry of the point that a coefficient is.
    mode_hz : float
        The mode nearest to this frequency is meant.
    """

    quantity: str
    mean: float
    standard_deviation: float
    index: int = 0
    mode_hz: float = 0.0


class Priors:
    """Deviations of a point from its priors, in standard deviations.

    Parameters
    ----------
    terms : tuple of PriorTerm
    parts : mapping of str to slice
        Where a, b and f stand in a point.
    sampling_rate : float
        Hz.
    """

    def __init__(
        self, terms: tuple[PriorTerm, ...], parts: Mapping[str, slice], sampling_rate: float
    ) -> None:
        self.terms, self.parts, self.sampling_rate = terms, parts, sampling_rate

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
            b = float(np.sum(point[self.parts["b"]]))
            a, f = (1.0 + float(np.sum(point[self.parts[name]])) for name in "af")
            gradient[self.parts["b"]] = 1.0 / (a * f)
            gradient[self.parts["a"]] = -b / (a * a * f)
            gradient[self.parts["f"]] = -b / (a * f * f)
            return b / (a * f), gradient
        name, pole = self._mode(term, point)
        values, slopes = pole_mode(point[self.parts[name]], pole, self.sampling_rate)
        row = 0 if term.quantity == "frequency" else 1
        gradient[self.parts[name]] = slopes[row]
        return float(values[row]), gradient

    def _mode(self, term: PriorTerm, point: Array) -> tuple[str, complex]:
        """The pole nearest in natural frequency: a mode where there is one, or a real pole."""
        modes = [
            (abs(mode.frequency_hz - term.mode_hz), name, mode.pole)
            for name in "af"
            for mode in modes_of(point[self.parts[name]], self.sampling_rate)
        ]
        if modes:
            _, name, pole = min(modes, key=lambda each: each[0])
            return name, pole
        real = [(name, z) for name in "af" for z in roots(point[self.parts[name]]) if z != 0.0]
        wanted = np.exp(2j * np.pi * term.mode_hz / self.sampling_rate)
        return min(real, key=lambda each: abs(each[1] - wanted), default=("f", 0j))
