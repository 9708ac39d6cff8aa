"""The search for the optimum of some orders: estimates, descents, generations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.multi_input.descent import descend
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.multi_input.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    MultiInputProblem,
    descended,
    starting_points,
)
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]
Log = Callable[[str], None]

SETTINGS = SearchSettings(
    objective="quadratic", mu=8, lambda_=16, nu=6, refine="random", evaluations=10_000
)
"""Settings of the search where none are given."""

# Starts of each order that are descended from on the way to a larger order, and for the order
# itself.
WIDTH, FINAL_WIDTH = 3, 8


def generator_of(
    errors: MultiInputErrors, settings: SearchSettings, *use: int
) -> np.random.Generator:
    """The source of all draws for some orders, for the search or for a use beside it."""
    o = errors.orders
    key = (list(STRUCTURES).index(o.structure), o.na, o.nc, o.nd, *o.nb, *o.nf, *o.nk, *use)
    return np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))


def descents(
    errors: MultiInputErrors,
    smaller: Sequence[PolynomialModel],
    settings: SearchSettings,
    width: int,
) -> list[Optimum]:
    """Optima from estimates and from smaller models, the lowest first."""
    generator = generator_of(errors, settings)
    own = starting_points(errors)
    added = [point for model in smaller for point in starting_points(errors, [model], generator)]
    found = descended(errors, own, width) + descended(errors, added, width)
    return sorted(found, key=lambda optimum: optimum.value)


def searched(errors: MultiInputErrors, settings: SearchSettings, log: Log | None) -> SearchResult:
    """Descents from estimates, then the global search, which has their optima among its own."""
    generator = generator_of(errors, settings)
    optima = descended(errors, starting_points(errors), FINAL_WIDTH)
    starts = np.array([optimum.point for optimum in optima]).reshape(-1, errors.dimension)
    spent = sum(optimum.evaluations for optimum in optima)
    if settings.evaluations == 0 and optima:
        return without_generations([descend(errors, starts[0], POLISH_STEPS, POLISH_TOLERANCE)])
    problem = MultiInputProblem(errors, starts)
    known = optima[0].value if optima else np.inf
    found = global_search(problem, settings, generator, log, known, recombine=problem.recombine)
    if optima and known < found.value:
        best = descend(errors, starts[0], POLISH_STEPS, POLISH_TOLERANCE)
        found = replace(found, point=best.point, value=best.value)
    evaluations = found.diagnostics.evaluations + spent
    return replace(found, diagnostics=replace(found.diagnostics, evaluations=evaluations))


def without_generations(optima: Sequence[Optimum]) -> SearchResult:
    """The lowest of some optima as the result of a search; nothing was confirmed."""
    spent = sum(optimum.evaluations for optimum in optima)
    value = optima[0].value
    diagnostics = SearchDiagnostics.of_descents(value, spent, len(optima))
    return SearchResult(optima[0].point, value, diagnostics)


def in_scaled_units(errors: MultiInputErrors, point: Array) -> PolynomialModel:
    """The model of a point, for the starts of other orders."""
    return errors.model(point, 1.0, 1.0)
