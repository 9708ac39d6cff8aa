"""The residuals that tests use, and tests of whiteness and of independence of the inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array, Integers
from evopem.estimation.pem.covariance import density_at_zero
from evopem.models.parameter_covariance import NORMAL_95, ParameterCovariance
from evopem.models.states import delayed, states_of
from evopem.signals import spectra as signals
from evopem.signals.correlation import autocorrelation
from evopem.signals.least_squares import autoregression
from evopem.validation.held_out_tests import MOST_WHITENING
from evopem.validation.responses import HeldOut, unscored_samples

if TYPE_CHECKING:
    import pandas as pd

# Missed dynamics and feedback show at short lags; more lags only dilute the test.
CROSS_CORRELATION_LAGS = 200
"""Largest lag to either side at which residuals are compared with the input."""

# A sum of squares that is expected to be smaller than this has no distribution worth testing.
LEAST_EXPECTED = 0.5


@dataclass(frozen=True, eq=False)
class Residuals:
    """One-step prediction errors, (N, l), and the inputs of the same samples, (N, m)."""

    residuals: Array
    inputs: Array
    bounds: tuple[int, ...]  # first residual of each stretch, and N

    @classmethod
    def at_ends(cls, inputs: Sequence[Array], parts: Sequence[Array], **further: Any) -> Self:
        """Those of the last samples of stretches, whose inputs are given as a whole."""
        same = [u[len(u) - len(e) :] for u, e in zip(inputs, parts, strict=True)]
        bounds = tuple(np.cumsum([0, *map(len, parts)]).tolist())
        return cls(np.concatenate(parts), np.concatenate(same), bounds, **further)


@dataclass(frozen=True, eq=False)
class EstimationResiduals(Residuals):
    """Those of the estimation samples, with their stretches."""

    stretches: tuple[HeldOut, ...]

    @classmethod
    def of(cls, stretches: Sequence[HeldOut]) -> Self:
        """Of all samples of stretches without a past but those that states are fitted to."""
        inputs, parts = [stretch.inputs for stretch in stretches], map(_residuals, stretches)
        return cls.at_ends(inputs, list(parts), stretches=tuple(stretches))

    def fit_effects(self, lags: int) -> Array:
        """What :func:`fit_effects` gives of the estimate; nothing where its spread is not known."""
        model = self.stretches[0].model
        if model.covariance is None:
            return np.zeros((model.outputs, 0, lags))
        parts = [_derivatives(stretch) for stretch in self.stretches]
        return fit_effects(
            self.residuals,
            lambda step: np.concatenate([along(step) for along in parts]),
            *(model.covariance, lags, self.bounds),
        )


def _residuals(stretch: HeldOut) -> Array:
    errors = stretch.outputs - stretch.predicted_from_start()
    return errors[unscored_samples(stretch.model, len(errors)) :]


def _derivatives(stretch: HeldOut) -> Callable[[Array], Array]:
    """Of :func:`_residuals` along a step of the parameters, the first state held."""
    model, u = stretch.model, delayed(stretch.inputs, stretch.model.delays)
    e = stretch.outputs - stretch.predicted_from_start()
    x = states_of(model.A, u @ model.B.T + e @ model.K.T, stretch.state)
    signals = np.hstack([x, u, np.ones((len(e), 1)), e])

    def along(step: Array) -> Array:
        of = model.with_parameters(step)
        outputs = np.hstack([of.C, of.D, of.level[:, None], np.zeros((len(of.C), len(of.C)))])
        drives = np.hstack([of.A, of.B, np.zeros((len(of.A), 1)), of.K]) - model.K @ outputs
        changes = signals @ outputs.T
        changes += states_of(model.predictor, signals @ drives.T, None) @ model.C.T
        return -changes[unscored_samples(model, len(e)) :]

    return along


def weighted_chi_square_tail(value: float, mean: float, square: float, cube: float) -> float:
    """P(sum of weights_i x_i² > value) for independent standard normal x_i; NaN where not known.

    ``mean``, ``square``, ``cube``: sums of the weights, of their squares and of their cubes.
    By the chi-square variable of the same mean, variance and skewness (Imhof 1961, Biometrika
    48:419, eq. 5.1), exact for equal weights and to 0.002 where the probability is below 0.1.
    """
    if not (cube > 0.0 and math.isfinite(value)):
        return math.nan
    freedom = square**3 / cube**2
    return float(scipy.special.chdtrc(freedom, max((value - mean) * square / cube + freedom, 0.0)))


@dataclass(frozen=True)
class WhitenessTest:
    """Joint test that the residuals of a fitted model are white."""

    statistic: float  # Ljung-Box statistic ``N (N + 2) sum r_k^2 / (N - k)``, r_k by their spread
    expected: float  # under white innovations, the fit taken into account
    p_value: float  # NaN where no autocorrelation is left free by the fit
    lags: int  # tested jointly


def whiteness_test(
    residuals: ArrayLike,
    lags: int,
    bounds: Sequence[int] = (),
    effects: Array | int = 0,
    objective: str = "quadratic",
    uneven: bool = False,
) -> WhitenessTest:
    """Ljung-Box test with the null distribution of the residuals of this very fit.

    The usual degrees of freedom, lags less the estimates, hold for a pure noise model only.
    Estimates that the input determines take less from the autocorrelation of the residuals.  The
    covariance of ``sqrt(N) r_k`` is ``I - G S G'`` for an efficient estimate (Box & Pierce 1970;
    McLeod 1978), S its covariance and G the derivatives of ``sqrt(N) r_k``, and the statistic a
    weighted sum of chi-square variables.  Of least absolute errors, what the fit takes is weighed
    by ``2 E|e| / k - 1``, with ``k = 1 / (2 f(0))`` and f the density of the residuals.  ``uneven``
    noise, whose size comes and goes, spreads the correlations: their squares are divided by
    ``E e(t)² e(t - k)² / (E e²)²`` where that is above 1 (Lobato, Nankervis & Savin 2001).

    ``residuals`` (N,): that the fit has scored.  ``bounds``: as of :func:`apart`.  ``effects``
    (r, lags): of one output as of :func:`fit_effects`, or the number of estimates that are taken
    from the degrees of freedom where these are not known.  ``objective``: what the fit minimised.
    """
    e = np.asarray(residuals, dtype=float)
    unknown = WhitenessTest(math.nan, math.nan, math.nan, max(lags, 0))
    if not 0 < lags < e.size or not np.isfinite(e).all() or not np.ptp(e) > 0.0:
        return unknown
    correlations = autocorrelation_of(e, lags, bounds).values[1:]
    squares = (e - e.mean()) ** 2
    alike = autocorrelation_of(squares, lags, bounds).values[1:] * np.var(squares)
    spread = 1.0 + uneven * np.maximum(np.nan_to_num(alike), 0.0) / np.mean(squares) ** 2
    terms = correlations**2 / spread / (e.size - np.arange(1, lags + 1))
    statistic = e.size * (e.size + 2) * np.sum(terms)
    if isinstance(effects, int):
        weights = np.ones(max(lags - effects, 1))
    else:
        effects = effects[np.isfinite(effects).all(axis=1)]
        share = 1.0
        if objective == "absolute":
            share = 4.0 * density_at_zero(e, len(effects)) * float(np.mean(np.abs(e))) - 1.0
            share = max(share, 0.0)  # a fit takes from correlations
        covariance = np.eye(lags) - share * effects.T @ effects / np.sqrt(np.outer(spread, spread))
        if not np.isfinite(covariance).all():
            return replace(unknown, statistic=float(statistic))
        weights = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    expected, *sums = (float(np.sum(weights**power)) for power in (1, 2, 3))
    known = expected >= LEAST_EXPECTED
    p_value = weighted_chi_square_tail(float(statistic), expected, *sums) if known else math.nan
    return WhitenessTest(float(statistic), expected, p_value, lags)


def fit_effects(
    residuals: Array,
    along: Callable[[Array], Array],
    covariance: ParameterCovariance,
    lags: int,
    bounds: Sequence[int] = (),
) -> Array:
    """How far ``sqrt(N) r_k`` of each output move with independent errors of the estimates.

    ``along``: derivatives of the residuals, (N, l), along a step of the parameters.  Returns (l, r,
    lags), for a standard deviation along each column of the factor of the covariance.
    """
    e = residuals - residuals.mean(axis=0)
    before = _autocorrelations(residuals, lags, bounds)
    effects = np.zeros((e.shape[1], covariance.factor.shape[1], before.shape[1] - 1))
    length = scipy.fft.next_fast_len(len(e) + lags * (len(bounds) + 1), real=True)
    with np.errstate(all="ignore"):
        scale = 2.0 * math.sqrt(len(e)) / np.sum(e**2, axis=0)[:, None]
        spectrum = scipy.fft.rfft(apart(e.T, bounds, lags), length).conj()
        for k, column in enumerate(covariance.factor.T):
            change = apart(along(column).T, bounds, lags)
            spectra = spectrum * scipy.fft.rfft(change - change.mean(1, keepdims=True), length)
            moved = scipy.fft.irfft(spectra.real, length)[:, : before.shape[1]]
            effects[:, k] = scale * (moved - before * moved[:, :1])[:, 1:]
    return effects


@dataclass(frozen=True, eq=False)
class ResidualCorrelation:
    """Correlations of residuals with themselves or with the input."""

    lag: Integers  # (L,)
    values: Array  # (L,) Normalised to ±1; ``nan`` where a series does not vary
    bound95: Array  # (L,) 95 % bound of each, were the residuals white and independent of the input
    p_value: float = math.nan  # of the sum of squares of those with an input

    @property
    def largest_ratio(self) -> float:
        """Largest correlation in 95 % bounds."""
        return float(np.max(np.abs(self.values) / self.bound95))

    @property
    def share_inside(self) -> float:
        """Share of the correlations with a bound inside it, 0 to 1; ``nan`` for none."""
        bounded = self.bound95 > 0.0  # all but that at lag 0 of an autocorrelation, which is 1
        inside = np.abs(self.values[bounded]) <= self.bound95[bounded]
        known = bool(inside.size) and np.isfinite(self.values).all()
        return float(np.mean(inside)) if known else math.nan

    def table(self, name: str) -> pd.DataFrame:
        """Columns ``lag``, the values by name, and ``bound95``."""
        import pandas as pd

        return pd.DataFrame({"lag": self.lag, name: self.values, "bound95": self.bound95})


def apart(signal: Array, bounds: Sequence[int], lags: int) -> Array:
    """Signals of several recordings, (..., N), with their mean, once for each lag, between them.

    Without that mean, products of samples up to ``lags`` apart are those within the recordings.
    ``bounds``: first sample of each recording, and N; none for one recording.
    """
    if len(bounds) <= 2:
        return signal
    gap = np.repeat(signal.mean(axis=-1, keepdims=True), lags, axis=-1)
    parts = [(signal[..., first:stop], gap) for first, stop in pairwise(bounds)]
    return np.concatenate([value for part in parts for value in part][:-1], axis=-1)


def _autocorrelations(residuals: Array, lags: int, bounds: Sequence[int]) -> Array:
    """Those of (N, l) residuals, (l, lags + 1); NaN of a column that does not vary."""
    lags = min(lags, len(residuals) - 1)
    correlations = np.full((residuals.shape[1], lags + 1), np.nan)
    # A model that leaves nothing at all has no residuals to correlate.
    varying = np.ptp(residuals, axis=0) > 0
    series = apart(residuals[:, varying].T, bounds, lags)
    correlations[varying] = autocorrelation(series, lags)
    return correlations


def autocorrelation_of(
    residuals: ArrayLike, lags: int = 1200, bounds: Sequence[int] = ()
) -> ResidualCorrelation:
    """Biased autocorrelation of (N,) residuals at lags 0, 1, …, N - 1 at most, mean removed.

    The 95 % bound of a white sequence is 1.96/√N, 0 at lag 0 (Ljung 1999, section 16.6).
    """
    e = np.asarray(residuals, dtype=float)
    correlation = _autocorrelations(e[:, None], lags, bounds)[0]
    bound = np.full(correlation.size, NORMAL_95 / math.sqrt(e.size))
    bound[0] = 0.0
    return ResidualCorrelation(np.arange(correlation.size), correlation, bound)


def ljung_box_lags(samples: int, parameters: int, largest: int) -> int:
    """Number of lags for the joint test: 10 log10(N), but ten more than the parameters at least.

    A test over all lags would dilute the few that a missed pole or zero moves.
    """
    return max(0, min(largest, max(parameters + 10, round(10 * math.log10(samples)))))


def correlation_with_input(
    residuals: ArrayLike,
    inputs: ArrayLike,
    lags: int = CROSS_CORRELATION_LAGS,
    bounds: Sequence[int] = (),
) -> ResidualCorrelation:
    """Cross-correlation of residuals e(t) with the input u(t - lag), with its 95 % bound.

    At positive lags the residual follows the input: dynamics that the model missed; at negative
    lags it precedes it: feedback.  For independent e and u, √N R_eu is asymptotically normal with
    variance Σ_k R_e(k) R_u(k), and covariance Σ_k R_e(k) R_u(k + h) with that at a lag h away
    (Ljung 1999, section 16.6).  By these, with R_e of an autoregression, the sum of their squares
    is a weighted sum of chi-square variables: those of a slow input are correlated.
    """
    e, u = np.asarray(residuals, dtype=float), np.asarray(inputs, dtype=float)
    lags = min(lags, e.size - 1)
    lag = np.arange(-lags, lags + 1)
    if np.ptp(e) == 0 or np.ptp(u) == 0:
        missing = np.full(lag.size, np.nan)
        return ResidualCorrelation(lag, missing, missing)
    samples = e.size
    e, u = apart(e, bounds, lags), apart(u, bounds, lags)
    correlation = signals.cross_correlation(e, u, lags)
    # Parseval: the mean of the product of spectra is the sum of products of covariances.
    length = scipy.fft.next_fast_len(2 * e.size)
    power_e = np.abs(np.fft.fft(e - e.mean(), length)) ** 2
    power_u = np.abs(np.fft.fft(u - u.mean(), length)) ** 2
    variance = np.mean(power_e * power_u) / (np.mean(power_e) * np.mean(power_u))
    bound = np.full(lag.size, NORMAL_95 * math.sqrt(variance / samples))
    shape = np.abs(np.fft.fft(autoregression(e - e.mean(), MOST_WHITENING), length)) ** -2
    related = np.fft.ifft(shape * power_u).real[: lag.size] / (np.mean(shape) * np.mean(power_u))
    # At a lag so many samples of the stretches have another one to be multiplied by.
    lengths = np.diff(bounds) if len(bounds) > 2 else np.array([samples])
    shared = np.maximum(lengths[:, None] - np.abs(lag), 0).sum(axis=0) / samples
    # The covariance is the same from both ends: on even and odd sequences it acts apart.
    root = np.sqrt(shared[lags:]) * np.append(math.sqrt(0.5), np.ones(lags))
    near = scipy.linalg.toeplitz(related[: lags + 1])
    far = scipy.linalg.hankel(related[: lags + 1], related[lags:])
    halves = np.stack([near + far, near - far]) * np.outer(root, root)
    powers = halves, halves @ np.swapaxes(halves, 1, 2)
    sums = float(np.einsum("kii->", halves)), *(float(np.vdot(part, halves)) for part in powers)
    p_value = weighted_chi_square_tail(samples * float(correlation @ correlation), *sums)
    return ResidualCorrelation(lag, correlation, bound, p_value)
