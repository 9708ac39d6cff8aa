"""Coordinates of state-space models: sections of two poles each, and how strongly they are driven.

A section has the poles ``sigma +- sqrt(delta)`` and the state matrix ``[[sigma, s], [delta / s,
sigma]]``, which depends smoothly on both where complex poles become real ones; an odd order has one
real pole more.  Sections are local coordinates of A up to two directions each, along which errors
do not change and Levenberg-Marquardt steps never go.  Output matrices are no coordinates: they
follow by linear least squares.  With a signal z sections follow ``p+ = sigma p + back r + z, r+ =
coupling p + sigma r``; a derivative moves at most two states, each by one of a few signals times a
factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.kernels import derivative_signals, section_states

Array = NDArray[np.float64]

# Least magnitude of delta for which s = sqrt(|delta|), which makes a section's two states of one
# size; s stays as it is below.
SMALLEST_DELTA = 1e-6


@dataclass(frozen=True)
class Layout:
    """Where the coordinates of a model of some order stand in a point.

    ``[sigma, delta, b1 (drives), b2 (drives)]`` for each pair, then ``[sigma, b (drives)]`` of the
    real pole of an odd order.  Drives are inputs, for innovations form outputs, and a pulse for the
    initial state of each segment.
    """

    order: int
    drives: int

    @property
    def pairs(self) -> int:
        """Number of pairs of poles."""
        return self.order // 2

    @property
    def single(self) -> bool:
        """Whether there is a real pole more."""
        return self.order % 2 == 1

    @property
    def sections(self) -> int:
        """Pairs, and the single pole."""
        return self.pairs + int(self.single)

    @property
    def pair_length(self) -> int:
        """Coordinates of a pair."""
        return 2 + 2 * self.drives

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.pairs * self.pair_length + int(self.single) * (1 + self.drives)

    def pair_rows(self, point: Array) -> Array:
        """View of the coordinates of the pairs, (pairs, pair_length)."""
        return point[: self.pairs * self.pair_length].reshape(self.pairs, self.pair_length)

    def single_row(self, point: Array) -> Array:
        """View of the coordinates of the single pole, (1 + drives,), or empty."""
        return point[self.pairs * self.pair_length :]


@dataclass(frozen=True, eq=False)
class Sections:
    """The sections of a point as arrays, (sections,); the single pole is one without coupling."""

    sigma: Array
    coupling: Array  # s
    back: Array  # delta / s
    ratio: Array  # delta / s**2, between -1 and 1
    b1: Array  # (sections, drives): input matrix of the first states
    b2: Array


def scale_of(delta: Array) -> Array:
    """``s`` of sections, (m,)."""
    return np.sqrt(np.maximum(np.abs(delta), SMALLEST_DELTA))


def sections_of(layout: Layout, point: Array, coupling: Array | None = None) -> Sections:
    """Read the sections of a point; their s may be given."""
    pairs, drives = layout.pair_rows(point), layout.drives
    sigma, delta = pairs[:, 0], pairs[:, 1]
    coupling = scale_of(delta) if coupling is None else coupling[: layout.pairs]
    b1, b2 = pairs[:, 2 : 2 + drives], pairs[:, 2 + drives :]
    back = delta / coupling
    ratio = back / coupling
    if layout.single:
        row = layout.single_row(point)
        sigma = np.append(sigma, row[0])
        coupling, back = np.append(coupling, 0.0), np.append(back, 0.0)
        ratio = np.append(ratio, 0.0)
        b1 = np.vstack([b1, row[1:]])
        b2 = np.vstack([b2, np.zeros(drives)])
    return Sections(sigma, coupling, back, ratio, b1, b2)


def moved(layout: Layout, point: Array, step: Array) -> Array:
    """A point after a step with the scale s of each section held; its second state is rescaled."""
    after = point + step
    if layout.pairs:
        old = scale_of(layout.pair_rows(point)[:, 1])
        rows = layout.pair_rows(after)
        rows[:, 2 + layout.drives :] *= (old / scale_of(rows[:, 1]))[:, None]
    return after


def normalised(layout: Layout, point: Array) -> Array:
    """The point with inputs of unit size for each section, and sections by angle of their poles."""
    point = point.copy()
    rows = layout.pair_rows(point)
    sizes = np.linalg.norm(rows[:, 2:], axis=1)
    rows[:, 2:] /= np.where(sizes > 0.0, sizes, 1.0)[:, None]
    angles = np.where(
        rows[:, 1] < 0.0, np.arctan2(np.sqrt(np.abs(rows[:, 1])), rows[:, 0]), -rows[:, 0] - 10.0
    )
    rows[:] = rows[np.argsort(angles, kind="stable")]
    if layout.single:
        row = layout.single_row(point)
        size = np.linalg.norm(row[1:])
        row[1:] /= size if size > 0.0 else 1.0
    return point


def largest_radius(layout: Layout, point: Array) -> float:
    """Largest radius of the poles of a point."""
    rows = layout.pair_rows(point)
    radii = np.where(
        rows[:, 1] < 0.0,
        np.sqrt(np.maximum(rows[:, 0] ** 2 - rows[:, 1], 0.0)),
        np.abs(rows[:, 0]) + np.sqrt(np.maximum(rows[:, 1], 0.0)),
    )
    if layout.single:
        radii = np.append(radii, abs(layout.single_row(point)[0]))
    return float(np.max(radii))


def drawn_in(sigma: Array, delta: Array, radius: float) -> tuple[Array, Array]:
    """Pairs of poles ``sigma +- sqrt(delta)``, those beyond a radius moved to it on their rays."""
    size = np.sqrt(np.maximum(sigma**2 - delta, 1e-300))
    factor = np.minimum(1.0, radius / size)
    half = np.sqrt(np.maximum(delta, 0.0))
    high, low = (np.clip(sigma + each, -radius, radius) for each in (half, -half))
    return (
        np.where(delta < 0.0, sigma * factor, 0.5 * (high + low)),
        np.where(delta < 0.0, delta * factor**2, 0.25 * (high - low) ** 2),
    )


def inside(layout: Layout, point: Array, radius: float) -> Array:
    """The point with poles beyond a radius moved to it along their rays."""
    if largest_radius(layout, point) <= radius:
        return point
    point = point.copy()
    rows = layout.pair_rows(point)
    old = scale_of(rows[:, 1])
    rows[:, 0], rows[:, 1] = drawn_in(rows[:, 0], rows[:, 1], radius)
    rows[:, 2 + layout.drives :] *= (old / scale_of(rows[:, 1]))[:, None]
    if layout.single:
        row = layout.single_row(point)
        row[0] = np.clip(row[0], -radius, radius)
    return point


def state_matrix(sections: Sections, layout: Layout) -> Array:
    """Block-diagonal state matrix of a point, (n, n)."""
    A = np.zeros((layout.order, layout.order), dtype=sections.sigma.dtype)
    for m in range(layout.pairs):
        i = 2 * m
        A[i, i] = A[i + 1, i + 1] = sections.sigma[m]
        A[i, i + 1] = sections.coupling[m]
        A[i + 1, i] = sections.back[m]
    if layout.single:
        A[-1, -1] = sections.sigma[-1]
    return A


def input_matrix(sections: Sections, layout: Layout) -> Array:
    """Columns by which the drives enter the states, (n, drives)."""
    B = np.zeros((layout.order, layout.drives), dtype=sections.b1.dtype)
    B[0 : 2 * layout.pairs : 2] = sections.b1[: layout.pairs]
    B[1 : 2 * layout.pairs : 2] = sections.b2[: layout.pairs]
    if layout.single:
        B[-1] = sections.b1[-1]
    return B


def with_drives(layout: Layout, point: Array, drives: slice, B: Array) -> Array:
    """The point with other columns, (n, drives), by which some drives enter the states."""
    point, pairs = point.copy(), 2 * layout.pairs
    rows = layout.pair_rows(point)
    rows[:, 2 : 2 + layout.drives][:, drives] = B[0:pairs:2]
    rows[:, 2 + layout.drives :][:, drives] = B[1:pairs:2]
    if layout.single:
        layout.single_row(point)[1:][drives] = B[-1]
    return point


class SectionSignals:
    """What the drives of a recording give when they pass through sections.

    Drives are the signals ``driving``, (N, signals), then a pulse at the begin of each of
    ``bounds``.
    """

    def __init__(self, layout: Layout, driving: Array, bounds: NDArray[np.int64]) -> None:
        self.layout, self.bounds = layout, bounds
        self.driving = driving.shape[1]
        # The last column, of zeros, drives the responses to initial states.
        self._signals = np.column_stack([driving, np.zeros(len(driving))])

    def states(self, sections: Sections) -> Array:
        """States driven by all signals, (N, n): one response for each instead of each drive."""
        inputs = np.vstack([sections.b1, sections.b2])
        states: Array = section_states(
            sections.sigma,
            sections.coupling,
            sections.back,
            sections.ratio,
            np.ascontiguousarray(inputs[:, self.driving :].T),
            self._signals[:, : self.driving] @ inputs[:, : self.driving].T,
            self.bounds,
            self.layout.order,
        )
        return states

    def responses(self, sections: Sections) -> Array:
        """Responses of each section to each drive, (N, 2 sections drives)."""
        none = np.empty(0, dtype=np.intp), np.empty(0), np.empty((len(self._signals), 0))
        responses: Array = derivative_signals(*self._driven(sections), *none, self.bounds)
        return responses

    def derivatives(self, sections: Sections, states: Array) -> Array:
        """Signals that derivatives of :meth:`states`, (N, n), by the coordinates consist of."""
        layout = self.layout
        section = np.minimum(np.arange(layout.order) // 2, layout.sections - 1)
        ratio = np.repeat(sections.ratio, layout.drives)
        signals: Array = derivative_signals(
            *(*self._driven(sections), section * layout.drives, ratio, states, self.bounds)
        )
        return signals

    def _driven(self, sections: Sections) -> tuple[NDArray, ...]:
        """Of each section and drive: its sigma, coupling and back, its signal, and its pulses."""
        layout, segments = self.layout, len(self.bounds) - 1
        drives = layout.drives
        driven_by = np.minimum(np.arange(drives), self.driving)
        pulses = np.zeros((segments, layout.sections, drives))
        for k in range(segments):
            pulses[k, :, self.driving + k] = 1.0
        return (
            np.repeat(sections.sigma, drives),
            np.repeat(sections.coupling, drives),
            np.repeat(sections.back, drives),
            np.tile(driven_by, layout.sections),
            pulses.reshape(segments, -1),
            self._signals,
        )


class StateDerivatives:
    """Sums and products of derivatives: each two signals that move a state, times factors."""

    def __init__(self, layout: Layout) -> None:
        self.dimension = layout.dimension
        pairs, drives = layout.pairs, layout.drives
        count = layout.sections * drives
        extra = 2 * count
        # Of each term and coordinate.
        signals = np.zeros((2, self.dimension), dtype=np.intp)
        states = np.zeros((2, self.dimension), dtype=np.intp)
        # The section whose ratio is the factor of the second term, or -1 for 1.
        self._ratio_of = np.full(self.dimension, -1, dtype=np.intp)
        for m in range(pairs):
            at = m * layout.pair_length
            p = np.arange(m * drives, (m + 1) * drives)
            b1, b2 = slice(at + 2, at + 2 + drives), slice(at + 2 + drives, at + 2 + 2 * drives)
            signals[:, at] = extra + m, extra + pairs + m
            signals[:, at + 1] = extra + 2 * pairs + m, extra + 3 * pairs + m
            signals[:, b1] = p, count + p
            signals[:, b2] = count + p, p
            self._ratio_of[b1] = m
            states[:, at : at + layout.pair_length] = [[2 * m], [2 * m + 1]]
        self._single = slice(pairs * layout.pair_length, self.dimension)
        if layout.single:
            at = self._single.start
            signals[0, at] = extra + 4 * pairs
            signals[0, at + 1 :] = np.arange(pairs * drives, (pairs + 1) * drives)
            states[:, at:] = layout.order - 1
        self._signals, self._states = signals.ravel(), states.ravel()

    def _terms(self, sections: Sections) -> tuple[NDArray, NDArray, Array]:
        """Signals, states and factors of the first terms, then of the second ones, (2 n,)."""
        factors = np.ones((2, self.dimension))
        factors[1] = np.where(self._ratio_of < 0, 1.0, sections.ratio[self._ratio_of])
        # The single pole moves one state.
        factors[1, self._single] = 0.0
        return self._signals, self._states, factors.ravel()

    def summed(self, sections: Sections, products: Array) -> Array:
        """Vector over coordinates, (n,), of products of signals and states, (signals, order)."""
        signals, states, factors = self._terms(sections)
        terms = factors * products[signals, states]
        return np.asarray(terms[: self.dimension] + terms[self.dimension :])

    def of_output(self, sections: Sections, signals: Array, c: Array) -> Array:
        """Derivatives by the coordinates, (N, n), of an output with the row ``c`` of C."""
        columns, states, factors = self._terms(sections)
        terms = signals[:, columns] * (factors * c[states])
        return np.asarray(terms[:, : self.dimension] + terms[:, self.dimension :])

    def contracted(self, sections: Sections, gram: Array, by_state: Array) -> Array:
        """Matrix over coordinates, (n, n), of the Gram matrix of signals and one of states."""
        signals, states, factors = self._terms(sections)
        terms = np.outer(factors, factors) * gram[np.ix_(signals, signals)]
        terms *= by_state[np.ix_(states, states)]
        n = self.dimension
        return np.asarray(terms[:n, :n] + terms[:n, n:] + terms[n:, :n] + terms[n:, n:])

    def by_linear(self, sections: Sections, cross: Array, by_state: Array) -> Array:
        """Matrix over coordinates and linear coefficients output by output, (n, ny q).

        Of the products of signals and regressors, (signals, q), and of states and outputs, (order,
        ny).
        """
        signals, states, factors = self._terms(sections)
        products = by_state[states][:, :, None] * cross[signals][:, None, :]
        terms = factors[:, None] * products.reshape(len(factors), -1)
        return np.asarray(terms[: self.dimension] + terms[self.dimension :])
