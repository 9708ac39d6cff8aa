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

# Estimates beyond the coefficients from which a drift is tested, and shortest period in estimates.
FEWEST_BEYOND, SHORTEST_PERIOD = 2, 3.0
# Halvings of the interval in which the scatter is sought.
BISECTIONS = 40


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
        fit = _Fits.of(values, standard_errors, np.stack([level, level * time - 0.5], axis=-1))
        size, error = fit.coefficients[0, 1], np.sqrt(fit.covariances[0, 1, 1])
        found.append(Drift("trend", fit.shown(0), float(size), float(error), np.nan, fit.least))
    # Numbers of periods, a quarter apart: a wave between two of them is found by both.
    periods = np.arange(1.0, (count - 1) / SHORTEST_PERIOD + 1e-9, 0.25)
    if count >= 3 + FEWEST_BEYOND and len(periods):
        waves = 2.0 * np.pi * np.outer(periods, time) * (count - 1) / count
        designs = np.stack([np.ones_like(waves), np.cos(waves), np.sin(waves)], axis=-1)
        fit = _Fits.of(values, standard_errors, designs)
        best = int(np.argmin(fit.p_values))
        along = fit.coefficients[best, 1:]
        size = np.hypot(*along)
        direction = along / max(size, 1e-300)
        error = np.sqrt(direction @ fit.covariances[best, 1:, 1:] @ direction)
        period = span * count / (count - 1) / float(periods[best])
        p_value = min(1.0, len(periods) * fit.least)  # Bonferroni
        shown = fit.shown(best)
        found.append(Drift("oscillation", shown, float(size), float(error), period, p_value))
    significant = [each for each in found if each.p_value < 0.5 * significance]
    return min(significant, key=lambda each: each.p_value, default=None)


@dataclass(frozen=True, eq=False)
class _Fits:
    """Weighted fits of a level and regressors (k, n, p), and the F tests of the regressors."""

    designs: Array
    coefficients: Array
    covariances: Array
    p_values: Array

    @classmethod
    def of(cls, values: Array, errors: Array, designs: Array) -> _Fits:
        from scipy.special import fdtrc

        free, tested = designs.shape[1] - designs.shape[2], designs.shape[2] - 1
        scatter = _scatter(values, errors, designs, free)
        coefficients, covariances, left = _weighted(values, errors**2 + scatter, designs)
        covariances *= np.maximum(1.0, left / free)[:, None, None]
        own = coefficients[:, 1:, None]
        along = np.linalg.solve(covariances[:, 1:, 1:], own)
        statistics = (own * along).sum(axis=(1, 2)) / tested
        return cls(designs, coefficients, covariances, fdtrc(tested, free, statistics))

    @property
    def least(self) -> float:
        """The smallest probability."""
        return float(self.p_values.min())

    def shown(self, place: int) -> tuple[float, ...]:
        """The fitted values of one fit."""
        return tuple((self.designs[place] @ self.coefficients[place]).tolist())


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
