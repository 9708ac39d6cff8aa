"""Derivatives of all entries of the model of a point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.point_model import basis_of, constant_of, level_of, predictor_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Change:
    """Changes of what a point holds: in the states of the sections, and for scaled signals."""

    predictor: Array
    inputs: Array
    gain: Array
    outputs: Array
    feedthrough: Array
    constant: Array

    @classmethod
    def none(cls, errors: StateSpaceErrors) -> _Change:
        """No change yet."""
        n = errors.order
        nu, ny = errors.record.inputs.shape[1], errors.record.outputs.shape[1]
        return cls(
            predictor=np.zeros((n, n)),
            inputs=np.zeros((n, nu)),
            gain=np.zeros((n, ny)),
            outputs=np.zeros((ny, n)),
            feedthrough=np.zeros((ny, nu)),
            constant=np.zeros(ny),
        )


def entries_jacobian(errors: StateSpaceErrors, found: Projection) -> Array:
    """Derivatives of ``[A, B, C, D, K, level]`` by coordinates and linear coefficients.

    Linear coefficients stand output by output.
    """
    entries = _Entries(errors, found)
    columns = [entries.changed(each) for each in _of_coordinates(errors, found)]
    columns += [entries.changed(each) for each in _of_coefficients(errors, found)]
    return np.array(columns).T


class _Entries:
    """How the entries of the model of a point follow small changes."""

    def __init__(self, errors: StateSpaceErrors, found: Projection) -> None:
        record, n = errors.record, errors.order
        nu, ny = record.inputs.shape[1], record.outputs.shape[1]
        direct = np.flatnonzero(record.feedthrough)
        self._u, self._y = record.input_scales, record.output_scales
        self._basis = basis_of(errors, found)
        self._inverse = np.linalg.inv(self._basis)
        self._K, self._C = self._basis @ errors.gain(found), found.linear[:n].T @ self._inverse
        self._D = np.zeros((ny, nu))
        self._D[:, direct] = found.linear[n : n + len(direct)].T
        predictor = predictor_of(errors, found)
        self._resolvent = self._basis @ np.linalg.inv(np.eye(n) - predictor) @ self._inverse
        self._closed = np.eye(ny) - self._C @ self._resolvent @ self._K
        self._level = level_of(errors, found, constant_of(errors, found))

    def changed(self, change: _Change) -> Array:
        """Changes of all entries, one matrix after the other."""
        K, C, D, u, y = self._K, self._C, self._D, self._u, self._y
        resolvent = self._resolvent
        dP, dC = self._basis @ change.predictor @ self._inverse, change.outputs @ self._inverse
        dB, dK = self._basis @ change.inputs, self._basis @ change.gain
        dD = change.feedthrough
        dA = dP + dK @ C + K @ dC
        dBu = dB + dK @ D + K @ dD
        dfeedback = dC @ resolvent @ K + C @ resolvent @ (dK + dP @ resolvent @ K)
        dconstant = change.constant + dfeedback @ self._level
        dlevel = np.linalg.lstsq(self._closed, dconstant, rcond=None)[0]
        parts = (dA, dBu / u, dC * y[:, None], dD * y[:, None] / u, dK / y, y * dlevel)
        return np.concatenate([part.ravel() for part in parts])


def _of_coordinates(errors: StateSpaceErrors, found: Projection) -> Iterator[_Change]:
    """Changes by the coordinates: poles of the predictor, and inputs and gain of its sections."""
    layout, nu = errors.layout, errors.record.inputs.shape[1]
    for at in range(layout.dimension):
        change = _Change.none(errors)
        section, place = divmod(at, layout.pair_length)
        single = section >= layout.pairs
        if single:
            section, place = layout.pairs, at - layout.pairs * layout.pair_length
        first = 2 * section
        if place == 0:
            change.predictor[first, first] = 1.0
            if not single:
                change.predictor[first + 1, first + 1] = 1.0
        elif place == 1 and not single:
            change.predictor[first + 1, first] = 1.0 / found.sections.coupling[section]
        else:
            row, drive = divmod(place - (1 if single else 2), layout.drives)
            if drive < nu:
                change.inputs[first + row, drive] = 1.0
            elif drive < errors.driving:
                change.gain[first + row, drive - nu] = 1.0
        yield change


def _of_coefficients(errors: StateSpaceErrors, found: Projection) -> Iterator[_Change]:
    """Changes by the linear coefficients: C, D and constants; drift changes no entry."""
    record, n = errors.record, errors.order
    direct = np.flatnonzero(record.feedthrough)
    shares = np.diff(record.bounds) / record.samples
    for output in range(record.outputs.shape[1]):
        for place in range(found.regressors.shape[1]):
            change = _Change.none(errors)
            if place < n:
                change.outputs[output, place] = 1.0
            elif place < n + len(direct):
                change.feedthrough[output, direct[place - n]] = 1.0
            elif place < n + len(direct) + int(record.levels) * record.records:
                change.constant[output] = shares[place - n - len(direct)]
            yield change
