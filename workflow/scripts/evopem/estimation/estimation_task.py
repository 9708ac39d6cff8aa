"""A checked problem of estimation, and what its kinds of errors have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.config.settings import SearchSettings
from evopem.estimation.pem.k_step_errors import KStepErrors
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.problem import SearchResult
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.structures import Orders

Array = NDArray[np.float64]
Log = Callable[[str], None]


@dataclass(frozen=True)
class EstimationTask:
    """A record, orders and settings, checked.

    ``optimum`` is that of one-step prediction without constraints, where it is known already.
    """

    errors: PolynomialErrors
    structure: str
    sampling_rate: float
    settings: SearchSettings
    constraints: Constraints
    log: Log | None
    optimum: SearchResult | None = None

    @property
    def orders(self) -> Orders:
        """Orders of the model."""
        return self.errors.orders

    def generator(self, purpose: int) -> np.random.Generator:
        """Random draws of one purpose: 0 is the search without constraints."""
        o = self.orders
        key: tuple[int, ...] = (
            o.na,
            o.single.nb,
            o.nc,
            o.nd,
            o.single.nf,
            o.single.nk,
            int(self.errors.level),
        )
        key = (*key, purpose) if purpose else key
        return np.random.default_rng(np.random.SeedSequence(self.settings.seed, spawn_key=key))


def errors_ahead(errors: PolynomialErrors, horizon: int) -> PolynomialErrors | KStepErrors:
    return errors if horizon == 1 else KStepErrors(errors, horizon)


def with_plant_radius(errors: PolynomialErrors, radius: float) -> PolynomialErrors:
    """The same problem where roots of A and F are held by the coordinates alone."""
    return PolynomialErrors(
        errors.input,
        errors.output,
        errors.orders,
        errors.objective,
        errors.residual_start,
        errors.loss_start,
        radius,
        errors.noise_radius,
        errors.level,
    )


def scored_residuals(errors: PolynomialErrors | KStepErrors, point: Array) -> Array:
    residuals = errors.residuals(point)
    return residuals[errors.loss_start :] if isinstance(errors, PolynomialErrors) else residuals


def objective_of(errors: PolynomialErrors, residuals: Array) -> float:
    losses = np.abs(residuals) if errors.objective == "absolute" else residuals**2
    return float(errors.loss_factor * np.sum(losses))


def prior_weight_of(errors: PolynomialErrors, deviation: float) -> float:
    """What a squared deviation adds to the objective: as much as one more observation."""
    if errors.objective == "quadratic":
        return errors.loss_factor * deviation**2
    return 0.5 * errors.loss_factor * deviation


def coefficient_covariance(
    covariance: ParameterCovariance, scales: Array, coefficients: int
) -> ParameterCovariance:
    """The covariance of the coefficients alone, in the units of the record."""
    null_space = covariance.null_space[:coefficients] * scales[:coefficients, None]
    null_space = null_space[:, np.any(null_space != 0.0, axis=0)]
    factor = covariance.factor[:coefficients] * scales[:coefficients, None]
    return ParameterCovariance(factor, null_space)
