"""Estimate one model of any structure from several stretches with initial states of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.criteria import criteria_of, power_of_two_scale
from evopem.estimation.pem.covariance import innovation_variance
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.polynomial_estimate import (
    PolynomialEstimate,
    covariance_of,
    parameter_scales,
    roots_at_bound,
)
from evopem.estimation.search.global_search import continued_search
from evopem.estimation.search.likely_gain import Aim
from evopem.estimation.search.problem import SearchResult, descended, pooled
from evopem.estimation.search.stretch_problem import StretchProblem
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


def estimate_joined(
    stretches: Sequence[Segment],
    orders: Orders,
    sampling_rate: float,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool = False,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    aim: Aim | None = None,
) -> PolynomialEstimate:
    """Find the model of given orders with the smallest prediction errors over all stretches.

    One objective over all stretches; each has an initial state of the plant and of the noise
    filter, and each recording a level where one is estimated.

    Parameters
    ----------
    stretches : sequence of Segment
    orders : Orders
    sampling_rate : float
        Hz.
    settings : SearchSettings
        ``initialization`` is not used, as in :func:`.polynomial_estimate.estimate_polynomial`.
    window : ScoringWindow
        Of each stretch.
    level : bool
        Whether a constant is estimated for each recording.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one.
    log : callable, optional
        Receives one line a generation.
    aim : Aim, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Raises
    ------
    ValueError
        When no stretch is long enough for the orders.
    """
    o = orders
    with one_blas_thread():
        errors = joined_errors(stretches, orders, settings, window, level)
        problem, scales = _scaled_problem(errors)
        key = (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk, int(level))
        found = continued_search(
            problem, scales, key, settings, earlier, log, problem.recombine, aim
        )
        return describe_joined(errors, found, sampling_rate)


def joined_errors(
    stretches: Sequence[Segment],
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> StretchErrors:
    """The prediction-error problem of several stretches, orders and settings."""
    radius = settings.max_root_radius
    return StretchErrors(
        *(stretches, orders, settings.objective, radius, radius, level), window=window
    )


def descend_from_model(
    model: PolynomialModel, errors: StretchErrors, sampling_rate: float, earlier: SearchResult
) -> PolynomialEstimate:
    """Descend once from a model of smaller orders, and combine the result with an earlier search.

    Parameters
    ----------
    model : PolynomialModel
    errors : StretchErrors
    sampling_rate : float
        Hz.
    earlier : SearchResult
    """
    problem, scales = _scaled_problem(errors)
    input_scale, output_scale = _scales(errors)
    scaled = replace(
        model, B=tuple(b * (input_scale / output_scale) for b in model.B), covariance=None
    )
    starts = StretchProblem(problem.errors, [scaled], own_starts=False).starts()
    if len(starts) == 0:
        return describe_joined(errors, earlier, sampling_rate)
    ended = descended(problem, starts[0])
    ended = replace(ended, point=ended.point * scales)
    return describe_joined(errors, pooled(earlier, ended), sampling_rate)


def describe_joined(
    errors: StretchErrors, result: SearchResult, sampling_rate: float
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    point, parts = result.point, errors.parts()
    a, c, d, f = (np.concatenate([[1.0], point[parts[name]]]) for name in "acdf")
    of_stretches = errors.residuals_of_stretches(point)
    counted, outputs = np.concatenate(of_stretches), errors.scored_outputs()
    levels = tuple(point[parts["level"]].tolist())
    model = PolynomialModel(
        *(a, point[parts["b"]].copy(), c, d, f, errors.orders.single.nk, sampling_rate),
        level=levels[0] if levels else 0.0,
        noise_variance=innovation_variance(counted, errors.dimension),
        covariance=covariance_of(errors, point, counted, outputs, errors.residual_counts()),
        structure=errors.orders.structure,
    )
    missing = np.full(errors.window.loss_start, np.nan)
    criteria = criteria_of(counted, outputs, errors.objective, errors.parameters)
    return PolynomialEstimate(
        model=model,
        criteria=criteria,
        residuals=np.concatenate([part for each in of_stretches for part in (missing, each)]),
        plant_state=point[parts["plant"]].copy(),
        noise_state=point[parts["noise"]].copy(),
        window=errors.window,
        at_stability_bound=roots_at_bound(errors, model),
        search=result,
        focus_objective=criteria.objective,
        levels=levels,
    )


def _scales(errors: StretchErrors) -> tuple[float, float]:
    """Powers of two next below the largest input and output of any stretch."""
    inputs = np.concatenate([each.input for each in errors.stretches])
    outputs = np.concatenate([each.output for each in errors.stretches])
    return power_of_two_scale(inputs), power_of_two_scale(outputs)


def _scaled_problem(errors: StretchErrors) -> tuple[StretchProblem, Array]:
    """The problem with signals scaled to moderate size, and the scales of its parameters."""
    input_scale, output_scale = _scales(errors)
    scaled = StretchErrors(
        [
            Segment(each.input / input_scale, each.output / output_scale, each.recording)
            for each in errors.stretches
        ],
        *(errors.orders, errors.objective, errors.plant_radius, errors.noise_radius, errors.level),
        window=errors.window,
    )
    return StretchProblem(scaled), parameter_scales(errors, input_scale, output_scale)
