"""Coordinates of the poles of A and of static gains, within what constraints allow.

Sections ``[sigma, delta]`` are those of :mod:`.sections`.  Free ones are their own coordinates;
restricted ones have shares of the allowed region (:mod:`evopem.estimation.pem.pole_region`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints, FixedPole
from evopem.estimation.pem.constrained_model import gain_of, pole_region
from evopem.estimation.pem.constrained_parameters import Gain
from evopem.estimation.pem.constrained_polynomials import FREE, KIND, SHARE
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS, PoleRegion
from evopem.estimation.state_space.errors import EDGE, ScaledRecording, StateSpaceErrors
from evopem.estimation.state_space.sections import drawn_in

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Block:
    """A section of two states, or of one, whose delta is zero."""

    known: tuple[complex, ...]  # poles that are given: none, one real one, or all
    states: int
    region: PoleRegion | None  # of the other poles; None where they are free within the radius
    radius: float

    @property
    def codes(self) -> list[int]:
        """Kinds of the coordinates."""
        left = self.states - len(self.known)
        if self.region is None and not self.known:
            return [FREE] * self.states
        return [KIND, SHARE, SHARE] if left == 2 else [SHARE] * left

    @property
    def restricted(self) -> bool:
        """Whether poles are known, or have a region."""
        return self.codes[:1] != [FREE]

    def values(self, own: Array) -> tuple[Array, Array]:
        """``[sigma, delta]``, and their derivatives by the coordinates."""
        if not self.codes:
            one, two = self.known[0], self.known[-1]
            return _section(one, two), np.zeros((2, 0))
        if not self.restricted:
            return np.append(own, 0.0)[:2], np.eye(2)[:, : self.states]
        if self.codes[0] == KIND:
            assert self.region is not None
            (c1, c2), by_shares = self.region.section(int(own[0]), own[1:])
            by_section = np.array([[-0.5, 0.0], [0.5 * c1, -1.0]])
            derivatives = np.column_stack([np.zeros(2), by_section @ by_shares])
            return np.array([-0.5 * c1, 0.25 * c1**2 - c2]), derivatives
        low, high = self._real
        pole = low + (high - low) * own[0]
        if not self.known:
            return np.array([pole, 0.0]), np.array([[high - low], [0.0]])
        half = 0.5 * (pole - self.known[0].real)
        return _section(pole, self.known[0]), (high - low) * np.array([[0.5], [half]])

    def coordinates(self, section: Array) -> Array:
        """Those nearest to ``[sigma, delta]``."""
        poles = poles_of(section)
        if not self.codes:
            return np.empty(0)
        if not self.restricted:
            return self.repaired(section[: self.states])
        if self.codes[0] == KIND:
            assert self.region is not None
            kind, shares = self.region.shares_of(poles)
            return np.concatenate([[float(kind)], shares])
        low, high = self._real
        pole = poles[np.argmax(np.abs(poles - self.known[0]))] if self.known else poles[0]
        return np.array([np.clip((pole.real - low) / (high - low), 0.0, 1.0)])

    def repaired(self, own: Array) -> Array:
        """Coordinates within their bounds."""
        if self.restricted:
            return np.where(np.array(self.codes) == SHARE, np.clip(own, 0.0, 1.0), own)
        section = np.append(own, 0.0)
        drawn = drawn_in(section[0], section[1], self.radius * (1.0 - EDGE))
        return np.array(drawn)[: self.states]

    def active(self, own: Array) -> tuple[list[str], list[int]]:
        """Active constraints, and the coordinates that they fix."""
        if self.region is None or not self.codes:
            return [], []
        if self.codes[0] == KIND:
            names, fixed = self.region.active(int(own[0]), own[1:])
            return names, [0, *(1 + k for k in fixed)]
        name = self.region.active_real(float(own[0]))
        return ([], []) if name is None else ([name], [0])

    def random(self, generator: np.random.Generator) -> Array:
        """Coordinates of random allowed poles."""
        own = generator.random(len(self.codes))
        if self.codes and not self.restricted:
            r, angle = self.radius * generator.random() ** 0.5, np.pi * generator.random()
            pole = r * np.exp(1j * angle)
            return _section(pole, pole.conjugate()) if self.states == 2 else np.array([r])
        if self.region is not None and self.codes[:1] == [KIND]:
            own[0] = generator.integers(self.region.kinds)
            # Poles of interest lie near the edge of their region.
            own[2] = 1.0 - generator.random() ** 2
        return own

    @property
    def _real(self) -> tuple[float, float]:
        if self.region is None:
            return -self.radius, self.radius
        return self.region.real or (0.0, 0.0)


def blocks_of(errors: StateSpaceErrors, constraints: Constraints | None) -> tuple[Block, ...]:
    """The sections of A, those with given poles first, the single one of an odd order last."""
    order, radius = errors.order, errors.radius
    sampling_rate = errors.data.recording.sampling_rate
    constraints, name = constraints or Constraints(), "stability"
    if constraints.stability == "free" and errors.innovations:
        radius = UNBOUNDED_RADIUS
    if constraints.max_pole_radius is not None and constraints.max_pole_radius < radius:
        radius, name = constraints.max_pole_radius, "max_pole_radius"
    region = None
    if constraints.of_free_poles:
        region = pole_region(constraints, sampling_rate, radius, name)
    given = [_given(pole, sampling_rate) for pole in constraints.fixed_poles]
    pairs: list[tuple[complex, ...]] = [poles for poles in given if len(poles) == 2]
    real = [poles[0] for poles in given if len(poles) == 1]
    single = [tuple(real[len(real) // 2 * 2 :])] if order % 2 else []
    real = real[: len(real) // 2 * 2] if order % 2 else real
    pairs += [tuple(real[k : k + 2]) for k in range(0, len(real), 2)]
    pairs += [()] * (order // 2 - len(pairs))
    return (
        *(Block(poles, 2, region, radius) for poles in pairs),
        *(Block(poles, 1, region, radius) for poles in single),
    )


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


def _given(pole: FixedPole, sampling_rate: float) -> tuple[complex, ...]:
    """The poles of a fixed real pole or pair."""
    if pole.real is not None:
        return (complex(pole.real),)
    damping, turn = pole.damping_ratio or 0.0, 2.0 * np.pi * (pole.frequency_hz or 0.0)
    upper = np.exp(complex(-damping, np.sqrt(1.0 - damping**2)) * turn / sampling_rate)
    return complex(upper), complex(upper.conjugate())


def _section(one: complex, two: complex) -> Array:
    """``[sigma, delta]`` of two poles."""
    return np.array([(0.5 * (one + two)).real, (0.25 * (one - two) ** 2).real])
