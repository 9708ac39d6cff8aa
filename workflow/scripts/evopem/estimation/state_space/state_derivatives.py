"""States of sections driven by the signals of a recording, and their derivatives.

The derivative by a coordinate moves at most two states, each by one of a few signals times a
factor.  Products of derivatives follow from those of the signals, whose number does not depend on
that of the outputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.kernels import (
    derivative_signals,
    section_responses,
    section_states,
)
from evopem.estimation.state_space.sections import Layout, Sections

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class SectionSignals:
    """What the drives of a recording give when they pass through sections.

    Parameters
    ----------
    layout : Layout
        Its drives are the signals, then a pulse at the beginning of each segment.
    driving : (N, signals) array
    bounds : (segments + 1,) integer array
        First sample of each segment, and N.
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
        responses: Array = section_responses(
            *self._driven_sections(sections), self._signals, self.bounds
        )
        return responses

    def derivatives(self, sections: Sections, states: Array) -> Array:
        """Signals that derivatives of the states by the coordinates consist of, (N, signals).

        The responses of the sections to the drives, then the derivatives of both states of each
        pair by sigma and by delta, then that of the single pole.

        Parameters
        ----------
        sections : Sections
        states : (N, n) array
            Of :meth:`states`.
        """
        layout = self.layout
        section = np.minimum(np.arange(layout.order) // 2, layout.sections - 1)
        signals: Array = derivative_signals(
            *self._driven_sections(sections),
            self._signals,
            section * layout.drives,
            np.repeat(sections.ratio, layout.drives),
            states,
            self.bounds,
        )
        return signals

    def _driven_sections(self, sections: Sections) -> tuple[NDArray, ...]:
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
        )


class Term(NamedTuple):
    """Of each coordinate a signal, the state that it moves, and a factor; each (n,)."""

    signals: Indices
    states: Indices
    factors: Array


class StateDerivatives:
    """Sums and products of the derivatives, (n,) over the coordinates of a layout.

    Parameters
    ----------
    layout : Layout
    """

    def __init__(self, layout: Layout) -> None:
        self.dimension = layout.dimension
        pairs, drives = layout.pairs, layout.drives
        count = layout.sections * drives
        extra = 2 * count
        first = np.zeros((2, self.dimension), dtype=np.intp)
        second = np.zeros((2, self.dimension), dtype=np.intp)
        # The section whose ratio is the factor of the second term: -1 for 1, -2 for 0.
        ratio_of = np.full(self.dimension, -1, dtype=np.intp)
        for m in range(pairs):
            at = m * layout.pair_length
            p = np.arange(m * drives, (m + 1) * drives)
            b1, b2 = slice(at + 2, at + 2 + drives), slice(at + 2 + drives, at + 2 + 2 * drives)
            first[0, at], second[0, at] = extra + m, extra + pairs + m
            first[0, at + 1], second[0, at + 1] = extra + 2 * pairs + m, extra + 3 * pairs + m
            first[0, b1], second[0, b1] = p, count + p
            first[0, b2], second[0, b2] = count + p, p
            ratio_of[b1] = m
            whole = slice(at, at + layout.pair_length)
            first[1, whole], second[1, whole] = 2 * m, 2 * m + 1
        if layout.single:
            at = pairs * layout.pair_length
            first[0, at] = extra + 4 * pairs
            first[0, at + 1 :] = np.arange(pairs * drives, (pairs + 1) * drives)
            first[1, at:] = second[1, at:] = layout.order - 1
            # The single pole moves one state.
            ratio_of[at:] = -2
        self._first, self._second, self._ratio_of = first, second, ratio_of

    def _terms(self, sections: Sections) -> tuple[Term, Term]:
        """The two terms of each derivative."""
        factors = np.ones(self.dimension)
        factors[self._ratio_of >= 0] = sections.ratio[self._ratio_of[self._ratio_of >= 0]]
        factors[self._ratio_of == -2] = 0.0
        return (
            Term(self._first[0], self._first[1], np.ones(self.dimension)),
            Term(self._second[0], self._second[1], factors),
        )

    def summed(self, sections: Sections, products: Array) -> Array:
        """Vector over coordinates, (n,), of products of signals and states, (signals, order)."""
        total = np.zeros(self.dimension)
        for signals, states, factors in self._terms(sections):
            total += factors * products[signals, states]
        return total

    def of_output(self, sections: Sections, signals: Array, c: Array) -> Array:
        """Derivatives by the coordinates of an output whose row of C is ``c``, (N, n).

        Parameters
        ----------
        sections : Sections
        signals : (N, signals) array
        c : (order,) array
        """
        total = np.zeros((len(signals), self.dimension))
        for columns, states, factors in self._terms(sections):
            total += signals[:, columns] * (factors * c[states])
        return total

    def contracted(self, sections: Sections, gram: Array, by_state: Array) -> Array:
        """Matrix over coordinates, (n, n), of the Gram matrix of signals and one of states."""
        matrix = np.zeros((self.dimension, self.dimension))
        terms = self._terms(sections)
        for columns, states, factors in terms:
            for other_columns, other_states, other_factors in terms:
                matrix += (
                    np.outer(factors, other_factors)
                    * gram[np.ix_(columns, other_columns)]
                    * by_state[np.ix_(states, other_states)]
                )
        return matrix

    def by_linear(self, sections: Sections, cross: Array, by_state: Array) -> Array:
        """Matrix over coordinates and linear coefficients, (n, ny q).

        Of the products of signals and regressors, (signals, q), and a matrix over states and
        outputs, (order, ny).  Linear coefficients stand output by output.
        """
        matrix = np.zeros((self.dimension, by_state.shape[1] * cross.shape[1]))
        for columns, states, factors in self._terms(sections):
            products = by_state[states][:, :, None] * cross[columns][:, None, :]
            matrix += factors[:, None] * products.reshape(self.dimension, -1)
        return matrix
