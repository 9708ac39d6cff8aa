"""Coordinates of state-space models: sections of two poles each, and how strongly they are driven.

A section has the poles ``sigma +- sqrt(delta)`` and the state matrix ``[[sigma, s], [delta / s,
sigma]]``, which depends smoothly on both where complex poles become real ones; the last section of
an odd order has one pole, and its second state is zero.  Sections are local coordinates of A up to
two directions each, along which errors do not change and Levenberg-Marquardt steps never go.
Output matrices are no coordinates: they follow by linear least squares.  With a signal z sections
follow ``p+ = sigma p + back r + z, r+ = coupling p + sigma r``; a derivative moves at most two
states, each by one of a few signals times a factor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Flags, Integers
from evopem.compilation import DECAYED, cached_njit, njit


@njit
def _respond(out, first, stop, sigma, coupling, back, driven_by, pulses, signals):
    """The responses p and r of one segment, in the first ``2 len(sigma)`` columns of ``out``."""
    count = len(sigma)
    for c in range(count):
        out[first, c], out[first, count + c] = pulses[c], 0.0
    for t in range(first, stop - 1):
        now, after, z = out[t], out[t + 1], signals[t]
        for c in range(count):
            p, r = now[c], now[count + c]
            next_p = sigma[c] * p + back[c] * r + z[driven_by[c]]
            next_r = coupling[c] * p + sigma[c] * r
            after[c] = next_p if abs(next_p) > DECAYED else 0.0
            after[count + c] = next_r if abs(next_r) > DECAYED else 0.0


@njit
def _advance(p, r, sigma, coupling, back, z):
    """One sample of sections whose p and r (S,) are overwritten."""
    for c in range(len(p)):
        next_p = sigma[c] * p[c] + back[c] * r[c] + z[c]
        next_r = coupling[c] * p[c] + sigma[c] * r[c]
        p[c] = next_p if abs(next_p) > DECAYED else 0.0
        r[c] = next_r if abs(next_r) > DECAYED else 0.0


@cached_njit
def derivative_signals(sigma, coupling, back, driven_by, pulses, signals, ratio, states, bounds):
    """The signals of which derivatives of the states of sections, (N, 2 S), consist.

    The first three hold an entry for each section and signal that drives it, the column
    ``driven_by`` of ``signals``; ``pulses``, (segments, entries), are p at the first sample of each
    segment.

    (N, 2 entries + 4 S): the responses p, then r, of the entries; for each section the derivatives
    of its second state by sigma, and s times that by delta; the same of the first states.
    """
    pairs, extra = len(ratio), 2 * len(sigma)
    of_state = np.repeat(np.arange(pairs) * (len(sigma) // max(pairs, 1)), 2)
    own_sigma, own_coupling, own_back = sigma[of_state], coupling[of_state], back[of_state]
    out = np.empty((len(signals), extra + 4 * pairs))
    p, r = np.empty(2 * pairs), np.empty(2 * pairs)
    for segment in range(len(bounds) - 1):
        first, stop = bounds[segment], bounds[segment + 1]
        _respond(out, first, stop, sigma, coupling, back, driven_by, pulses[segment], signals)
        p[:] = 0.0
        r[:] = 0.0
        for t in range(first, stop):
            now = out[t]
            for m in range(pairs):
                even, odd = 2 * m, 2 * m + 1
                now[extra + even] = ratio[m] * r[even] + p[odd]
                now[extra + odd] = p[even]
                now[extra + 2 * pairs + even] = p[even] + r[odd]
                now[extra + 2 * pairs + odd] = r[even]
            _advance(p, r, own_sigma, own_coupling, own_back, states[t])
    return out


@cached_njit
def section_states(sigma, coupling, back, initial, inputs, bounds):
    """States of sections, (N, n), from initial states (segments, n); an odd n ends with a pole."""
    states = np.empty(inputs.shape)
    n = inputs.shape[1]
    for segment in range(len(bounds) - 1):
        first, stop = bounds[segment], bounds[segment + 1]
        for i in range(n):
            states[first, i] = initial[segment, i]
        for t in range(first, stop - 1):
            now, after, z = states[t], states[t + 1], inputs[t]
            for c in range(len(sigma)):
                even, odd = 2 * c, 2 * c + 1
                second = now[odd] if odd < n else 0.0
                moved = sigma[c] * now[even] + coupling[c] * second + z[even]
                after[even] = moved if abs(moved) > DECAYED else 0.0
                if odd < n:
                    moved = back[c] * now[even] + sigma[c] * second + z[odd]
                    after[odd] = moved if abs(moved) > DECAYED else 0.0
    return states


@cached_njit
def contracted(factors, signals, states, gram, by_state):
    """Sums over two terms each, (n, n), of products of entries of two matrices; see below."""
    n = len(factors) // 2
    out = np.empty((n, n))
    for row in range(n):
        for column in range(row + 1):
            total = 0.0
            for i in (row, n + row):
                for j in (column, n + column):
                    entry = gram[signals[i], signals[j]] * by_state[states[i], states[j]]
                    total += factors[i] * factors[j] * entry
            out[row, column] = out[column, row] = total
    return out


# Least magnitude of delta for which s = sqrt(|delta|), which makes a section's two states of one
# size; s stays as it is below.
SMALLEST_DELTA = 1e-6


@dataclass(frozen=True)
class Layout:
    """Where the coordinates of a model of some order stand in a point.

    ``[sigma, delta, b1 (drives), b2 (drives)]`` for each section; of the single pole of an odd
    order delta and b2 are zero, and nothing depends on them.  Drives are inputs, for innovations
    form outputs, and a pulse for the initial state of each segment.
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
    def dimension(self) -> int:
        """Length of a point."""
        return self.sections * (2 + 2 * self.drives)

    def rows(self, point: NDArray) -> NDArray:
        """View of the coordinates, (sections, 2 + 2 drives), or of columns of them."""
        shape = self.sections, 2 + 2 * self.drives, *point.shape[1:]
        return point[: self.dimension].reshape(shape)

    def free(self) -> Flags:
        """Whether anything depends on each coordinate, (sections, 2 + 2 drives)."""
        free = np.ones((self.sections, 2 + 2 * self.drives), dtype=bool)
        if self.single:
            free[-1, 1] = free[-1, 2 + self.drives :] = False
        return free


@dataclass(frozen=True, eq=False)
class SectionArrays:
    """The sections of a point as arrays, (sections,)."""

    sigma: Array
    scale: Array  # s
    coupling: Array  # s, or 0 of the single pole
    back: Array  # delta / s
    b1: Array  # (sections, drives): input matrix of the first states
    b2: Array

    @property
    def ratio(self) -> Array:
        """``delta / s**2``, between -1 and 1."""
        return self.back / self.scale


def scale_of(delta: Array) -> Array:
    """``s`` of sections, (m,)."""
    return np.sqrt(np.maximum(np.abs(delta), SMALLEST_DELTA))


def sections_of(layout: Layout, point: Array, scale: Array | None = None) -> SectionArrays:
    """Read the sections of a point; their s may be given."""
    rows = layout.rows(point)
    sigma, delta = rows[:, 0].copy(), rows[:, 1]  # contiguous: one kernel, of one section too
    scale = scale_of(delta) if scale is None else scale
    coupling = scale.copy()
    coupling[layout.pairs :] = 0.0
    b1, b2 = np.split(rows[:, 2:], 2, axis=1)
    return SectionArrays(sigma, scale, coupling, delta / scale, b1, b2)


def rescaled(layout: Layout, before: Array, after: Array) -> Array:
    """How s of each section changes between two points, (sections,): its second state divides."""
    return scale_of(layout.rows(after)[:, 1]) / scale_of(layout.rows(before)[:, 1])


def moved(layout: Layout, point: Array, step: Array) -> Array:
    """A point after a step with the scale s of each section held; its second state is rescaled."""
    after = point + step
    layout.rows(after)[:, 2 + layout.drives :] /= rescaled(layout, point, after)[:, None]
    return after


def normalised(layout: Layout, point: Array) -> Array:
    """The point with inputs of unit size for each section, and sections by angle of their poles."""
    point = point.copy()
    rows = layout.rows(point)
    sizes = np.linalg.norm(rows[:, 2:], axis=1)
    rows[:, 2:] /= np.where(sizes > 0.0, sizes, 1.0)[:, None]
    angles = np.where(
        rows[:, 1] < 0.0, np.arctan2(np.sqrt(np.abs(rows[:, 1])), rows[:, 0]), -rows[:, 0] - 10.0
    )
    angles[layout.pairs :] = np.inf
    rows[:] = rows[np.argsort(angles, kind="stable")]
    return point


def largest_radius(layout: Layout, point: Array) -> float:
    """Largest radius of the poles of a point."""
    sigma, delta = layout.rows(point)[:, :2].T
    complex_ones = np.sqrt(np.maximum(sigma**2 - delta, 0.0))
    real_ones = np.abs(sigma) + np.sqrt(np.maximum(delta, 0.0))
    return float(np.max(np.where(delta < 0.0, complex_ones, real_ones)))


def drawn_in(sigma: Array, delta: Array, radius: float) -> tuple[Array, Array]:
    """Pairs of poles ``sigma +- sqrt(delta)``, those beyond a radius moved to it on their rays."""
    size = np.sqrt(np.maximum(sigma**2 - delta, 1e-300))
    factor = np.minimum(1.0, radius / size)
    half = np.sqrt(np.maximum(delta, 0.0))
    high, low = (np.clip(sigma + shift, -radius, radius) for shift in (half, -half))
    return (
        np.where(delta < 0.0, sigma * factor, 0.5 * (high + low)),
        np.where(delta < 0.0, delta * factor**2, 0.25 * (high - low) ** 2),
    )


def inside(layout: Layout, point: Array, radius: float) -> Array:
    """The point with poles beyond a radius moved to it along their rays."""
    if largest_radius(layout, point) <= radius:
        return point
    after = point.copy()
    rows = layout.rows(after)
    rows[:, 0], rows[:, 1] = drawn_in(rows[:, 0], rows[:, 1], radius)
    rows[:, 2 + layout.drives :] /= rescaled(layout, point, after)[:, None]
    return after


def state_matrix(sections: SectionArrays, layout: Layout) -> Array:
    """Block-diagonal state matrix of a point, (n, n), or its derivatives with a last axis."""
    first = np.arange(0, 2 * layout.sections, 2)
    A = np.zeros((2 * len(first), 2 * len(first), *sections.sigma.shape[1:]), sections.sigma.dtype)
    A[first, first] = A[first + 1, first + 1] = sections.sigma
    A[first, first + 1], A[first + 1, first] = sections.coupling, sections.back
    return A[: layout.order, : layout.order]


def input_matrix(sections: SectionArrays, layout: Layout) -> Array:
    """Columns by which the drives enter the states, (n, drives); derivatives as above."""
    B = np.stack([sections.b1, sections.b2], axis=1).reshape(-1, *sections.b1.shape[1:])
    return B[: layout.order]


def with_drives(layout: Layout, point: Array, drives: slice, B: Array) -> Array:
    """The point with other columns, (n, drives), by which some drives enter the states."""
    point, padded = point.copy(), np.zeros((2 * layout.sections, B.shape[1]))
    padded[: layout.order] = B
    rows = layout.rows(point)
    rows[:, 2 : 2 + layout.drives][:, drives] = padded[0::2]
    rows[:, 2 + layout.drives :][:, drives] = padded[1::2]
    return point


class SectionSignals:
    """What drives of a recording give when they pass through sections, and derivatives of states.

    Drives are the signals ``driving``, (N, signals), then a pulse at the begin of each of
    ``bounds``.  A derivative is the sum of two signals that move a state each, times factors.
    """

    def __init__(self, layout: Layout, driving: Array, bounds: Integers) -> None:
        self.layout, self.bounds = layout, bounds
        self.driving, self.of_drives = driving.shape[1], driving
        # The last column, of zeros, drives the responses to initial states.
        self._signals = np.column_stack([driving, np.zeros(len(driving))])
        self._shape = 2, layout.sections, 2 + 2 * layout.drives
        count = layout.sections * layout.drives
        m = np.arange(layout.sections)[:, None]
        p = m * layout.drives + np.arange(layout.drives)
        # Of each term and coordinate; those by sigma and delta of a section stand behind responses.
        by_sigma = 2 * (count + len(m) + m), 2 * (count + m)
        by_delta = tuple(place + 1 for place in by_sigma)
        self._columns = np.array(
            [
                np.hstack([by_sigma[0], by_delta[0], p, count + p]),
                np.hstack([by_sigma[1], by_delta[1], count + p, p]),
            ]
        ).ravel()
        states = np.broadcast_to(np.stack([2 * m, 2 * m + 1]), self._shape)
        # The single pole moves one state.
        self._free = layout.free() & (states < layout.order)
        self._states = np.minimum(states, layout.order - 1).ravel()

    def responses(self, sections: SectionArrays) -> Array:
        """Responses p, then r, of each section to each drive, (N, 2 sections drives)."""
        return self._derivatives(sections, np.empty((len(self._signals), 0)), np.empty(0))

    def derivatives(self, sections: SectionArrays, states: Array) -> Array:
        """Signals that derivatives of states, (N, n), by the coordinates consist of."""
        second = np.zeros((len(states), int(self.layout.single)))
        return self._derivatives(sections, np.hstack([states, second]), sections.ratio)

    def _derivatives(self, sections: SectionArrays, states: Array, ratio: Array) -> Array:
        """The responses, and signals of the sections whose states are given."""
        layout, segments = self.layout, len(self.bounds) - 1
        drives = layout.drives
        pulses = np.zeros((segments, layout.sections, drives))
        k = np.arange(segments)
        pulses[k, :, self.driving + k] = 1.0
        signals: Array = derivative_signals(
            *(np.repeat(parts, drives) for parts in (sections.sigma, sections.coupling)),
            np.repeat(sections.back, drives),
            np.tile(np.minimum(np.arange(drives), self.driving), layout.sections),
            *(pulses.reshape(segments, -1), self._signals, ratio, states, self.bounds),
        )
        return signals

    def _terms(self, sections: SectionArrays) -> tuple[NDArray, NDArray, Array]:
        """Signals, states and factors of the first terms, then of the second ones, (2 n,)."""
        factors = np.ones(self._shape)
        factors[:, :, 1] = 1.0 / sections.scale
        factors[1, :, 2 : 2 + self.layout.drives] = sections.ratio[:, None]
        return self._columns, self._states, (factors * self._free).ravel()

    def summed(self, sections: SectionArrays, products: Array) -> Array:
        """Vector over coordinates, (n,), of products of signals and states, (signals, order)."""
        signals, states, factors = self._terms(sections)
        terms = factors * products[signals, states]
        n = self.layout.dimension
        return np.asarray(terms[:n] + terms[n:])

    def of_output(self, sections: SectionArrays, signals: Array, c: Array) -> Array:
        """Derivatives by the coordinates, (N, n), of an output with the row ``c`` of C."""
        columns, states, factors = self._terms(sections)
        terms = signals[:, columns] * (factors * c[states])
        n = self.layout.dimension
        return np.asarray(terms[:, :n] + terms[:, n:])

    def contracted(self, sections: SectionArrays, gram: Array, by_state: Array) -> Array:
        """Matrix over coordinates, (n, n), of the Gram matrix of signals and one of states."""
        signals, states, factors = self._terms(sections)
        return np.asarray(contracted(factors, signals, states, gram, by_state))

    def across(self, sections: SectionArrays, products: Array, by_state: Array) -> Array:
        """Products with regressors of each output, (n, l q), from those of signals, (signals, q).

        ``by_state``: weights of the states in each output, (order, l).
        """
        signals, states, factors = self._terms(sections)
        n, weights = self.layout.dimension, factors[:, None] * by_state[states]
        terms = weights[:, :, None] * products[signals][:, None, :]
        return np.asarray((terms[:n] + terms[n:]).reshape(n, -1))
