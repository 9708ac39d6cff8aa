"""The residuals of the estimation samples that tests use, of one stretch or of several."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import ScoringWindow
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import estimate_prediction_states
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TestedResiduals:
    """Residuals from the states that fit the samples best, with the input of the same samples.

    Those of several stretches stand one after the other: a correlation at lag k then has at most k
    products for each joint whose factors are of two stretches, and which have the mean zero.

    Attributes
    ----------
    residuals, input : (N,) arrays
    jacobian : callable
        Gives the derivatives of the residuals by everything estimated, in blocks of rows.
    """

    residuals: Array
    input: Array
    jacobian: Callable[[], Iterable[Array]]


def tested_residuals(
    model: PolynomialModel, estimation: Recording, start: int, objective: str
) -> TestedResiduals:
    """The residuals of the estimation samples, of each stretch from sample ``start`` on.

    Parameters
    ----------
    model : PolynomialModel
    estimation : Recording
    start : int
    objective : {"absolute", "quadratic"}

    Raises
    ------
    ValueError
        When none of several stretches is long enough.
    """
    if estimation.is_joined:
        return _of_stretches(model, estimation, start, objective)
    u, y, first = estimation.input, estimation.output, model.orders.first_residual
    states = estimate_prediction_states(model, u, y)
    residuals = model.residuals(u, y, *states)
    inputs = u if model.has_input else np.zeros_like(y)

    def jacobian() -> Iterable[Array]:
        level = model.level != 0.0
        errors = PolynomialErrors(u, y, model.orders, objective, first, start, 1.0, 1.0, level)
        levels = [model.level] if level else []
        return errors.jacobian_blocks(np.concatenate([model.parameters, levels, *states]))

    return TestedResiduals(residuals[start:], inputs[start:], jacobian)


def _of_stretches(
    model: PolynomialModel, estimation: Recording, start: int, objective: str
) -> TestedResiduals:
    orders = model.orders
    errors = StretchErrors(
        *(estimation.segments, orders, objective, 1.0, 1.0, model.level != 0.0),
        window=ScoringWindow(orders.first_residual, max(start, orders.first_residual)),
    )
    point = errors.completed_by_states(replace(model, covariance=None))
    inputs = errors.scored_inputs() if model.has_input else np.zeros_like(errors.scored_outputs())
    return TestedResiduals(errors.residuals(point), inputs, lambda: errors.jacobian_blocks(point))
