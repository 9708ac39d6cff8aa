"""Fits of one model to several stretches: local descents from structured starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.search.staged_descent import Stage
from evopem.estimation.search.stretch_problem import SWEEP_STAGES, StretchProblem
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment

Array = NDArray[np.float64]

# Poles as slow as this act as integrators in any record; closer to the circle nothing changes.
PLANT_RADIUS = 1.0 - 1e-7
NOISE_RADIUS = 0.9999
# Scores of folds need no more digits than these descents give.
FOLD_STAGES = (Stage(0.1, 1e-7, 1e-4),)


@dataclass(frozen=True)
class FitSettings:
    """What all fits of one record have in common.

    Attributes
    ----------
    objective : {"absolute", "quadratic"}
    level : bool
        Whether a constant is estimated for each recording.
    """

    objective: str = "quadratic"
    level: bool = True


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to stretches.

    Attributes
    ----------
    model : PolynomialModel
        Its level is that of the first recording.
    levels : tuple of float
        One for each recording.
    residuals : tuple of (M,) arrays
        Of each stretch, from the first residual on.
    objective : float
        Percent.
    """

    model: PolynomialModel
    levels: tuple[float, ...]
    residuals: tuple[Array, ...] = field(repr=False)
    objective: float

    @property
    def orders(self) -> Orders:
        """Orders of the model."""
        return self.model.orders

    @property
    def parameters(self) -> int:
        """Coefficients and levels."""
        return self.orders.parameters + len(self.levels)

    def residuals_from(self, first: int = 0) -> Array:
        """The residuals from sample ``first`` of each stretch on."""
        start = self.orders.first_residual
        return np.concatenate([each[max(first - start, 0) :] for each in self.residuals])


def log_loss(errors: Array, objective: str) -> float:
    """Twice the smallest negative log-likelihood of an error, over the scale of its distribution.

    Of the normal distribution for the quadratic objective, of Laplace's for the absolute one: twice
    the logarithm of the root mean square, or mean absolute, error and a constant.

    Parameters
    ----------
    errors : (N,) array
    objective : {"absolute", "quadratic"}
    """
    tiny, huge = np.finfo(float).tiny, np.finfo(float).max
    with np.errstate(all="ignore"):
        if objective == "absolute":
            size, constant = float(np.mean(np.abs(errors))), 2.0 * np.log(2.0) + 2.0
        else:
            size = float(np.sqrt(np.mean(errors**2)))
            constant = float(np.log(2.0 * np.pi)) + 1.0
    size = size if np.isfinite(size) else huge
    return 2.0 * float(np.log(max(size, tiny))) + constant


def fit(
    stretches: Sequence[Segment],
    orders: Orders,
    settings: FitSettings,
    models: Sequence[PolynomialModel] = (),
    own_starts: bool = True,
    structure: str | None = None,
    stages: tuple[Stage, ...] = SWEEP_STAGES,
) -> Fit:
    """Fit a model of given orders by descents from estimates and from other models.

    Parameters
    ----------
    stretches : sequence of Segment
    orders : Orders
    settings : FitSettings
    models : sequence of PolynomialModel
        Of any orders; descents start from them, with further poles where these orders have more.
    own_starts : bool
        Whether descents start from estimates by linear algebra as well.
    structure : str, optional
        Name that the model gets; by default the smallest structure with these orders.
    stages : tuple of Stage
        How the descents end.

    Raises
    ------
    ValueError
        When no stretch is long enough, or no start has finite prediction errors.
    """
    errors = StretchErrors(
        *(stretches, orders, settings.objective),
        *(PLANT_RADIUS, NOISE_RADIUS, settings.level),
    )
    problem = StretchProblem(errors, models, own_starts)
    starts = problem.starts()
    if len(starts) == 0:
        raise ValueError(f"no start of {orders} has finite prediction errors")
    descents = problem.sweep_descent(starts, stages)
    point = descents.points[int(np.argmin(descents.values))]
    return fit_at(errors, point, structure or orders.structure)


def fit_at(errors: StretchErrors, point: Array, structure: str) -> Fit:
    """The fit that a point of a problem stands for."""
    parts = errors.parts()
    a, c, d, f = (np.concatenate([[1.0], point[parts[name]]]) for name in "acdf")
    residuals = tuple(errors.residuals_of_stretches(point))
    together = np.concatenate(residuals)
    levels = point[parts["level"]]
    model = PolynomialModel(
        *(a, point[parts["b"]].copy(), c, d, f, errors.orders.single.nk),
        level=float(levels[0]) if len(levels) else 0.0,
        noise_variance=float(together @ together) / max(len(together) - len(point), 1),
        structure=structure,
    )
    value = float(errors.values(point[None, :])[0])
    return Fit(model, tuple(map(float, levels)), residuals, value)
