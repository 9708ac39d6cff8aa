"""Estimates of state-space models by linear algebra, for all orders and both forms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.starting_points import from_matrices, from_poles
from evopem.estimation.state_space.subspace import (
    Complex,
    PredictorModel,
    canonical_variates,
    instrumental_poles,
    largest_lag,
    long_arx,
    realised_poles,
)

Array = NDArray[np.float64]

# Lags of the long ARX models, and horizons of the instrumental estimates.
LAGS = (8, 20, 50)
HORIZONS = (10, 25)
# Largest order of most records.
USUAL_ORDER = 20

_Estimates = tuple[list[list[PredictorModel]], list[list[Complex]]]


class StartingModels:
    """Estimates by linear algebra of one record, for all orders and both forms.

    Parameters
    ----------
    errors : StateSpaceErrors
        Of any order and form.
    largest_order : int
    thorough : bool
        Several lags and horizons instead of one.
    """

    def __init__(self, errors: StateSpaceErrors, largest_order: int, thorough: bool) -> None:
        self._record, self._thorough = errors.record, thorough
        self._inputs = errors.record.inputs.shape[1]
        self._largest = largest_order
        self._made: dict[int, _Estimates] = {}

    def points(self, errors: StateSpaceErrors) -> Iterator[Array]:
        """Points of the order and form of a problem."""
        at = errors.order - 1
        predictors, found_poles = self._estimates(errors.order)
        for models in predictors:
            if at >= len(models):
                continue
            model = models[at]
            A, B = model.A, model.B
            if not errors.innovations:
                A, B = A + B[:, self._inputs :] @ model.C, B[:, : self._inputs]
            yield from_matrices(errors, A, B)
            yield from_poles(errors, np.asarray(np.linalg.eigvals(A), dtype=complex))
        for poles in found_poles:
            if at < len(poles) and not errors.innovations:
                yield from_poles(errors, poles[at])

    def _estimates(self, order: int) -> _Estimates:
        """Predictors and poles of all orders, made for the larger ones only where they are needed.

        Those take longer lags, which the smaller ones do not need.
        """
        largest = self._largest if order > USUAL_ORDER else min(self._largest, USUAL_ORDER)
        if largest not in self._made:
            self._made[largest] = self._made_for(largest)
        return self._made[largest]

    def _made_for(self, largest_order: int) -> _Estimates:
        record, thorough = self._record, self._thorough
        outputs = record.outputs.shape[1]
        least = -(-largest_order // outputs) + 2
        most = largest_lag(record)
        lags = sorted({min(max(lag, least), most) for lag in LAGS})
        if not thorough:
            lags = lags[len(lags) // 2 : len(lags) // 2 + 1]
        predictors, poles = [], []
        for lag in lags:
            arx = long_arx(record, lag)
            future = min(lag, max(10, least))
            predictors.append(canonical_variates(record, arx, future, largest_order))
            if thorough:
                poles.append(realised_poles(record, arx, largest_order))
        for horizon in HORIZONS if thorough else ():
            longest = (record.samples // (2 * self._inputs + 2 * outputs)) // 3
            wanted = min(max(horizon, least + 1), longest)
            if wanted > 2:
                poles.append(instrumental_poles(record, wanted, largest_order))
        return predictors, poles
