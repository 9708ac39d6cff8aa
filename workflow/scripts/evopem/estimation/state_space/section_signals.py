"""Signals of the sections of state-space models on a record: states, responses, derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.kernels import (
    derivative_signals,
    section_responses,
    section_states,
)
from evopem.estimation.state_space.sections import Layout, Sections

Array = NDArray[np.float64]


class SectionSignals:
    """What the drives of a record give when they pass through sections.

    Parameters
    ----------
    layout : Layout
        Its drives are the signals, then a pulse at the beginning of each record.
    driving : (N, signals) array
    bounds : (records + 1,) integer array
        First sample of each record, and N.
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
        found: Array = section_responses(
            *self._driven_sections(sections), self._signals, self.bounds
        )
        return found

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
        layout, records = self.layout, len(self.bounds) - 1
        drives = layout.drives
        driven_by = np.minimum(np.arange(drives), self.driving)
        pulses = np.zeros((records, layout.sections, drives))
        for k in range(records):
            pulses[k, :, self.driving + k] = 1.0
        return (
            np.repeat(sections.sigma, drives),
            np.repeat(sections.coupling, drives),
            np.repeat(sections.back, drives),
            np.tile(driven_by, layout.sections),
            pulses.reshape(records, -1),
        )
