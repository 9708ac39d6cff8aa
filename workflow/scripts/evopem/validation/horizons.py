"""Prediction errors of a polynomial model against the horizon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.validation.scores import error_percent

Array = NDArray[np.float64]

# Horizons of a decade, and the longest one.
DECADE = (1, 2, 3, 5, 7)
LONGEST = 1000


def log_spaced_horizons(samples: int) -> tuple[int, ...]:
    """Horizons about evenly spaced in their logarithm, up to a quarter of a record.

    Examples
    --------
    >>> log_spaced_horizons(200)
    (1, 2, 3, 5, 7, 10, 20, 30, 50)
    """
    last = max(1, min(LONGEST, samples // 4))
    every = (10**decade * step for decade in range(4) for step in DECADE)
    return tuple(horizon for horizon in every if horizon <= last)


@dataclass(frozen=True)
class PredictedStretch:
    """A stretch to predict, with the model and states of its prediction.

    Attributes
    ----------
    model : PolynomialModel
    input, output : (N,) arrays
    states : (plant state, noise state)
        As for :meth:`PolynomialModel.predict`.
    first : int
        First sample that counts.
    """

    model: PolynomialModel
    input: Array
    output: Array
    states: tuple[Array, Array]
    first: int

    def ahead(self, horizon: int) -> Array:
        """Predictions of the samples that count."""
        return self.model.predict(self.input, self.output, horizon, *self.states)[self.first :]


def horizon_errors(stretches: Sequence[PredictedStretch], horizons: Sequence[int]) -> Array:
    """Errors ``100 ||y - yhat|| / ||y - mean(y)||`` of k-step predictions, one for each horizon.

    Parameters
    ----------
    stretches : sequence of PredictedStretch
    horizons : sequence of int
        Samples, each at least 1.
    """
    measured = np.concatenate([each.output[each.first :] for each in stretches])
    return np.array(
        [
            error_percent(measured, np.concatenate([each.ahead(horizon) for each in stretches]))
            for horizon in horizons
        ]
    )
