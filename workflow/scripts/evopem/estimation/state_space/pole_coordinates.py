"""Coordinates of the poles of A, free or restricted to what constraints allow.

A section of two states is ``[[a, s], [d / s, a]]`` with a fixed s.  Free ones have the coordinates
a and d; restricted ones shares of the allowed region (:mod:`evopem.estimation.pem.pole_region`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints, FixedPole
from evopem.estimation.pem.constrained_model import pole_region
from evopem.estimation.pem.constrained_polynomials import FREE, KIND, SHARE
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS, PoleRegion
from evopem.estimation.state_space.errors import EDGE
from evopem.estimation.state_space.sections import drawn_in

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Block:
    """A section of two states, or of one."""

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

    def values(self, own: Array) -> tuple[Array, Array]:
        """``[a, d]``, or the one pole, and their derivatives by the coordinates."""
        if len(self.known) == self.states:
            poles = np.array(self.known)
            return _centre(poles)[: self.states], np.zeros((self.states, 0))
        if self.codes[0] == FREE:
            return own.copy(), np.eye(self.states)
        if self.codes[0] == KIND:
            assert self.region is not None
            (c1, c2), by_shares = self.region.section(int(own[0]), own[1:])
            by_section = np.array([[-0.5, 0.0], [0.5 * c1, -1.0]])
            derivatives = np.column_stack([np.zeros(2), by_section @ by_shares])
            return np.array([-0.5 * c1, 0.25 * c1**2 - c2]), derivatives
        low, high = self._real
        pole = low + (high - low) * own[0]
        if self.states == 1:
            return np.array([pole]), np.array([[high - low]])
        half = 0.5 * (pole - self.known[0].real)
        values = np.array([0.5 * (pole + self.known[0].real), half**2])
        return values, (high - low) * np.array([[0.5], [half]])

    def coordinates(self, poles: Complex) -> Array:
        """Those nearest to poles, (states,)."""
        if len(self.known) == self.states:
            return np.empty(0)
        if self.codes[0] == FREE:
            return self.repaired(_centre(poles)[: self.states])
        if self.codes[0] == KIND:
            assert self.region is not None
            kind, shares = self.region.shares_of(poles)
            return np.concatenate([[float(kind)], shares])
        low, high = self._real
        pole = poles[np.argmax(np.abs(poles - self.known[0]))] if self.known else poles[0]
        return np.array([np.clip((pole.real - low) / (high - low), 0.0, 1.0)])

    def repaired(self, own: Array) -> Array:
        """Coordinates within their bounds."""
        if not self.codes or self.codes[0] != FREE:
            kinds = np.array(self.codes) == SHARE
            return np.where(kinds, np.clip(own, 0.0, 1.0), own)
        limit = self.radius * (1.0 - EDGE)
        if self.states == 1:
            return np.clip(own, -limit, limit)
        return np.array(drawn_in(own[0], own[1], limit))

    def active(self, own: Array) -> tuple[list[str], list[int]]:
        """Active constraints, and the coordinates that they fix."""
        if self.region is None or not self.codes:
            return [], []
        if self.codes[0] == KIND:
            names, fixed = self.region.active(int(own[0]), own[1:])
            return names, [0, *(1 + k for k in fixed)]
        name = self.region.active_real(float(own[0]))
        return ([], []) if name is None else ([name], [0])

    def random_poles(self, generator: np.random.Generator) -> Complex:
        """Random allowed poles, (states,)."""
        own = generator.random(len(self.codes))
        if self.codes and self.codes[0] == FREE:
            r, angle = self.radius * generator.random() ** 0.5, np.pi * generator.random()
            pole = r * np.exp(1j * angle)
            return np.array([pole, pole.conjugate()]) if self.states == 2 else np.array([r + 0j])
        if self.region is not None and self.codes and self.codes[0] == KIND:
            own[0] = generator.integers(self.region.kinds)
            # Poles of interest lie near the edge of their region.
            own[2] = 1.0 - generator.random() ** 2
        return self.poles(own)

    def poles(self, own: Array) -> Complex:
        """The poles, (states,)."""
        values = self.values(own)[0]
        if self.states == 1:
            return values.astype(complex)
        root = np.sqrt(complex(values[1]))
        return np.array([values[0] + root, values[0] - root])

    @property
    def _real(self) -> tuple[float, float]:
        if self.region is None:
            return -self.radius, self.radius
        return self.region.real or (0.0, 0.0)


def blocks_of(
    order: int,
    constraints: Constraints | None,
    sampling_rate: float,
    radius: float,
    unstable_allowed: bool,
) -> tuple[Block, ...]:
    """The sections of A, those with given poles first, the single one of an odd order last."""
    if constraints is None:
        pairs = [Block((), 2, None, radius) for _ in range(order // 2)]
        return (*pairs, *([Block((), 1, None, radius)] if order % 2 else []))
    name = "stability"
    if constraints.stability == "free" and unstable_allowed:
        radius = UNBOUNDED_RADIUS
    if constraints.max_pole_radius is not None and constraints.max_pole_radius < radius:
        radius, name = constraints.max_pole_radius, "max_pole_radius"
    region = None
    if constraints.of_free_poles:
        region = pole_region(constraints, sampling_rate, radius, name)
    given = [_given(pole, sampling_rate) for pole in constraints.fixed_poles]
    pairs = [Block(poles, 2, region, radius) for poles in given if len(poles) == 2]
    real = [poles[0] for poles in given if len(poles) == 1]
    single = []
    if order % 2:
        single = [Block(tuple(real[-1:]) if len(real) % 2 else (), 1, region, radius)]
        real = real[:-1] if len(real) % 2 else real
    pairs += [Block(tuple(real[k : k + 2]), 2, region, radius) for k in range(0, len(real), 2)]
    pairs += [Block((), 2, region, radius) for _ in range(order // 2 - len(pairs))]
    return (*pairs, *single)


def modal_basis(A: Array, blocks: Sequence[Block]) -> tuple[Array, list[Complex]]:
    """Real basis in which A has sections as blocks do, and the poles of each of them."""
    poles, vectors = np.linalg.eig(A)
    upper = [int(k) for k in np.flatnonzero(poles.imag > 0.0)]
    of_real = [int(k) for k in np.flatnonzero(poles.imag == 0.0)]
    real = sorted(of_real, key=lambda k: float(poles[k].real))
    alone: list[int] = []
    if len(A) % 2:
        # Without a given pole the one farthest from the origin.
        target = blocks[-1].known[0] if blocks[-1].known else 2.0 * max(poles[real].real, key=abs)
        alone = [min(real, key=lambda k: float(abs(poles[k] - target)))]
        real.remove(alone[0])
    pairs = [(k, None) for k in upper] + list(zip(real[::2], real[1::2], strict=True))
    columns: list[Array] = []
    of_blocks: list[Complex] = []
    for block in blocks:
        if block.states == 1:
            columns.append(vectors[:, alone[0]].real)
            of_blocks.append(poles[alone])
            continue
        known = np.array(block.known)
        chosen = min(
            pairs,
            key=lambda pair: (
                float(np.abs(known[:, None] - poles[pair[0]]).min()) if len(known) else 0.0
            ),
        )
        pairs.remove(chosen)
        first, second = chosen
        if second is None:
            both = np.array([poles[first], poles[first].conjugate()])
            one, two = vectors[:, first].real, vectors[:, first].imag
        else:
            both = poles[[second, first]]
            high, low = vectors[:, second].real, vectors[:, first].real
            one, two = high + low, high - low
        half = max(0.5 * float(abs(both[0] - both[1])), 1e-9)
        columns += [one, two * (coupling_of(_centre(both)) / half)]
        of_blocks.append(both)
    return np.column_stack(columns), of_blocks


def coupling_of(values: Array) -> float:
    """s of a section, from its ``[a, d]``: both states are of one size."""
    return float(np.sqrt(max(abs(values[1]), 1e-6)))


def _given(pole: FixedPole, sampling_rate: float) -> tuple[complex, ...]:
    """The poles of a fixed real pole or pair."""
    if pole.real is not None:
        return (complex(pole.real),)
    damping, turn = pole.damping_ratio or 0.0, 2.0 * np.pi * (pole.frequency_hz or 0.0)
    upper = np.exp(complex(-damping, np.sqrt(1.0 - damping**2)) * turn / sampling_rate)
    return complex(upper), complex(upper.conjugate())


def _centre(poles: Complex) -> Array:
    """``[a, d]`` of two poles, or the pole and zero."""
    if len(poles) == 1:
        return np.array([poles[0].real, 0.0])
    a = 0.5 * (poles[0] + poles[1])
    return np.array([a.real, (0.25 * (poles[0] - poles[1]) ** 2).real])
