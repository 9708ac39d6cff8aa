"""Whether a quantity that was estimated again and again has changed, and when.

Steps, single estimates away from their level, a trend or a wave are regressors of one weighted fit;
the scatter beyond the standard errors is what they leave.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtrc, fdtrc

from evopem.arrays import Array

Covariates = Sequence[Array]

FEWEST = 4  # fewest estimates from which a level is tested
BESIDE = 2  # estimates on either side of a step
# Estimates beyond the coefficients that a regressor needs, and shortest period in estimates.
FEWEST_BEYOND, SHORTEST_PERIOD = 2, 3.0
ITERATIONS = 10  # Newton steps to the scatter


@dataclass(frozen=True)
class LevelChange:
    """A step from one level to another."""

    index: int  # first estimate at the new level
    # before, after: levels on either side, up to the next step
    before: float
    after: float
    standard_error: float  # of their difference
    p_value: float  # that a step as significant as this one is found anywhere where there is none


@dataclass(frozen=True)
class Levels:
    """Levels of a sequence of estimates."""

    values: tuple[float, ...]  # level at each estimate
    scatter: float  # standard deviation beyond the standard errors
    changes: tuple[LevelChange, ...]  # by index
    outlying: tuple[int, ...]  # single estimates away from their level
    explained: tuple[float, ...]  # at each estimate, by the covariates


def find_levels(
    values: Array, standard_errors: Array, significance: float, covariates: Covariates = ()
) -> Levels:
    """Find steps and outlying estimates in a sequence, the most significant one at a time.

    The probability of finding anything where nothing changes is at most ``significance``, a third
    each for steps, for two at once, and for single estimates, and of all their places (Bonferroni).

    ``covariates``: each (n,), what else the estimates depend on, with mean 0.
    """
    count = len(values)
    at, edges = np.arange(count), range(BESIDE, count - BESIDE + 1)
    # What lies at the other level: from an estimate on, between two, or one alone.
    kinds = [
        [(k, count) for k in edges],
        [(k, end) for k in edges for end in edges if end - k >= BESIDE],
        [(k, k + 1) for k in range(count)],
    ]
    design = np.vstack([np.ones((1, count)), *covariates])
    levels: list[tuple[int, float, bool]] = []
    while count >= max(FEWEST, len(design) + 1 + FEWEST_BEYOND):
        tests = []
        for places in filter(None, kinds):
            first, stop = np.array(places).T[..., None]
            regressors = ((first <= at) & (at < stop)).astype(float)
            p_value, best = _most_significant(values, standard_errors, design, regressors)
            tests.append((len(kinds) * len(places) * p_value, places[best]))
        p_value, (first, stop) = min(tests)
        if p_value >= significance:
            break
        is_step = stop - first >= BESIDE
        known = {k for k, _, stepped in levels if stepped == is_step} | {count}
        added = [k for k in ((first, stop) if is_step else (first,)) if k not in known]
        levels += [(k, p_value, is_step) for k in added]
        design = np.vstack([design, *((at >= k) if is_step else (at == k) for k in added)])
    coefficients, covariances, _, scatter = fits(values, standard_errors, design.T[None], 1)
    first_found = 1 + len(covariates)
    is_level = np.array([True, *([False] * len(covariates)), *(step for *_, step in levels)])
    level = coefficients[0, is_level] @ design[is_level]
    errors = np.sqrt(np.diag(covariances[0]))[first_found:].tolist()
    changes = [
        LevelChange(k, float(level[k - 1]), float(level[k]), error, p_value)
        for error, (k, p_value, is_step) in zip(errors, levels, strict=True)
        if is_step
    ]
    return Levels(
        tuple(level.tolist()),
        math.sqrt(float(scatter[0])),
        tuple(sorted(changes, key=lambda change: change.index)),
        tuple(sorted(k for k, _, is_step in levels if not is_step)),
        tuple((coefficients[0, 1:first_found] @ design[1:first_found]).tolist()),
    )


def _most_significant(
    values: Array, errors: Array, design: Array, regressors: Array
) -> tuple[float, int]:
    """Which of some regressors, (k, n), explains most beside a design, (p, n); its p-value first.
    By the scatter that the design leaves, then by the one that the regressor found so leaves."""
    scatter = fits(values, errors, design.T[None], 1)[3]
    for _ in range(2):
        roots = 1.0 / np.sqrt(errors**2 + scatter)
        basis = np.linalg.qr((design * roots).T)[0]
        rest = regressors * roots - (regressors * roots) @ basis @ basis.T
        explained = (rest @ (values * roots)) ** 2 / np.maximum(np.sum(rest**2, axis=1), 1e-9)
        best = int(np.argmax(explained))
        both = np.vstack([design, regressors[best]])
        if np.linalg.matrix_rank(both) < len(both):
            return 1.0, best
        _, _, p_values, scatter = fits(values, errors, both.T[None], 1)
    return float(p_values[0]), best


@dataclass(frozen=True)
class Drift:
    """A change that goes on from estimate to estimate."""

    kind: Literal["trend", "oscillation"]
    values: tuple[float, ...]  # of the fitted line or wave at each estimate
    # Change from the first place to the last, or amplitude, with its standard error
    size: float
    standard_error: float
    period: float  # in units of the places; NaN of a trend
    p_value: float  # that a drift of this kind as significant is found where there is none
    explained: tuple[float, ...]  # at each estimate, by the covariates


def constant_probability(
    values: Array, standard_errors: Array, covariates: Covariates = ()
) -> float:
    """Probability that a constant, weighted by the standard errors, leaves as much or more."""
    design = np.vstack([np.ones((1, len(values))), *covariates]).T
    left = _weighted(values, standard_errors**2.0, design[None])[2]
    return float(chdtrc(len(values) - design.shape[1], left.sum()))


def find_drift(
    values: Array,
    standard_errors: Array,
    places: Array,
    significance: float,
    covariates: Covariates = (),
) -> Drift | None:
    """The most significant drift, or None; half of the significance is for each kind.

    ``values``, ``standard_errors``, ``places`` (n,): finite, places ascending, errors above 0.
    ``covariates``: each (n,), what else they depend on, with mean 0.
    """
    count, span = len(values), float(places[-1] - places[0])
    if span <= 0.0:
        return None
    changes, time = [], (places - places[0]) / span
    beside = np.vstack([np.ones((1, count)), *covariates]).T
    # Numbers of periods, a quarter apart: a wave between two of them is found by both.
    periods = np.arange(1.0, (count - 1) / SHORTEST_PERIOD + 1e-9, 0.25)
    waves = 2.0 * np.pi * np.outer(periods, time) * (count - 1) / count
    regressors: dict[Literal["trend", "oscillation"], list[Array]] = {
        "trend": [time[None] - 0.5],
        "oscillation": [np.cos(waves), np.sin(waves)],
    }
    for kind, regressor in regressors.items():
        designs = np.stack([np.column_stack([beside, *c]) for c in zip(*regressor, strict=True)])
        # A covariate that is itself a trend or a wave leaves none to be found.
        tried = np.flatnonzero(np.linalg.matrix_rank(designs) == designs.shape[2])
        if count < designs.shape[2] + FEWEST_BEYOND or not len(tried):
            continue
        designs = designs[tried]
        coefficients, covariances, p_values, _ = fits(
            values, standard_errors, designs, len(regressor)
        )
        best = int(np.argmin(p_values))
        along = coefficients[best, -len(regressor) :]
        size = float(along[0]) if kind == "trend" else float(np.hypot(*along))
        direction = along / (size or 1.0)
        error = math.sqrt(direction @ covariances[best, -len(along) :, -len(along) :] @ direction)
        period = math.nan if kind == "trend" else span * count / (count - 1) / periods[tried[best]]
        explained = coefficients[best, 1 : beside.shape[1]] @ beside[:, 1:].T
        shown = designs[best] @ coefficients[best] - explained
        p_value = min(1.0, len(designs) * float(p_values[best]))  # Bonferroni
        courses = (tuple(course.tolist()) for course in (shown, explained))
        drift = Drift(kind, next(courses), size, error, float(period), p_value, next(courses))
        changes.append(drift)
    significant = [change for change in changes if change.p_value < 0.5 * significance]
    return min(significant, key=lambda change: change.p_value, default=None)


def fits(
    values: Array, errors: Array, designs: Array, tested: int
) -> tuple[Array, Array, Array, Array]:
    """Weighted fits of regressors (k, n, p): coefficients, covariances, F tests, scatter.

    Of values, (n,) or (k, n), with F tests of the last regressors; the scatter is the variance
    beyond the errors, (k,).
    """
    free = designs.shape[1] - designs.shape[2]
    scatter = np.zeros(len(designs))
    for _ in range(ITERATIONS):
        # The inverse of what is left is nearly linear in the scatter, and grows with it.
        _, _, left, slope = _weighted(values, errors**2 + scatter[:, None], designs)
        scatter = np.maximum(scatter + (left / free - 1.0) * left / np.maximum(slope, 1e-300), 0.0)
    coefficients, covariances, left, _ = _weighted(values, errors**2 + scatter[:, None], designs)
    covariances *= np.maximum(1.0, left / free)[:, None, None]
    tested_part = coefficients[:, -tested:, None]
    along = np.linalg.solve(covariances[:, -tested:, -tested:], tested_part)
    statistics = (tested_part * along).sum(axis=(1, 2)) / tested
    return coefficients, covariances, fdtrc(tested, free, statistics), scatter


def _weighted(values: Array, variances: Array, designs: Array) -> tuple[Array, ...]:
    """Coefficients, their covariances, weighted squares left, and how these fall with variance."""
    weighted = np.swapaxes(designs / variances[..., None], 1, 2)
    covariances: Array = np.asarray(np.linalg.inv(weighted @ designs), dtype=float)
    coefficients: Array = (covariances @ (weighted @ values[..., None]))[..., 0]
    squares = (values - (designs @ coefficients[..., None])[..., 0]) ** 2 / variances
    return coefficients, covariances, squares.sum(axis=1), (squares / variances).sum(axis=1)
