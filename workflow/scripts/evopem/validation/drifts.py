"""Whether a quantity that was estimated again and again drifts: trends, oscillations, scatter.

Estimates ``x_i`` with standard errors ``s_i`` at places ``t_i`` are fitted by weighted least
squares with regressors of each kind.  Their scatter beyond the standard errors, from conditions
that nobody recorded, is what the fit leaves (Paule and Mandel 1982), so that a drift is not taken
for scatter, and the F test allows for its uncertainty (Knapp and Hartung 2003).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Estimates beyond the coefficients from which a drift is tested, and shortest period in steps.
FEWEST_BEYOND, SHORTEST_PERIOD = 2, 3.0


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
    time = (places - places[0]) / span
    found = []
    if count >= 2 + FEWEST_BEYOND:
        fit = _Fit.of(values, standard_errors, [time - 0.5])
        size, error = float(fit.coefficients[1]), float(np.sqrt(fit.covariance[1, 1]))
        found.append(Drift("trend", fit.shown, size, error, np.nan, fit.p_value))
    if count >= 3 + FEWEST_BEYOND:
        # Whole numbers of periods, of which the first is as long as all places.
        periods = range(1, int((count - 1) / SHORTEST_PERIOD) + 1)
        waves = [2.0 * np.pi * k * time * (count - 1) / count for k in periods]
        fits = [_Fit.of(values, standard_errors, [np.cos(w), np.sin(w)]) for w in waves]
        if fits:
            best = int(np.argmin([each.p_value for each in fits]))
            fit, along = fits[best], fits[best].coefficients[1:]
            size = float(np.hypot(*along))
            direction = along / size if size > 0.0 else along
            error = float(np.sqrt(direction @ fit.covariance[1:, 1:] @ direction))
            period = span * count / (count - 1) / periods[best]
            p_value = min(1.0, len(fits) * fit.p_value)  # Bonferroni
            found.append(Drift("oscillation", fit.shown, size, error, period, p_value))
    significant = [each for each in found if each.p_value < 0.5 * significance]
    return min(significant, key=lambda each: each.p_value, default=None)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A weighted fit of a level and regressors, and the F test of the regressors."""

    coefficients: Array
    covariance: Array
    shown: tuple[float, ...]
    p_value: float

    @classmethod
    def of(cls, values: Array, errors: Array, regressors: list[Array]) -> _Fit:
        from scipy.special import fdtrc

        design = np.column_stack([np.ones(len(values)), *regressors])
        free = len(values) - design.shape[1]
        scatter = _scatter(values, errors, design, free)
        coefficients, covariance, left = _weighted(values, errors**2 + scatter, design)
        covariance *= max(1.0, left / free)
        tested, own = coefficients[1:], covariance[1:, 1:]
        statistic = float(tested @ np.linalg.solve(own, tested)) / len(tested)
        p_value = float(fdtrc(len(tested), free, statistic))
        return cls(coefficients, covariance, tuple((design @ coefficients).tolist()), p_value)


def _weighted(values: Array, variances: Array, design: Array) -> tuple[Array, Array, float]:
    """Coefficients, their covariance, and the weighted sum of squares that is left."""
    scaled = design / np.sqrt(variances)[:, None]
    covariance: Array = np.asarray(np.linalg.inv(scaled.T @ scaled), dtype=float)
    coefficients: Array = np.asarray(covariance @ (scaled.T @ (values / np.sqrt(variances))))
    left = float(np.sum((values - design @ coefficients) ** 2 / variances))
    return coefficients, covariance, left


def _scatter(values: Array, errors: Array, design: Array, free: int) -> float:
    """Variance beyond the errors with which the sum of squares left is its expectation, or 0."""
    from scipy.optimize import brentq

    def surplus(scatter: float) -> float:
        return _weighted(values, errors**2 + scatter, design)[2] - free

    if surplus(0.0) <= 0.0:
        return 0.0
    return float(brentq(surplus, 0.0, float(np.sum((values - values.mean()) ** 2)), rtol=1e-9))
