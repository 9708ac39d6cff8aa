"""Estimated polynomial models: criteria, residuals and covariance at a search's best point."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import ScoringWindow
from evopem.estimation.criteria import (
    Criteria,
    check_returned,
    criteria_of,
    lies_at_bound,
    lost_model,
)
from evopem.estimation.pem.covariance import (
    coloured_covariance,
    estimate_covariance,
    innovation_variance,
    is_coloured,
    pseudo_inverse_factor,
    scores_of,
)
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.prediction_errors import scaled_errors
from evopem.estimation.search.problem import SAME_OPTIMUM, SearchResult
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.polynomial_roots import max_root_radius
from evopem.signals.least_squares import triangle_of

# Structures that claim nothing of the noise, or whose noise model may be chosen too small.
WITHOUT_NOISE_MODEL = ("fir", "oe", "general")

ROUNDING = 1e-8  # objective, percent, that rounding alone makes of records without errors
# Relative excess over the search's objective, in its units, from which a model is taken for broken.
# Rounding makes up to 3e-7 of it, with poles next to 1 and a mean of 100 standard deviations.
LOST = 1e-5


@dataclass(frozen=True)
class ConstraintEffect:
    """What constraints cost in fit, and which of them bind.  Objectives are of the errors in focus,
    with the constraints and at the optimum without them, percent, priors not included."""

    objective: float
    objective_without: float
    active: tuple[str, ...]  # equalities, priors, and inequalities at whose bound the model lies


@dataclass(frozen=True, eq=False)
class PolynomialEstimate:
    """An estimated polynomial model, its criteria, and the search that found it.

    Attributes
    ----------
    model : PolynomialModel
        With the covariance of its coefficients.
    criteria : Criteria
    residuals : (N,) array
        NaN before ``window.residual_start``.
    plant_state : (nf,) array
        Contribution of the past to the first equations of ``F x = -B u``.
    noise_state : (max(nc, nd),) array
        Contribution of the past to the first equations of ``C e = D v``.
    window : ScoringWindow
    at_stability_bound : bool
        Whether a root of A, C, D or F lies at the largest radius allowed.
    search : SearchResult
        ``search.value`` is the objective plus the priors of the states.
    focus : str or int
        The errors that the model was fitted for: ``"prediction"``, ``"simulation"``, or a horizon
        in samples.
    focus_objective : float
        Objective of those errors, percent.
    constraints : ConstraintEffect, optional
        What the constraints of the estimate did.
    levels : tuple of float
        Of each recording, where a level is estimated; the model has the first one, with several
        inputs their mean.  Residuals and states are those of its segments one after the other.
    """

    model: PolynomialModel
    criteria: Criteria
    residuals: Array = field(repr=False)
    plant_state: Array = field(repr=False)
    noise_state: Array = field(repr=False)
    window: ScoringWindow
    at_stability_bound: bool
    search: SearchResult = field(repr=False)
    focus: str | int = "prediction"
    focus_objective: float = float("nan")
    constraints: ConstraintEffect | None = None
    levels: tuple[float, ...] = ()

    @classmethod
    def at(
        cls,
        errors: PolynomialErrors,
        point: Array,
        criteria: Criteria,
        search: SearchResult,
        sampling_rate: float,
        noise_variance: float,
        covariance: ParameterCovariance | None,
    ) -> Self:
        """The estimate at a point of one-step errors."""
        parts = errors.parts
        levels = tuple(point[parts["level"]].tolist())
        model = model_of(
            errors.orders,
            point,
            sampling_rate=sampling_rate,
            level=levels[0] if levels else 0.0,
            noise_variance=noise_variance,
            covariance=covariance,
        )
        return cls(
            *(model, criteria, errors.all_residuals(point)),
            *(point[parts["plant"]].copy(), point[parts["noise"]].copy(), errors.window),
            *(roots_at_bound(errors, model), search),
            focus_objective=criteria.objective,
            levels=levels,
        )

    @property
    def objective(self) -> float:
        """Of one-step errors, percent."""
        return self.criteria.objective

    @property
    def fit_percent(self) -> float:
        """One-step NRMSE fit."""
        return self.criteria.fit_percent

    @property
    def bic(self) -> float:
        """As of the criteria."""
        return self.criteria.bic

    @property
    def plant_states(self) -> int:
        """States of the plant in state space."""
        return self.model.plant_states


def describe(
    errors: PolynomialErrors, result: SearchResult, sampling_rate: float, *, shortest: bool = False
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance.
    ``shortest``: whether B is the shortest of those with equal residuals."""
    point, triangle = result.point, triangle_of(errors.jacobian_blocks(result.point))
    if shortest:
        shortest_point = minimum_norm_point(errors, point, triangle)
        before, after = (searched_objective(errors, c) for c in (point, shortest_point))
        if after <= before * (1.0 + SAME_OPTIMUM) and not np.array_equal(shortest_point, point):
            point, triangle = shortest_point, triangle_of(errors.jacobian_blocks(shortest_point))
    counted = errors.residuals(point)
    criteria = criteria_of(counted, errors.scored_outputs(), errors.objective, errors.parameters)
    reached = searched_objective(errors, point) if shortest else result.value
    if not reached <= result.value * (1.0 + LOST) + ROUNDING:
        compared = f"its objective is {reached:.9g} %, and that of its search was"
        raise lost_model(str(errors.orders), f"{compared} {result.value:.9g} %")
    covariance = covariance_of(errors, point, counted, triangle)
    variance = innovation_variance(counted, errors.dimension)
    about = criteria, result, sampling_rate, variance, covariance
    estimate = PolynomialEstimate.at(errors, point, *about)
    stretch, model = errors.stretches[0], estimate.model
    inputs = stretch.inputs[:, : errors.orders.inputs]
    scored = counted[: errors.residual_counts()[0], None]
    check_returned(model.state_space(), inputs, stretch.outputs, scored, str(errors.orders))
    if covariance is not None and _plant_at_bound(errors, model):
        step = _step_beyond(errors, point, counted, triangle)[: errors.orders.parameters]
        factor = np.column_stack([covariance.factor, step])
        model = replace(model, covariance=replace(covariance, factor=factor))
    return replace(estimate, model=model)


def searched_objective(errors: PolynomialErrors, point: Array) -> float:
    """What a search minimises, of a point in the units of the signals: its states are weighed as in
    the search, whose inputs have no mean beside levels."""
    scaled, units = scaled_errors(errors)
    loss = errors.loss(errors.residuals(point))
    return loss + float(scaled.state_weights() @ units.taken(point) ** 2)


def _step_beyond(
    errors: PolynomialErrors, point: Array, residuals: Array, triangle: Array
) -> Array:
    """From a point that a bound holds to the optimum beyond, to first order, (n,). It counts as an
    error of the estimates: they cannot follow the samples across the bound."""
    scores = scores_of(residuals, errors.dimension, errors.objective)
    inverse, _ = pseudo_inverse_factor(triangle)
    gradient, first = np.zeros(errors.dimension), 0
    for block in errors.jacobian_blocks(point):
        gradient += block.T @ scores[first : first + len(block)]
        first += len(block)
    step: Array = -inverse @ (inverse.T @ gradient)
    return np.where(np.isfinite(step), step, 0.0)


def minimum_norm_point(errors: PolynomialErrors, point: Array, triangle: Array) -> Array:
    """The point of smallest ||b|| among those of equal residuals with the same A, C, D and F.
    Residuals are linear in B, levels and states; an input that excites fewer directions than B has
    coefficients leaves B undetermined. ``triangle``: R of the QR decomposition of the Jacobian."""
    parts = errors.parts
    of_b = parts["b"]
    linear = np.r_[of_b, parts["level"].start : len(point)]
    shortest, count = point.copy(), of_b.stop - of_b.start
    if not count:
        return shortest
    _, null_space = pseudo_inverse_factor(triangle[:, linear])
    if not np.any(null_space[:count]):
        return shortest
    weights = np.linalg.lstsq(null_space[:count], -point[of_b], rcond=None)[0]
    shortest[linear] += null_space @ weights
    return shortest


def roots_at_bound(errors: PolynomialErrors, model: PolynomialModel) -> bool:
    """Whether a root of A, F, C or D lies at the bound of the search."""
    noise = max(max_root_radius(polynomial[1:]) for polynomial in (model.C, model.D))
    return _plant_at_bound(errors, model) or lies_at_bound(noise, errors.noise_radius)


def _plant_at_bound(errors: PolynomialErrors, model: PolynomialModel) -> bool:
    plant = max(max_root_radius(polynomial[1:]) for polynomial in (model.A, *model.F))
    return lies_at_bound(plant, errors.plant_radius)


def covariance_of(
    errors: PolynomialErrors, point: Array, residuals: Array, triangle: Array | None = None
) -> ParameterCovariance | None:
    """Covariance of the coefficients, for residuals of any colour where nothing whitens them.
    ``triangle``: R of the Jacobian, where known."""
    orders = errors.orders
    if orders.structure in WITHOUT_NOISE_MODEL and is_coloured(residuals):
        return coloured_covariance(
            errors.jacobian(point),
            residuals,
            orders.parameters,
            errors.objective,
            input_alone=orders.na + orders.nc + orders.nd == 0,
            counts=errors.residual_counts(),
        )
    if triangle is None:
        triangle = triangle_of(errors.jacobian_blocks(point))
    parts = errors.parts
    of_noise = np.r_[parts["c"], parts["d"]]
    return estimate_covariance(
        triangle, residuals, errors.scored_outputs(), orders.parameters, of_noise, errors.objective
    )
