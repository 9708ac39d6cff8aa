"""The search for the poles of frequency responses, with their residues solved for.

Golub & Pereyra (1973). Starts are poles that linear least squares relocate (Sanathanan & Koerner
1963; Gustavsen & Semlyen 1999); damped Gauss-Newton steps and basin hopping follow.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from evopem.arrays import Array, Complex
from evopem.estimation.damped_descent import Damping
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.search.global_search import basin_hopping
from evopem.estimation.search.problem import (
    SearchProgress,
    SearchResult,
    same_optimum,
    undiscovered,
)

# Independent random starts, and evaluations of the basin hopping.
RESTARTS, HOPPING = 16, 100
RELOCATIONS, STEPS, CONVERGED = 12, 60, 1e-10
SMALLEST, LARGEST = -14.0, 7.0  # of log ζ
# Smallest half width of a resonance, in distances of lines: narrower ones are hardly measured.
NARROWEST = 0.1

Equations = tuple[float, Array, Array]
"""Sum of squares, half its gradient, and the Gauss-Newton matrix."""


class FrequencyProblem:
    """The poles of some sections: points are log ω and log ζ of each; p (F,), measured (F, pairs)
    responses, and their weights."""

    def __init__(self, p: Complex, measured: Complex, weights: Array, modes: int) -> None:
        self.p, self.measured, self.of_lines, self.modes = p, measured, weights, modes
        self.weights = np.concatenate([weights, weights]).T[:, :, None]  # (pairs, 2F, 1)
        self.target = self.weights * stacked(measured).T[:, :, None]
        self.power = float(np.sum(self.target**2))
        self.edges = float(np.abs(p).min()), float(np.abs(p).max())
        self.narrowest = np.log(NARROWEST * float(np.diff(np.abs(p)).min()))

    def _basis(self, point: Array) -> tuple[Any, Any, Any]:
        """``ω/d, p/d`` of each section and 1, (F, 2 modes + 1); 2 ζ ω p/d and 2 ω²/d."""
        omega, zeta = np.exp(point.reshape(2, -1))
        p = self.p[:, None]
        inverse = 1.0 / (p**2 + 2.0 * zeta * omega * p + omega**2)
        pairs = np.stack([omega * inverse, p * inverse], axis=2).reshape(len(p), -1)
        basis = np.hstack([pairs, np.ones_like(p)])
        return basis, 2.0 * zeta * omega * p * inverse, 2.0 * omega**2 * inverse

    def solved(self, point: Array) -> tuple[Any, Any, Any]:
        """Errors (pairs, 2F, 1), coefficients (pairs, 2 modes + 1), and orthonormal columns."""
        q, r = np.linalg.qr(self.weights * stacked(self._basis(point)[0]))
        of_target = q.transpose(0, 2, 1) @ self.target
        coefficients = np.linalg.solve(r + 1e-14 * np.eye(r.shape[1]), of_target)[:, :, 0]
        return self.target - q @ of_target, coefficients, q

    def equations(self, point: Array) -> Equations:
        """Of the poles alone (Kaufman 1975)."""
        errors, coefficients, q = self.solved(point)
        basis, of_damping, of_frequency = self._basis(point)
        parts = basis[:, :-1, None] * coefficients[:, :-1].T  # (F, 2 modes, pairs)
        parts = parts.reshape(len(basis), self.modes, 2, -1).sum(axis=2)
        factors = np.concatenate([of_damping + of_frequency, of_damping], axis=1)[:, :, None]
        slopes = -np.concatenate([parts, parts], axis=1) * factors
        columns = self.weights * stacked(slopes).transpose(2, 0, 1)
        columns -= q @ (q.transpose(0, 2, 1) @ columns)
        gradient = -np.einsum("pfk,pf->k", columns, errors[:, :, 0])
        return float(np.sum(errors**2)), gradient, np.einsum("pfk,pfl->kl", columns, columns)

    def descend(self, points: Array) -> Descent:
        """Descend from each row by damped Gauss-Newton steps."""
        ends = [
            descended_squares(self.equations, self.repair(point), self.repair) for point in points
        ]
        points, values, converged, used = map(np.array, zip(*ends, strict=True))
        return Descent(points, values / self.power, converged, int(used.sum()))

    polish = descend_from_neighbours = descend

    def repair(self, point: Array) -> Array:
        """Keep frequencies within ten times the band, and dampings positive."""
        low, high = np.log([self.edges[0] / 10.0, self.edges[1] * 10.0])
        omega, zeta = point.reshape(2, -1)
        omega = np.clip(omega, low, high)
        return np.concatenate([omega, np.clip(zeta, self.narrowest - omega, LARGEST)])

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Random poles in the band, relocated."""
        omega = np.log(generator.uniform(*self.edges, (count, self.modes)))
        zeta = generator.uniform(np.log(1e-3), np.log(0.3), (count, self.modes))
        return np.array([self.relocated(point) for point in np.hstack([omega, zeta])])

    def neighbours(
        self, point: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The point with one section replaced by a random one."""
        drawn, starts = self.random(count, generator), np.tile(point, (count, 1))
        rows, places = np.arange(count), generator.integers(self.modes, size=count)
        for k in (places, places + self.modes):
            starts[rows, k] = drawn[rows, k]
        return starts, RELOCATIONS * count

    def relocated(self, point: Array) -> Array:
        """Poles moved to the zeros of the denominator that linear least squares add to them."""
        for _ in range(RELOCATIONS):
            basis = self._basis(point)[0]
            products = self.measured.T[:, :, None] * basis[:, :-1]  # (pairs, F, 2 modes)
            others = np.concatenate([products.real, products.imag], axis=1)
            direct = np.broadcast_to(stacked(basis), (len(others), *stacked(basis).shape))
            joined = np.concatenate([self.weights * direct, -self.weights * others, self.target], 2)
            triangle: Any = np.linalg.qr(joined, mode="r")
            left = triangle[:, basis.shape[1] : -1, basis.shape[1] :]
            rows = left.reshape(-1, left.shape[2])
            A = sections_dynamics(point)
            A[1::2] -= np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0]
            point = self.repair(_sections(np.linalg.eigvals(A).astype(complex)))
        return point

    def extended(self, point: Array) -> Array:
        """A point of one section fewer with one where its errors are largest."""
        smaller = FrequencyProblem(self.p, self.measured, self.of_lines, self.modes - 1)
        left = np.sum(smaller.solved(point)[0] ** 2, axis=(0, 2)).reshape(2, -1).sum(axis=0)
        omega, zeta = point.reshape(2, -1)
        peak = np.log(np.abs(self.p[int(np.argmax(left))]))
        return np.concatenate([omega, [peak], zeta, [np.log(0.01)]])


def descended_squares(
    equations: Callable[[Array], Equations], point: Array, repair: Callable[[Array], Array]
) -> tuple[Array, float, bool, int]:
    """Where damped Gauss-Newton steps end: point, value, whether they converged, evaluations."""
    present, used = equations(point), 1

    def tried(step: Array) -> float:
        nonlocal point, present, used
        moved = repair(point + step)
        new, used = equations(moved), used + 1
        gain = present[0] - new[0]
        if not gain > 0.0:
            return 0.0
        point, present = moved, new
        return gain

    done = Damping().descend(lambda: present[1:], tried, STEPS, CONVERGED * present[0])
    return point, present[0], done, used


def stacked(values: Any) -> Array:
    """Real parts above imaginary ones, (2F, …)."""
    return np.concatenate([values.real, values.imag])


def sections_dynamics(point: Any) -> Any:
    """A of the sections, block diagonal: ``[[0, ω], [-ω, -2 ζ ω]]`` each."""
    omega, zeta = np.exp(point.reshape(2, -1))
    first = np.arange(0, 2 * len(omega), 2)
    A = np.zeros((2 * len(omega),) * 2, dtype=point.dtype)
    A[first, first + 1], A[first + 1, first] = omega, -omega
    A[first + 1, first + 1] = -2.0 * zeta * omega
    return A


def _sections(poles: Complex) -> Array:
    """log ω, log ζ of sections with these poles, reflected into the stable half plane."""
    oscillating, real = poles[poles.imag > 0.0], np.sort(np.abs(poles[poles.imag == 0.0].real))
    omega = np.concatenate([np.abs(oscillating), np.sqrt(real[::2] * real[1::2])])
    halves = np.concatenate([np.abs(oscillating.real), 0.5 * (real[::2] + real[1::2])])
    return np.concatenate([np.log(omega), np.log(np.maximum(halves / omega, np.exp(SMALLEST)))])


def response_axis(frequencies: Array, sampling_rate: float | None, scale: float) -> Complex:
    """p at frequencies in Hz; of discrete time it needs no scale (rad/s)."""
    if sampling_rate is None:
        return np.asarray(2j * np.pi * frequencies / scale)
    return np.asarray(1j * np.tan(np.pi * frequencies / sampling_rate))


def lowest_poles(
    problem: FrequencyProblem, smaller: Array | None, generator: np.random.Generator
) -> SearchResult:
    """The lowest point of random starts, an extended smaller one, and basin hopping."""
    starts = [*problem.random(RESTARTS, generator)]
    starts += [problem.extended(smaller)] if smaller is not None else []
    ended, state = problem.descend(np.array(starts)), SearchProgress(problem, generator)
    state.minima = state.optima = ended.values[:RESTARTS].tolist()
    state.random_points, state.undiscovered = RESTARTS, undiscovered(state.minima)
    state.spent, lowest = ended.evaluations, int(np.argmin(ended.values))
    state.reach(ended.points[lowest], float(ended.values[lowest]))
    given: Any = problem  # has what basin hopping asks of it
    hopped = basin_hopping(given, ended.points[lowest], state.value, HOPPING, generator)
    state.spent += hopped.evaluations
    state.withstood = same_optimum(state.value, hopped.value)
    state.reach(hopped.point, hopped.value)
    return state.result()
