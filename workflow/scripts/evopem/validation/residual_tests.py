"""The residuals that tests use, and tests of whiteness and of independence of the inputs.

Those of polynomials are of the estimation samples, where the derivatives of the residuals give the
distribution of the test after the fit (:func:`whiteness_test`).  Those of a state-space model are
of the validation samples and need no correction for the fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from evopem.config.settings import OBJECTIVES, ScoringWindow
from evopem.errors import check_choice
from evopem.estimation.pem.covariance import density_at_zero, pseudo_inverse_factor
from evopem.estimation.pem.least_squares import triangle_of
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import NORMAL_95
from evopem.models.states import estimate_prediction_states
from evopem.signals import correlation as signals
from evopem.signals.recording import Recording
from evopem.validation.responses import HeldOut

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

# Missed dynamics and feedback show at short lags; more lags only dilute the test.
CROSS_CORRELATION_LAGS = 200
"""Largest lag to either side at which residuals are compared with the input."""

# A sum of squares that is expected to be smaller than this has no distribution worth testing.
LEAST_EXPECTED = 0.5


@dataclass(frozen=True, eq=False)
class TestedResiduals:
    """Residuals, (N, l), and the inputs of the same samples, (N, m)."""

    residuals: Array
    inputs: Array
    bounds: tuple[int, ...]  # first residual of each stretch, and N
    # Gives the derivatives of the residuals of the one output by everything estimated, in blocks of
    # rows
    jacobian: Callable[[], Iterable[Array]] | None = None


def of_validation(held_out: Sequence[HeldOut]) -> TestedResiduals:
    """The residuals of the validation samples that are scored."""
    residuals = [(h.recording.outputs - h.predicted())[h.unscored :] for h in held_out]
    inputs = [h.recording.inputs[h.unscored :] for h in held_out]
    return TestedResiduals(np.concatenate(residuals), np.concatenate(inputs), _bounds(residuals))


def of_estimation(
    model: PolynomialModel, estimation: Recording, start: int, objective: str
) -> TestedResiduals:
    """The residuals of the estimation samples, of each stretch from sample ``start`` on.

    Each stretch begins with the states that fit it best, and each of several recordings has a
    level of its own.  Raises ValueError when no stretch is long enough.
    """
    first = model.orders.first_residual
    window = ScoringWindow(first, max(start, first))
    with_level = model.level != 0.0
    errors = PolynomialErrors(
        *(estimation.segments, model.orders, objective, 1.0, 1.0, with_level, window)
    )
    parameters, own_levels = model.orders.parameters, estimation.is_joined and with_level
    point = np.zeros(errors.dimension)
    point[:parameters] = model.parameters
    completed = errors.completed_by_states(model) if own_levels else point
    for stretch, (_, at) in zip(errors.stretches, errors.places(), strict=True):
        level = completed[at[parameters]] if own_levels else model.level
        states = estimate_prediction_states(
            replace(model, level=level), stretch.inputs, stretch.output
        )
        point[at[parameters:]] = [*([level] if with_level else []), *np.concatenate(states)]
    residuals = errors.residuals_of_stretches(point)
    inputs = [each.inputs[window.loss_start :] for each in errors.stretches]
    return TestedResiduals(
        np.concatenate(residuals)[:, None],
        np.concatenate(inputs),
        _bounds(residuals),
        lambda: errors.jacobian_blocks(point),
    )


def _bounds(parts: Sequence[Array]) -> tuple[int, ...]:
    return tuple(np.cumsum([0, *map(len, parts)]).tolist())


def weighted_chi_square_tail(value: float, weights: ArrayLike) -> float:
    """P(sum of weights_i x_i² > value) for independent standard normal x_i.

    By the chi-square variable of the same mean, variance and skewness (Imhof 1961, Biometrika
    48:419, eq. 5.1), exact for equal weights and to 0.002 where the probability is below 0.1.  NaN
    when no weight is positive or the value is not finite.
    """
    lam = np.asarray(weights, dtype=float)
    mean, square, cube = (float(np.sum(lam**power)) for power in (1, 2, 3))
    if not (cube > 0.0 and math.isfinite(value)):
        return math.nan
    freedom = square**3 / cube**2
    return float(chdtrc(freedom, max((value - mean) * square / cube + freedom, 0.0)))


@dataclass(frozen=True)
class WhitenessTest:
    """Joint test that the residuals of a fitted model are white."""

    statistic: float  # Ljung-Box statistic ``N (N + 2) sum r_k^2 / (N - k)``
    expected: float  # under white innovations, the fit taken into account
    p_value: float  # NaN where no autocorrelation is left free by the fit
    lags: int  # tested jointly


def free_whiteness_test(
    residuals: Array, lags: int, bounds: Sequence[int] = (), fitted: int = 0
) -> WhitenessTest:
    """Ljung-Box test with as many degrees of freedom as lags, less what was fitted to the samples.

    NaN where the residuals do not vary.
    """
    if not np.ptp(residuals) > 0.0:
        return WhitenessTest(math.nan, math.nan, math.nan, lags)
    statistic = _ljung_box(autocorrelation_of(residuals, lags, bounds).values[1:], residuals.size)
    freedom = max(lags - fitted, 1)
    return WhitenessTest(statistic, float(freedom), float(chdtrc(freedom, statistic)), lags)


def _ljung_box(correlations: Array, samples: int) -> float:
    k = np.arange(1, len(correlations) + 1)
    return float(samples * (samples + 2) * np.sum(correlations**2 / (samples - k)))


def whiteness_test(
    residuals: ArrayLike, jacobian: Iterable[Array], lags: int, objective: str
) -> WhitenessTest:
    """Ljung-Box test with the null distribution of the residuals of this very fit.

    The usual degrees of freedom, lags - na - nc, hold for a pure noise model only.  Parameters
    that the input determines take less from the autocorrelation of the residuals, and a test
    with those degrees of freedom rejects good models.  Here the statistic is compared with the
    weighted sum of chi-square variables that follows from
    :func:`residual_autocorrelation_covariance`.

    ``residuals`` (N,): that the fit has scored.  ``jacobian`` (M, p): consecutive rows of their
    derivatives by everything estimated, N in all.  ``lags``: tested jointly, fewer than N, or
    ValueError.  ``objective`` {"absolute", "quadratic"}: what the fit minimised.
    """
    check_choice("objective", objective, OBJECTIVES)
    e = np.asarray(residuals, dtype=float)
    if not 0 < lags < e.size:
        raise ValueError(f"{lags} lags cannot be tested with {e.size} residuals")
    if not np.ptp(e) > 0.0:
        return WhitenessTest(math.nan, math.nan, math.nan, lags)
    statistic = _ljung_box(signals.autocorrelation(e, lags).values[1:], e.size)
    covariance = residual_autocorrelation_covariance(e, jacobian, lags, objective)
    if not np.isfinite(covariance).all():
        return WhitenessTest(statistic, math.nan, math.nan, lags)
    weights = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    expected = float(weights.sum())
    p_value = math.nan
    if expected >= LEAST_EXPECTED:
        p_value = weighted_chi_square_tail(statistic, weights)
    return WhitenessTest(statistic, expected, p_value, lags)


def residual_autocorrelation_covariance(
    residuals: ArrayLike, jacobian: Iterable[Array], lags: int, objective: str
) -> Array:
    """Covariance of ``sqrt(N) r_k``, k = 1 ... lags, for the residuals of a fitted model.

    ``I - X J^-1 X'`` for the quadratic objective (Box & Pierce 1970; McLeod 1978), where J is the
    information matrix of all estimates and X the covariance of their score with the
    autocorrelations.  Both are taken from the Jacobian, so the formula holds for any model
    structure.  The absolute objective uses the score ``sign(e)``, and ``X J^-1 X'`` is weighed by
    ``(2 k E|e| - k^2) / var(e)``, with ``k = 1 / (2 f(0))`` and f the density of the residuals.
    Arguments as of :func:`whiteness_test`.  Returns (lags, lags).
    """
    e = np.asarray(residuals, dtype=float)
    scale = float(np.sqrt(np.mean(e**2) * e.size))
    padded = np.concatenate([np.zeros(lags), e]) / scale
    lagged = np.lib.stride_tricks.sliding_window_view(padded, lags)[:, ::-1]
    triangle, products, first = np.zeros((0, 0)), None, 0
    for block in jacobian:
        rows = lagged[first : first + len(block)]
        product = block.T @ rows
        products = product if products is None else products + product
        triangle = triangle_of([triangle, block] if triangle.size else [block])
        first += len(block)
    if products is None or first != e.size:
        raise ValueError(f"the Jacobian has {first} rows for {e.size} residuals")
    factor, _ = pseudo_inverse_factor(triangle)
    half = factor.T @ products
    covariance: Array = np.eye(lags) - _score_weight(e, factor.shape[0], objective) * half.T @ half
    return covariance


def _score_weight(residuals: Array, estimated: int, objective: str) -> float:
    """How much of ``X J^-1 X'`` the fit takes from the autocorrelations; 1 for least squares.

    NaN where the density of the residuals at zero cannot be estimated.
    """
    if objective == "quadratic":
        return 1.0
    density = density_at_zero(residuals, estimated)
    if not density > 0.0:
        return math.nan
    sparsity = 1.0 / (2.0 * density)
    mean_absolute = float(np.mean(np.abs(residuals)))
    return (2.0 * sparsity * mean_absolute - sparsity**2) / float(np.mean(residuals**2))


@dataclass(frozen=True, eq=False)
class ResidualCorrelation:
    """Correlations of residuals with themselves or with the input."""

    lag: NDArray[np.int64]  # (L,)
    values: Array  # (L,) Normalised to ±1; ``nan`` where a series does not vary
    bound95: Array  # (L,) 95 % bound of each, were the residuals white and independent of the input

    @property
    def largest_ratio(self) -> float:
        """Largest correlation in 95 % bounds."""
        return float(np.max(np.abs(self.values) / self.bound95))

    @property
    def share_inside(self) -> float:
        """Share of the correlations inside their bounds, 0 to 1; ``nan`` for none."""
        return share_inside(self.values, self.bound95)

    def where(self, chosen: NDArray[np.bool_]) -> ResidualCorrelation:
        """Some of the lags."""
        return ResidualCorrelation(self.lag[chosen], self.values[chosen], self.bound95[chosen])

    def table(self, name: str) -> pd.DataFrame:
        """Columns ``lag``, the values by name, and ``bound95``."""
        import pandas as pd

        return pd.DataFrame({"lag": self.lag, name: self.values, "bound95": self.bound95})


def apart(signal: Array, bounds: Sequence[int], lags: int) -> Array:
    """A signal of several recordings with its mean, as often as there are lags, between them.

    Without that mean, products of samples up to ``lags`` apart are those within the recordings.

    ``signal`` (N,).  ``bounds``: first sample of each of several recordings, and N; none for one
    recording.
    """
    if len(bounds) <= 2:
        return signal
    gap = np.full(lags, signal.mean())
    parts = [(signal[first:stop], gap) for first, stop in pairwise(bounds)]
    return np.concatenate([each for part in parts for each in part][:-1])


def autocorrelation_of(
    residuals: ArrayLike, lags: int = 1200, bounds: Sequence[int] = ()
) -> ResidualCorrelation:
    """Biased autocorrelation of (N,) residuals at lags 0, 1, …, N - 1 at most, mean removed.

    The 95 % bound of a white sequence is 1.96/√N, and 0 at lag 0 (Ljung 1999, section 16.6).  It is
    cautious at the first few lags, which a fit makes smaller (Box and Pierce 1970).  ``bounds``: as
    of :func:`apart`.
    """
    e = np.asarray(residuals, dtype=float)
    lags = min(lags, e.size - 1)
    # A model that leaves nothing at all has no residuals to correlate.
    correlation = np.full(lags + 1, np.nan)
    if np.ptp(e) > 0:
        correlation = signals.autocorrelation(apart(e, bounds, lags), lags).values
    bound = np.full(lags + 1, NORMAL_95 / math.sqrt(e.size))
    bound[0] = 0.0
    return ResidualCorrelation(np.arange(lags + 1), correlation, bound)


def share_inside(correlation: ArrayLike, bound: ArrayLike) -> float:
    """Share of correlations inside their bounds, 0 to 1; ``nan`` for none."""
    values = np.abs(np.asarray(correlation, dtype=float))
    if values.size == 0 or not np.all(np.isfinite(values)):
        return math.nan
    return float(np.mean(values <= np.asarray(bound, dtype=float)))


def ljung_box_lags(samples: int, parameters: int, largest: int) -> int:
    """Number of lags for the joint test.

    10 log10(N), but at least ten more than the parameters, so that freedom is left: a test over
    all 1200 lags would dilute the few that a missed pole or zero moves.
    """
    return max(0, min(largest, max(parameters + 10, round(10 * math.log10(samples)))))


def correlation_with_input(
    residuals: ArrayLike,
    inputs: ArrayLike,
    lags: int = CROSS_CORRELATION_LAGS,
    bounds: Sequence[int] = (),
) -> ResidualCorrelation:
    """Cross-correlation of residuals with the input, with its 95 % bound.

    Of ``e(t)`` with ``u(t - lag)``, (N,) each, lags to either side of N - 1 at most, both without
    mean; ``bounds``: as of :func:`apart`.  At positive lags the residual follows the input:
    dynamics that the model missed.  At negative lags it precedes it: feedback.  For independent e
    and u, √N R_eu is asymptotically normal with variance P = Σ_k R_e(k) R_u(k) (Ljung 1999, section
    16.6), so that a coloured input widens the bound only as far as the residuals are coloured too.
    """
    e, u = np.asarray(residuals, dtype=float), np.asarray(inputs, dtype=float)
    lags = min(lags, e.size - 1)
    lag = np.arange(-lags, lags + 1)
    if np.ptp(e) == 0 or np.ptp(u) == 0:
        missing = np.full(lag.size, np.nan)
        return ResidualCorrelation(lag, missing, missing)
    samples = e.size
    e, u = apart(e, bounds, lags), apart(u, bounds, lags)
    correlation = signals.cross_correlation(e, u, lags).values
    # Parseval: the mean of the product of spectra is the sum of products of covariances.
    length = 2 * e.size
    power_e = np.abs(np.fft.fft(e - e.mean(), length)) ** 2
    power_u = np.abs(np.fft.fft(u - u.mean(), length)) ** 2
    variance = np.mean(power_e * power_u) / (np.mean(power_e) * np.mean(power_u))
    bound = np.full(lag.size, NORMAL_95 * math.sqrt(variance / samples))
    return ResidualCorrelation(lag, correlation, bound)
