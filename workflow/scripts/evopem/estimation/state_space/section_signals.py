"""States of sections driven by the signals of a recording, and their derivatives.

Sections follow ``p+ = sigma p + back r + z, r+ = coupling p + sigma r`` with a signal z.  The
derivative by a coordinate moves at most two states, each by one of a few signals times a factor.
Products of derivatives follow from those of the signals, whose number does not depend on that of
the outputs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.kernels import derivative_signals, section_states
from evopem.estimation.state_space.sections import Layout, Sections

Array = NDArray[np.float64]


class SectionSignals:
    """What the drives of a recording give when they pass through sections.

    The drives of a layout are the signals ``driving``, (N, signals), then a pulse at the beginning
    of each segment; ``bounds``, (segments + 1,), are the first samples of the segments, and N.
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
    """Sums and products of derivatives over the n coordinates of a layout.

    Each derivative is a sum of two terms: a signal that moves a state, times a factor.
    """

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
        self._signals, self._states = signals, states

    def _terms(self, sections: Sections) -> Iterator[tuple[NDArray, NDArray, Array]]:
        """Of each of the two terms the signals, states and factors, each (n,)."""
        factors = np.ones((2, self.dimension))
        factors[1] = np.where(self._ratio_of < 0, 1.0, sections.ratio[self._ratio_of])
        # The single pole moves one state.
        factors[1, self._single] = 0.0
        return zip(self._signals, self._states, factors, strict=True)

    def summed(self, sections: Sections, products: Array) -> Array:
        """Vector over coordinates, (n,), of products of signals and states, (signals, order)."""
        total = np.zeros(self.dimension)
        for signals, states, factors in self._terms(sections):
            total += factors * products[signals, states]
        return total

    def of_output(self, sections: Sections, signals: Array, c: Array) -> Array:
        """Derivatives by the coordinates, (N, n), of an output with the row ``c`` of C."""
        total = np.zeros((len(signals), self.dimension))
        for columns, states, factors in self._terms(sections):
            total += signals[:, columns] * (factors * c[states])
        return total

    def contracted(self, sections: Sections, gram: Array, by_state: Array) -> Array:
        """Matrix over coordinates, (n, n), of the Gram matrix of signals and one of states."""
        matrix = np.zeros((self.dimension, self.dimension))
        terms = list(self._terms(sections))
        for columns, states, factors in terms:
            for other_columns, other_states, other_factors in terms:
                matrix += (
                    np.outer(factors, other_factors)
                    * gram[np.ix_(columns, other_columns)]
                    * by_state[np.ix_(states, other_states)]
                )
        return matrix

    def by_linear(self, sections: Sections, cross: Array, by_state: Array) -> Array:
        """Matrix over coordinates and linear coefficients output by output, (n, ny q).

        Of the products of signals and regressors, (signals, q), and a matrix over states and
        outputs, (order, ny).
        """
        matrix = np.zeros((self.dimension, by_state.shape[1] * cross.shape[1]))
        for columns, states, factors in self._terms(sections):
            products = by_state[states][:, :, None] * cross[columns][:, None, :]
            matrix += factors[:, None] * products.reshape(self.dimension, -1)
        return matrix
