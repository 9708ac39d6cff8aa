"""Estimate one general polynomial model from a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.criteria import (
    Criteria,
    criteria_of,
    lies_at_bound,
    power_of_two_scale,
)
from evopem.estimation.pem.autoregression import autoregression
from evopem.estimation.pem.covariance import estimate_covariance, innovation_variance
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.robust_covariance import MOST_COLOURING, coloured_covariance
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.requirements import check_search_settings, check_signals, check_window
from evopem.estimation.search.global_search import continued_search
from evopem.estimation.search.likely_gain import Aim
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult, descended, pooled
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.structures import Orders, orders_of

Array = NDArray[np.float64]

# Structures that claim nothing of the noise, or whose noise model may be chosen too small.
WITHOUT_NOISE_MODEL = ("fir", "oe", "general")


@dataclass(frozen=True)
class ConstraintEffect:
    """What constraints cost in fit, and which of them bind.

    Attributes
    ----------
    objective, objective_without : float
        Objective of the errors in focus with the constraints and at the optimum without them,
        percent, priors not included.
    active : tuple of str
        Equalities, priors, and the inequalities at whose bound the model lies.
    """

    objective: float
    objective_without: float
    active: tuple[str, ...]


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
        Of each recording, where the record is several with a level; the model has the first one,
        with several inputs their mean.  Residuals and states then are those of its stretches one
        after the other.
    coloured_bic : float
        With several inputs the BIC of the innovations of an autoregression of the errors, whose
        coefficients are counted as parameters: it compares models with and without a noise model.
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
    coloured_bic: float = float("nan")

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

    @property
    def with_level(self) -> bool:
        """Whether a constant was estimated along."""
        states = len(self.plant_state) + len(self.noise_state)
        return len(self.search.point) > self.model.orders.parameters + states


def estimate_polynomial(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    structure: str,
    orders: Orders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    aim: Aim | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model of given orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  ``input`` is None for a model without input.
    structure : str
        ``fir``, ``arx``, ``arma``, ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or
        ``general``.
    orders : Orders, mapping or sequence
        ``{"nb": 4, "nf": 4, "nk": 1}``, or MATLAB's tuple for the structure, here (4, 4, 1).
    sampling_rate : float
        Hz.
    settings : SearchSettings, optional
        Objective, seed, bounds and size of the search.  Its draws come from
        ``SeedSequence(seed, spawn_key=(na, nb, nc, nd, nf, nk, level))``, with the number of its
        restarts appended to the key when the search continues an earlier one.
        ``initialization`` and ``n_initial_discard`` are not used: the first population of a
        memetic restart holds estimates of several kinds,
        and the initial states of all filters are estimated.
    window : ScoringWindow, optional
        By default the first residual is the first whose past inputs and outputs are measured, and
        all residuals count.
    level : bool
        Whether a constant is estimated: ``A y = (B/F) u + (C/D) e + level``.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one.
    log : callable, optional
        Receives one line a generation.
    aim : Aim, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Raises
    ------
    ValueError
        When the record is too short for the orders, or a setting is outside its range.
    """
    o = orders_of(structure, orders)
    settings = settings or SearchSettings()
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        errors = checked_errors(input, output, o, settings, window, level)
        problem, scales = scaled_problem(errors)
        key = (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk, int(level))
        found = continued_search(
            problem, scales, key, settings, earlier, log, problem.recombine, aim
        )
        return describe(errors, found, sampling_rate)


def checked_errors(
    input: ArrayLike | None,  # noqa: A002
    output: ArrayLike,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow | None,
    level: bool,
) -> PolynomialErrors:
    """The prediction-error problem of signals as a user gives them.

    Raises
    ------
    ValueError
        When the record is too short for the orders, or a setting is outside its range.
    """
    y = np.ascontiguousarray(output, dtype=float)
    if input is None and orders.single.nb:
        raise ValueError(
            f"structure {orders.structure!r} with nb = {orders.single.nb} needs an input"
        )
    u = np.zeros_like(y) if input is None else np.ascontiguousarray(input, dtype=float)
    window = window or ScoringWindow(orders.first_residual, orders.first_residual)
    _check(u, y, orders, settings, window)
    return polynomial_errors(u, y, orders, settings, window, level)


def polynomial_errors(
    input: Array,  # noqa: A002
    output: Array,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialErrors:
    """The prediction-error problem of a record, orders and settings."""
    radius = settings.max_root_radius
    return PolynomialErrors(
        input,
        output,
        orders,
        settings.objective,
        window.residual_start,
        window.loss_start,
        radius,
        radius,
        level,
    )


def descend_from(
    point: ArrayLike, errors: PolynomialErrors, sampling_rate: float, earlier: SearchResult
) -> PolynomialEstimate:
    """Descend once from a point, and combine the result with an earlier search of the problem.

    Parameters
    ----------
    point : (n,) array_like
        In the problem's own units.
    errors : PolynomialErrors
    sampling_rate : float
        Hz.
    earlier : SearchResult
    """
    problem, scales = scaled_problem(errors)
    ended = descended(problem, np.asarray(point) / scales)
    ended = replace(ended, point=ended.point * scales)
    return describe(errors, pooled(earlier, ended), sampling_rate)


def scaled_problem(errors: PolynomialErrors) -> tuple[PolynomialProblem, Array]:
    """The problem with signals scaled to moderate size, and the scales of its parameters."""
    input_scale, output_scale = power_of_two_scale(errors.input), power_of_two_scale(errors.output)
    scaled = PolynomialErrors(
        errors.input / input_scale,
        errors.output / output_scale,
        errors.orders,
        errors.objective,
        errors.residual_start,
        errors.loss_start,
        errors.plant_radius,
        errors.noise_radius,
        errors.level,
    )
    return PolynomialProblem(scaled), parameter_scales(errors, input_scale, output_scale)


def parameter_scales(
    errors: PolynomialErrors | StretchErrors, input_scale: float, output_scale: float
) -> Array:
    """Scales of the parameters, (n,), of a problem whose signals are divided by scales."""
    scales, parts = np.ones(errors.dimension), errors.parts()
    scales[parts["b"]] = output_scale / input_scale
    for name in ("level", "plant", "noise"):
        scales[parts[name]] = output_scale
    return scales


def _check(
    u: Array, y: Array, orders: Orders, settings: SearchSettings, window: ScoringWindow
) -> None:
    """Refuse a record or settings that :func:`estimate_polynomial` cannot use."""
    check_signals(u, y)
    check_search_settings(settings)
    check_window(window, orders.first_residual, orders)
    estimated = orders.parameters + orders.single.nf + orders.noise_states
    counted = len(y) - window.loss_start
    if counted <= estimated:
        raise ValueError(
            f"{orders} needs more than {estimated} residuals for its coefficients and initial "
            f"states; {len(y)} samples less the first {window.loss_start} leave {counted}"
        )
    if not np.any(y[window.loss_start :]):
        raise ValueError("the output is zero throughout")


def describe(
    errors: PolynomialErrors, result: SearchResult, sampling_rate: float
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    point, parts = result.point, errors.parts()
    a, c, d, f = (np.concatenate([[1.0], point[parts[name]]]) for name in "acdf")
    residuals = errors.residuals(point)
    counted, counted_output = residuals[errors.loss_start :], errors.output[errors.loss_start :]
    model = PolynomialModel(
        a,
        point[parts["b"]].copy(),
        c,
        d,
        f,
        errors.orders.single.nk,
        sampling_rate,
        level=float(point[parts["level"]].sum()),
        noise_variance=innovation_variance(counted, errors.dimension),
        covariance=covariance_of(errors, point, counted, counted_output),
        structure=errors.orders.structure,
    )
    residuals[: errors.residual_start] = np.nan
    criteria = criteria_of(counted, counted_output, errors.objective, errors.parameters)
    return PolynomialEstimate(
        model=model,
        criteria=criteria,
        residuals=residuals,
        plant_state=point[parts["plant"]].copy(),
        noise_state=point[parts["noise"]].copy(),
        window=ScoringWindow(errors.residual_start, errors.loss_start),
        at_stability_bound=roots_at_bound(errors, model),
        search=result,
        focus_objective=criteria.objective,
    )


def roots_at_bound(errors: PolynomialErrors | StretchErrors, model: PolynomialModel) -> bool:
    """Whether a root of A, F, C or D lies at the bound of the search."""
    plant, noise = (
        max(max_root_radius(one[1:]), max_root_radius(other[1:]))
        for one, other in ((model.a, model.f), (model.c, model.d))
    )
    return lies_at_bound(plant, errors.plant_radius) or lies_at_bound(noise, errors.noise_radius)


def covariance_of(
    errors: PolynomialErrors | StretchErrors,
    point: Array,
    residuals: Array,
    output: Array,
    counts: Sequence[int] = (),
) -> ParameterCovariance | None:
    """Covariance of the coefficients, for residuals of any colour where nothing whitens them.

    Parameters
    ----------
    errors : PolynomialErrors or StretchErrors
    point : (n,) array
    residuals, output : (N,) arrays
        Those that count.
    counts : sequence of int
        Residuals of each of several stretches.
    """
    orders, jacobian = errors.orders, errors.jacobian(point)
    coloured = len(autoregression(residuals - residuals.mean(), MOST_COLOURING)) > 1
    if coloured and orders.structure in WITHOUT_NOISE_MODEL:
        return coloured_covariance(
            jacobian,
            residuals,
            orders.parameters,
            errors.objective,
            input_alone=orders.na + orders.nc + orders.nd == 0,
            counts=counts,
        )
    triangle = np.asarray(np.linalg.qr(jacobian, mode="r"))
    return estimate_covariance(triangle, residuals, output, orders.parameters, 0, errors.objective)
