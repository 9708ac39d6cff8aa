"""Records of vibrating structures with known modes, shaken by measured or unmeasured forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Samples before the record, for the transients to decay.
RUN_IN = 2000


@dataclass(frozen=True, eq=False)
class VibratingStructure:
    """A linear structure: ``q_k'' + 2 z_k w_k q_k' + w_k^2 q_k = phi_k' f`` for each mode."""

    frequencies_hz: Array  # (m,) undamped natural frequencies, w_k / 2 pi
    damping_ratios: Array  # (m,)
    shapes: Array  # (ny, m) real mode shapes phi_k at the sensors, one in each column

    def softened(self, stiffness: float) -> VibratingStructure:
        """The structure with all stiffnesses multiplied by a factor."""
        return VibratingStructure(
            self.frequencies_hz * np.sqrt(stiffness), self.damping_ratios, self.shapes
        )

    def ambient_record(
        self, samples: int, sampling_rate: float, noise: float, generator: np.random.Generator
    ) -> Array:
        """Velocities under independent white forces at the sensors, with sensor noise, (N, ny).

        The samples have exactly the distribution of the continuous structure (Van Loan 1978);
        ``noise`` is the sensors' standard deviation relative to that of each velocity.
        """
        dynamics, forces = self._continuous()
        transition, covariance = _sampled(dynamics, forces, 1.0 / sampling_rate)
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        pushes = generator.standard_normal((RUN_IN + samples, len(dynamics))) @ root.T
        return self._measured(_states(transition, pushes), noise, generator)

    def driven_record(
        self,
        samples: int,
        sampling_rate: float,
        inputs: int,
        noise: float,
        generator: np.random.Generator,
    ) -> tuple[Array, Array]:
        """Measured white forces at the first sensors, (N, inputs), and velocities, (N, ny).

        Forces are held between samples, and the velocities are those of the continuous structure.
        """
        from scipy.signal import cont2discrete

        dynamics, forces = self._continuous()
        held = dynamics, forces[:, :inputs], dynamics, forces[:, :inputs]
        transition, entry, *_ = cont2discrete(held, 1.0 / sampling_rate)
        u = generator.standard_normal((RUN_IN + samples, inputs))
        return u[RUN_IN:], self._measured(_states(transition, u @ entry.T), noise, generator)

    def _measured(self, states: Array, noise: float, generator: np.random.Generator) -> Array:
        """Velocities at the sensors after the run-in, with sensor noise."""
        velocities = states[RUN_IN:, 1::2] @ self.shapes.T
        sensors = generator.standard_normal(velocities.shape)
        record: Array = velocities + noise * velocities.std(axis=0) * sensors
        return record

    def _continuous(self) -> tuple[Array, Array]:
        """Dynamics, (2m, 2m), of ``q_1, q_1', q_2, ...``, and how forces enter, (2m, ny)."""
        modes = len(self.frequencies_hz)
        dynamics = np.zeros((2 * modes, 2 * modes))
        forces = np.zeros((2 * modes, len(self.shapes)))
        for k, (f, z) in enumerate(zip(self.frequencies_hz, self.damping_ratios, strict=True)):
            w = 2.0 * np.pi * f
            dynamics[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, 1.0], [-(w**2), -2.0 * z * w]]
            forces[2 * k + 1] = self.shapes[:, k]
        return dynamics, forces


def random_frequencies(
    generator: np.random.Generator, modes: int, close_pairs: int, band_hz: tuple[float, float]
) -> Array:
    """Frequencies at least 8 % apart, of which some have a neighbour within 2 to 5 %, in Hz."""
    while True:
        low, high = np.log(band_hz)
        apart = np.sort(np.exp(generator.uniform(low, high, modes - close_pairs)))
        if np.all(np.diff(apart) > 0.08 * apart[1:]):
            break
    doubled = generator.choice(len(apart), close_pairs, replace=False)
    beside = apart[doubled] * (1.0 + generator.uniform(0.02, 0.05, close_pairs))
    return np.sort(np.concatenate([apart, beside]))


def random_structure(
    generator: np.random.Generator,
    modes: int = 6,
    sensors: int = 4,
    close_pairs: int = 2,
    band_hz: tuple[float, float] = (2.0, 38.0),
) -> VibratingStructure:
    """A structure with random shapes and frequencies, and damping ratios from 0.5 to 3 %."""
    frequencies = random_frequencies(generator, modes, close_pairs, band_hz)
    shapes = generator.standard_normal((sensors, modes))
    return VibratingStructure(
        frequencies_hz=frequencies,
        damping_ratios=generator.uniform(0.005, 0.03, modes),
        shapes=shapes / np.linalg.norm(shapes, axis=0),
    )


def _sampled(dynamics: Array, forces: Array, step: float) -> tuple[Array, Array]:
    """Transition matrix and covariance of the pushes of a sampled diffusion (Van Loan 1978)."""
    from scipy.linalg import expm

    n = len(dynamics)
    block = np.block([[-dynamics, forces @ forces.T], [np.zeros((n, n)), dynamics.T]])
    exponential = expm(block * step)
    transition = exponential[n:, n:].T
    covariance = transition @ exponential[:n, n:]
    return transition, 0.5 * (covariance + covariance.T)


def _states(transition: Array, pushes: Array) -> Array:
    states = np.empty_like(pushes)
    state = np.zeros(len(transition))
    for sample, push in enumerate(pushes):
        states[sample] = state
        state = transition @ state + push
    return states
