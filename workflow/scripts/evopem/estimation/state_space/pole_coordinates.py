"""Coordinates of the poles of A and of static gains, within what constraints allow.

Sections ``[sigma, delta]`` are those of :mod:`.sections`.  Free ones are their own coordinates;
restricted ones have shares of the allowed region (:mod:`evopem.estimation.pem.pole_region`).
"""

from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array, Complex
from evopem.config.constraints import Constraints
from evopem.estimation.pem.constrained_model import gain_of, pole_region, poles_of_fixed
from evopem.estimation.pem.constrained_parameters import Gain
from evopem.estimation.pem.constrained_polynomials import FREE, KIND, SHARE, RegionSections
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.state_space.errors import EDGE, StateSpaceErrors
from evopem.estimation.state_space.scaled_recording import ScaledRecording
from evopem.estimation.state_space.sections import drawn_in


@dataclass(frozen=True, eq=False)
class Block:
    """A section of two states, or of one, whose delta is zero."""

    known: tuple[complex, ...]  # poles that are given: none, one real one, or all
    states: int
    allowed: RegionSections | None  # of the poles; None where they are free within the radius
    radius: float

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        return [FREE] * self.states if self.allowed is None else self.allowed.codes

    def values(self, point: Array) -> tuple[Array, Array]:
        """``[sigma, delta]``, and their derivatives by the coordinates."""
        if self.allowed is None:
            return np.append(point, 0.0)[:2], np.eye(2)[:, : self.states]
        polynomial, moves = self.allowed.part(point)
        if self.states == 1:
            return np.append(-polynomial, 0.0), np.vstack([-moves, 0.0 * moves])
        section = np.array([-0.5 * polynomial[0], 0.25 * polynomial[0] ** 2 - polynomial[1]])
        return section, np.array([[-0.5, 0.0], [0.5 * polynomial[0], -1.0]]) @ moves

    def coordinates(self, section: Array) -> Array:
        """Those nearest to ``[sigma, delta]``."""
        if self.allowed is None:
            return self.repaired(section[: self.states])
        poles = poles_of(section)[: self.states]
        coefficients = np.asarray(np.poly(poles).real[1:], dtype=float)
        return self.allowed.coordinates(coefficients)

    def repaired(self, point: Array) -> Array:
        """Coordinates within their bounds."""
        if self.allowed is not None:
            return np.where(np.array(self.codes) == SHARE, np.clip(point, 0.0, 1.0), point)
        section = np.append(point, 0.0)
        drawn = drawn_in(section[0], section[1], self.radius * (1.0 - EDGE))
        return np.array(drawn)[: self.states]

    def active(self, point: Array) -> tuple[list[str], list[int]]:
        """Active constraints, and the coordinates that they fix."""
        if self.allowed is None or not self.codes:
            return [], []
        if self.codes[0] == KIND:
            names, fixed = self.allowed.region.active(int(point[0]), point[1:])
            return names, [0, *(1 + k for k in fixed)]
        name = self.allowed.region.active_real(float(point[0]))
        return ([], []) if name is None else ([name], [0])

    def random(self, generator: np.random.Generator) -> Array:
        """Coordinates of random allowed poles."""
        if self.allowed is not None:
            return self.allowed.random(generator)
        r, angle = self.radius * generator.random() ** 0.5, np.pi * generator.random()
        pole = r * np.exp(1j * angle)
        return np.array([pole.real, -(pole.imag**2)] if self.states == 2 else [r])


def blocks_of(errors: StateSpaceErrors, constraints: Constraints | None) -> tuple[Block, ...]:
    """The sections of A, those with given poles first, the single one of an odd order last."""
    order, radius = errors.order, errors.radius
    sampling_rate = errors.data.recording.sampling_rate
    constraints, name = constraints or Constraints(), "stability"
    if constraints.stability == "free" and errors.innovations:
        radius = UNBOUNDED_RADIUS
    if constraints.max_pole_radius is not None and constraints.max_pole_radius < radius:
        radius, name = constraints.max_pole_radius, "max_pole_radius"
    region = pole_region(constraints, sampling_rate, radius, name)

    def block(known: tuple[complex, ...], states: int) -> Block:
        factor = np.atleast_1d(np.poly(known)).real
        allowed = RegionSections(factor, states - len(known), region)
        restricted = known or constraints.of_free_poles
        return Block(known, states, allowed if restricted else None, radius)

    given = [poles_of_fixed(pole, sampling_rate) for pole in constraints.fixed_poles]
    pairs: list[tuple[complex, ...]] = [poles for poles in given if len(poles) == 2]
    real = [poles[0] for poles in given if len(poles) == 1]
    single = [tuple(real[len(real) // 2 * 2 :])] if order % 2 else []
    real = real[: len(real) // 2 * 2] if order % 2 else real
    pairs += [tuple(real[k : k + 2]) for k in range(0, len(real), 2)]
    pairs += [()] * (order // 2 - len(pairs))
    return *(block(poles, 2) for poles in pairs), *(block(poles, 1) for poles in single)


def poles_of(section: Array) -> Complex:
    """The poles of ``[sigma, delta]``, (2,)."""
    root = np.sqrt(complex(section[1]))
    return np.array([section[0] + root, section[0] - root])


def gains_of(constraints: Constraints, data: ScaledRecording) -> dict[int, Gain]:
    """Static gains from inputs to the one output, in the units of the scaled signals."""
    gains = {}
    for column, name in enumerate(data.recording.input_names or [""] * data.inputs.shape[1]):
        scale = float(data.input_scales[column] / data.output_scales[0])
        if (gain := gain_of(constraints, scale, name)) is not None:
            gains[column] = gain
    return gains
