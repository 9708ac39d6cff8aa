"""Whether a quantity that was estimated again and again has changed, and when.

Estimates ``x_i`` with standard errors ``s_i`` have one level, up to steps and drifts; their scatter
beyond the standard errors is estimated, and tests allow for its own uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Fewest estimates from which a level is tested.
FEWEST = 4
# Estimates on either side of a step.
BESIDE = 2
# Median of the square of a standard normal variable.
MEDIAN_OF_SQUARES = 0.454936
# Half of its standard error from n of them, relative, times sqrt(n): 1 / (4 f(m) m), f the density.
ERROR_OF_MEDIAN = 1.2
# Degrees of freedom of the scatter for each difference that it is estimated from: a median has
# 37 % of the efficiency of a mean, successive differences have two thirds.
FREEDOM = 0.25
# Estimates beyond the coefficients from which a drift is tested, and shortest period in estimates.
FEWEST_BEYOND, SHORTEST_PERIOD = 2, 3.0
# Halvings of the interval in which the scatter is sought.
BISECTIONS = 40


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


def find_levels(values: Array, standard_errors: Array, significance: float) -> Levels:
    """Find steps and outlying estimates in a sequence.

    The probability of finding anything where nothing changes is at most ``significance``, half of
    it for single estimates (Bonferroni), half for steps: each part is tested again with a quarter.
    """
    count = len(values)
    scatter = excess_scatter(values, standard_errors)
    variances = standard_errors**2 + scatter**2
    freedom = _freedom(variances, scatter)
    single = 0.5 * significance / count
    kept = np.flatnonzero(np.logical_not(_isolated(values, variances, freedom, single)))
    steps = sorted(_steps(values[kept], variances[kept], freedom, 0, 0.25 * significance))
    bounds = [0, *(int(kept[index]) for index, _ in steps), count]
    levels, parts, outlying = np.empty(count), [], []
    for first, stop in pairwise(bounds):
        inside = kept[(kept >= first) & (kept < stop)]
        mean, variance = _mean(values[inside], variances[inside])
        levels[first:stop] = mean
        parts.append((mean, variance))
        outlying += _outlying(values, variances, freedom, range(first, stop), inside, single)
    changes = tuple(
        LevelChange(index, before[0], after[0], math.sqrt(before[1] + after[1]), p_value)
        for index, (before, after), (_, p_value) in zip(
            bounds[1:-1], pairwise(parts), steps, strict=True
        )
    )
    return Levels(tuple(levels.tolist()), scatter, changes, tuple(outlying))


def excess_scatter(values: Array, standard_errors: Array) -> float:
    """Standard deviation of estimates beyond their standard errors, 0 where these explain all.

    With it the squared successive differences, which a step hardly touches, have the median of
    squared normal variables, less half of its standard error: too small a scatter makes alarms.
    """
    from scipy.optimize import brentq

    if len(values) < FEWEST:
        return 0.0
    squares = np.diff(values) ** 2
    known = standard_errors[1:] ** 2 + standard_errors[:-1] ** 2
    expected = MEDIAN_OF_SQUARES * max(1.0 - ERROR_OF_MEDIAN / math.sqrt(len(values)), 0.5)

    def surplus(variance: float) -> float:
        return float(np.median(squares / (known + 2.0 * variance))) - expected

    largest = float(squares.max()) / expected
    if surplus(0.0) <= 0.0:
        return 0.0
    return math.sqrt(float(brentq(surplus, 0.0, largest, rtol=1e-10)))


def step_probability(statistic: float, splits: int, first: float, last: float) -> float:
    """Probability that the largest of all standardised steps exceeds a value by chance.

    The smaller of Bonferroni's bound and the tail of the standardised Brownian bridge between two
    times, ``P(max |B(t)| / sqrt(t (1 - t)) > b)`` (Miller & Siegmund 1982, eq. 8).  ``first``,
    ``last``: share of the weight before the first and the last of the places that were tried.
    """
    b = statistic
    single = math.erfc(b / math.sqrt(2.0))
    bound = min(1.0, splits * single)
    if b <= 1.0 or math.isinf(b):
        return bound
    density = math.exp(-0.5 * b * b) / math.sqrt(2.0 * math.pi)
    span = math.log(last * (1.0 - first) / (first * (1.0 - last)))
    tail = density * (4.0 / b + (b - 1.0 / b) * span)
    return min(bound, max(tail, single))


def _steps(
    values: Array, variances: Array, freedom: float, start: int, significance: float
) -> list[tuple[int, float]]:
    """Indices of significant steps with their probabilities, none in particular order."""
    count = len(values)
    if count < FEWEST:
        return []
    weights = 1.0 / variances
    total = np.cumsum(weights)
    sums = np.cumsum(weights * values)
    splits = np.arange(BESIDE, count - BESIDE + 1)
    left, right = total[splits - 1], total[-1] - total[splits - 1]
    difference = (sums[-1] - sums[splits - 1]) / right - sums[splits - 1] / left
    statistics = np.abs(difference) / np.sqrt(1.0 / left + 1.0 / right)
    best = int(np.argmax(statistics))
    p_value = step_probability(
        _normal_equivalent(float(statistics[best]), freedom),
        len(splits),
        float(left[0] / total[-1]),
        float(left[-1] / total[-1]),
    )
    if p_value >= significance:
        return []
    at = int(splits[best])
    return [
        (start + at, p_value),
        *_steps(values[:at], variances[:at], freedom, start, 0.25 * significance),
        *_steps(values[at:], variances[at:], freedom, start + at, 0.25 * significance),
    ]


def _mean(values: Array, variances: Array) -> tuple[float, float]:
    """Weighted mean and its variance."""
    weights = 1.0 / variances
    return float(weights @ values / weights.sum()), float(1.0 / weights.sum())


def _freedom(variances: Array, scatter: float) -> float:
    """Degrees of freedom of variances of which the scatter is an estimated part (Welch 1947)."""
    share = scatter**2 / float(variances.mean())
    return FREEDOM * (len(variances) - 1) / share**2 if share > 0.0 else math.inf


def _normal_equivalent(statistic: float, freedom: float) -> float:
    """The normal deviate with the probability of a Student's t."""
    from scipy.special import ndtri, stdtr

    if math.isinf(freedom):
        return statistic
    return -float(ndtri(stdtr(freedom, -statistic)))


def _isolated(values: Array, variances: Array, freedom: float, significance: float) -> Array:
    """Whether each estimate lies on one side of all its neighbours, significantly each time.

    One that would be taken for a step, or hide one; a true step has neighbours on its own side.
    """
    count = len(values)
    isolated = np.zeros(count, dtype=bool)
    if count < FEWEST:
        return isolated
    for index in range(count):
        near = [k for k in range(index - BESIDE, index + BESIDE + 1) if 0 <= k < count]
        near.remove(index)
        deviations = (values[index] - values[near]) / np.sqrt(variances[index] + variances[near])
        if np.ptp(np.sign(deviations)) == 0.0:
            isolated[index] = _probability(float(np.abs(deviations).min()), freedom) < significance
    return isolated


def _probability(statistic: float, freedom: float) -> float:
    """Two-sided tail of Student's t."""
    return math.erfc(_normal_equivalent(statistic, freedom) / math.sqrt(2.0))


def _outlying(
    values: Array,
    variances: Array,
    freedom: float,
    part: range,
    inside: NDArray[np.int64],
    significance: float,
) -> list[int]:
    """Estimates of a part away from the mean of the others inside it."""
    found = []
    for index in part:
        others = inside[inside != index]
        if len(others) < BESIDE:
            continue
        mean, variance = _mean(values[others], variances[others])
        statistic = abs(values[index] - mean) / math.sqrt(variances[index] + variance)
        if _probability(float(statistic), freedom) < significance:
            found.append(index)
    return found


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


def constant_probability(values: Array, standard_errors: Array) -> float:
    """Probability that a constant, weighted by the standard errors, leaves as much or more."""
    from scipy.special import chdtrc

    weights = standard_errors**-2.0
    left = values - weights @ values / weights.sum()
    return float(chdtrc(len(values) - 1, weights @ left**2))


def find_drift(
    values: Array, standard_errors: Array, places: Array, significance: float
) -> Drift | None:
    """The most significant drift, or None; half of the significance is for each kind.

    ``values``, ``standard_errors``, ``places`` (n,): finite, places ascending, errors above 0.
    """
    count, span = len(values), float(places[-1] - places[0])
    if span <= 0.0:
        return None
    found, time, level = [], (places - places[0]) / span, np.ones((1, count))
    if count >= 2 + FEWEST_BEYOND:
        designs = np.stack([level, level * time - 0.5], axis=-1)
        coefficients, covariances, p_values = _fits(values, standard_errors, designs)
        size, error = coefficients[0, 1], np.sqrt(covariances[0, 1, 1])
        shown = tuple((designs[0] @ coefficients[0]).tolist())
        found.append(Drift("trend", shown, float(size), float(error), np.nan, float(p_values[0])))
    # Numbers of periods, a quarter apart: a wave between two of them is found by both.
    periods = np.arange(1.0, (count - 1) / SHORTEST_PERIOD + 1e-9, 0.25)
    if count >= 3 + FEWEST_BEYOND and len(periods):
        waves = 2.0 * np.pi * np.outer(periods, time) * (count - 1) / count
        designs = np.stack([np.ones_like(waves), np.cos(waves), np.sin(waves)], axis=-1)
        coefficients, covariances, p_values = _fits(values, standard_errors, designs)
        best = int(np.argmin(p_values))
        along = coefficients[best, 1:]
        size = np.hypot(*along)
        direction = along / max(size, 1e-300)
        error = np.sqrt(direction @ covariances[best, 1:, 1:] @ direction)
        period = span * count / (count - 1) / float(periods[best])
        p_value = min(1.0, len(periods) * float(p_values[best]))  # Bonferroni
        shown = tuple((designs[best] @ coefficients[best]).tolist())
        found.append(Drift("oscillation", shown, float(size), float(error), period, p_value))
    significant = [each for each in found if each.p_value < 0.5 * significance]
    return min(significant, key=lambda each: each.p_value, default=None)


def _fits(values: Array, errors: Array, designs: Array) -> tuple[Array, Array, Array]:
    """Weighted fits of a level and regressors (k, n, p): coefficients, covariances, F tests."""
    from scipy.special import fdtrc

    free, tested = designs.shape[1] - designs.shape[2], designs.shape[2] - 1
    scatter = _scatter(values, errors, designs, free)
    coefficients, covariances, left = _weighted(values, errors**2 + scatter, designs)
    covariances *= np.maximum(1.0, left / free)[:, None, None]
    own = coefficients[:, 1:, None]
    along = np.linalg.solve(covariances[:, 1:, 1:], own)
    statistics = (own * along).sum(axis=(1, 2)) / tested
    return coefficients, covariances, fdtrc(tested, free, statistics)


def _weighted(values: Array, variances: Array, designs: Array) -> tuple[Array, Array, Array]:
    """Coefficients, their covariances, and the weighted sums of squares that are left."""
    weighted = np.swapaxes(designs / variances[..., None], 1, 2)
    covariances: Array = np.asarray(np.linalg.inv(weighted @ designs), dtype=float)
    coefficients: Array = (covariances @ (weighted @ values)[..., None])[..., 0]
    fitted = (designs @ coefficients[..., None])[..., 0]
    return coefficients, covariances, np.sum((values - fitted) ** 2 / variances, axis=1)


def _scatter(values: Array, errors: Array, designs: Array, free: int) -> Array:
    """Variance beyond the errors, (k, 1), with which what is left is its expectation, or 0."""
    low = np.zeros((len(designs), 1))
    high = np.full_like(low, float(np.sum((values - values.mean()) ** 2)))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        above = _weighted(values, errors**2 + middle, designs)[2][:, None] > free
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return low
