"""Tests of parts of a model on samples that took no part in its estimation.

On the estimation samples Wald and likelihood-ratio tests reject too often after a choice of orders.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import chdtrc, chdtri, ndtri, stdtr

from evopem.arrays import Array
from evopem.signals.least_squares import autoregression

# Level of each test.  At 5 %, one of a dozen would fail in half of all good models.
SIGNIFICANCE = 0.01
# Fewest samples from which a test is made: at 1 % it rejects 1.5 to 4 %, of light modes more.
FEWEST_SAMPLES = 40
# Coefficient of a difference of two models' errors above which those with a part have the smaller
# mean square.  It tells more of long ringing than differences of squares (Harvey et al. 1998).
HALF_WAY = 0.5
# Largest order of the autoregression that whitens the errors before they are compared.
MOST_WHITENING = 30
# Shares that an input's past leaves of it, between which it may be fed back.
OF_ROUNDING, NEARLY_ALL = 1e-3, 0.95


@dataclass(frozen=True)
class HeldOutTest:
    """One-sided test that a part of a model improves predictions of held-out samples."""

    # Regression coefficient of the prediction error without the part on what the part contributes:
    # about 1 for a part that is right, about 0 for one that is made of noise
    coefficient: float
    statistic: float  # Student's t of the coefficient
    # Of the statistic, for coefficients above 0.  NaN where no test is possible: fewer than
    # :data:`FEWEST_SAMPLES` samples, a part that contributes nothing, or an input that rests
    p_value: float
    samples: int  # number of held-out samples
    fitted: int = 0  # to the samples themselves, coefficients of the part; see :meth:`of_largest`

    def significant(self, level: float) -> bool | None:
        """Whether the part is significant at a level; None where no test is possible."""
        return None if math.isnan(self.p_value) else self.p_value < level

    def would_show(self, level: float) -> bool:
        """Whether it misses a part that is right no more often than it finds one that is not."""
        power = -float(ndtri(level))
        # Of the largest by chance, see :meth:`of_largest`.
        square = chdtri(self.fitted, 2.0 * level / self.samples) if self.fitted else power**2
        return abs(self.statistic) >= (math.sqrt(square) + power) * abs(self.coefficient)

    def of_largest(self, fitted: int) -> Self:
        """The test on samples that a resonance was ``fitted`` to, the best of half as many."""
        by_chance = 0.5 * self.samples * float(chdtrc(fitted, max(self.statistic, 0.0) ** 2))
        return replace(self, p_value=min(by_chance, 1.0) + 0.0 * self.p_value, fitted=fitted)


NO_TEST = HeldOutTest(math.nan, math.nan, math.nan, 0)  # of a part that a model does not have


@dataclass(frozen=True, eq=False)
class HeldOutContribution:
    """What one part of a model contributes to the outputs of a held-out record."""

    # errors_without, contributions: (N, ny)
    errors_without: Array
    contributions: Array
    # (N, k) Further regressors of each output beside a constant, with coefficients of their own
    nuisance: Sequence[Array]


def joint_contribution_test(
    records: Sequence[HeldOutContribution], least: float = 0.0
) -> HeldOutTest:
    """Test that a contribution explains prediction errors made without it.

    Regression of the errors on it and on what else may be in them, both sides whitened by an
    autoregression of what remains (Cochrane & Orcutt 1949).  One coefficient for all outputs of all
    records, each weighed by the inverse of its noise; its standard error allows for the
    correlations of the outputs' noise.  Records and outputs where no test is possible are left out.
    The statistic is of a coefficient above ``least``.
    """
    samples = sum(len(record.errors_without) for record in records)
    sums = [weighed for record in records if (weighed := _weighed_sums(record)) is not None]
    if not sums:
        return HeldOutTest(math.nan, math.nan, math.nan, samples)
    # Errors of different records are independent.
    precision, product, spread, freedom = np.sum(sums, axis=0).tolist()
    if not math.isfinite(precision):
        return HeldOutTest(1.0, math.inf, 0.0, samples)
    coefficient, error = product / precision, math.sqrt(spread) / precision
    # A part that explains the errors without remainder is as significant as can be.
    statistic = (coefficient - least) / error if error > 0.0 else math.inf
    p_value = float(stdtr(freedom, -statistic)) if math.isfinite(statistic) else 0.0
    return HeldOutTest(coefficient, statistic, p_value, samples)


def _weighed_sums(record: HeldOutContribution) -> tuple[float, float, float, float] | None:
    """Sums over the outputs of a record, each over the variance of its noise; None without a test.
    Of squared contributions, infinite without noise; of the products of contributions and errors;
    the variance of these; and the degrees of freedom."""
    e, x = record.errors_without, record.contributions
    regressions = [
        regression
        for k, others in enumerate(record.nuisance)
        if (regression := _whitened_regression(e[:, k], x[:, k], others)) is not None
    ]
    if not regressions:
        return None
    # Whitening takes away a different number of first samples.
    common = min(len(rest) for *_, rest, _ in regressions)
    freedom = min(freedom for *_, freedom in regressions)
    deviations = [math.sqrt(float(rest @ rest) / freedom) for *_, rest, freedom in regressions]
    if min(deviations) == 0.0:
        return math.inf, math.inf, 0.0, freedom
    inverse = 1.0 / np.array(deviations)[:, None]
    remainder = inverse * np.array([errors[-common:] for errors, _, _, _ in regressions])
    unexplained = inverse * np.array([tested[-common:] for _, tested, _, _ in regressions])
    rest = np.array([known[-common:] for _, _, known, _ in regressions])
    return (
        float(np.sum(unexplained**2)),
        float(np.sum(unexplained * remainder)),
        float(np.sum(unexplained @ unexplained.T * np.corrcoef(rest))),
        freedom,
    )


def _whitened_regression(
    e: Array, x: Array, nuisance: Array
) -> tuple[Array, Array, Array, int] | None:
    """A regression of whitened signals; None where no test is possible. Signal and contribution
    without what other regressors explain, what the contribution leaves of the signal, and its
    degrees of freedom."""
    others = np.hstack([np.ones((e.size, 1)), nuisance])
    if e.size < FEWEST_SAMPLES or not all(np.isfinite(signals).all() for signals in (e, x, others)):
        return None
    remainder, unexplained = left_by(others, e), left_by(others, x)
    if _vanishes(unexplained, x) or _vanishes(remainder, e):
        return None
    coefficient = float(unexplained @ remainder) / float(unexplained @ unexplained)
    whitening = autoregression(remainder - coefficient * unexplained, MOST_WHITENING)
    e, x, *columns = filtered(np.column_stack([e, x, others]), whitening).T
    others = np.column_stack(columns)
    remainder, unexplained = left_by(others, e), left_by(others, x)
    freedom = e.size - others.shape[1] - len(whitening)
    if freedom < 1 or _vanishes(unexplained, x):
        return None
    coefficient = float(unexplained @ remainder) / float(unexplained @ unexplained)
    return remainder, unexplained, remainder - coefficient * unexplained, freedom


def left_by(regressors: Array, signals: Array) -> Array:
    """Signals less their least-squares fit by regressors, which are scaled to unit length."""
    length = np.linalg.norm(regressors, axis=0)
    basis = regressors[:, length > 0.0] / length[length > 0.0]
    return np.asarray(signals - basis @ np.linalg.lstsq(basis, signals, rcond=1e-12)[0])


def left_in_blocks(blocks: Iterable[Array], triangle: Array, count: int) -> Iterator[Array]:
    """Rows of ``count`` regressors and errors less what known ones, before them in the blocks, fit.
    ``triangle``: of all columns of all blocks, each of which is scaled by its length."""
    known = triangle.shape[1] - 1 - count
    size = np.maximum(np.linalg.norm(triangle, axis=0), 1e-300)
    basis, others = np.split(triangle / size, [known], axis=1)
    fit = np.linalg.lstsq(basis, others, rcond=1e-12)[0]
    for block in blocks:
        yield block[:, known:] / size[known:] - block[:, :known] / size[:known] @ fit


def scores_statistic(left: Iterable[Array]) -> float:
    """Lagrange-multiplier statistic of regressors, for errors of any variances (White 1980).
    ``left``: blocks of rows of regressors and errors without what others explain, (N, k + 1)."""
    total, products = np.zeros(1), np.zeros((1, 1))
    for rest in left:
        scores = rest[:, :-1] * rest[:, -1:]
        total, products = total + scores.sum(axis=0), products + scores.T @ scores
    return float(total @ np.linalg.pinv(products, rcond=1e-12, hermitian=True) @ total)


def half_waves(samples: int) -> Array:
    """Half waves as long as a sixth of the samples or longer, as of drifts, (N, 6)."""
    time = (np.arange(samples) + 0.5) / samples
    return np.asarray(np.cos(np.pi * np.outer(time, np.arange(1, 7))))


def filtered(signals: Array, coefficients: Array) -> Array:
    """Columns (N, k) filtered by so many coefficients, (N - their number + 1, k)."""
    return np.column_stack([np.convolve(column, coefficients, "valid") for column in signals.T])


def whitened(signal: Array) -> Array:
    """A signal without its mean and what its own past predicts, of the last samples."""
    centred = signal - signal.mean()
    return np.convolve(centred, autoregression(centred, MOST_WHITENING), mode="valid")


def may_follow(signal: Array) -> bool:
    """Whether an input may follow noise: it is not held, and its past tells a part of it alone.

    That part is next to all of a sweep or multisine, and little where little is fed back.
    """
    spread = float(np.var(signal))
    left = float(np.var(whitened(signal))) / spread if spread > 0.0 else 0.0
    return OF_ROUNDING < left < NEARLY_ALL and bool(np.mean(np.diff(signal) == 0.0) < 0.5)


def _vanishes(remainder: Array, signal: Array) -> bool:
    """Whether what is left of a signal is rounding error."""
    return bool(np.linalg.norm(remainder) <= 1e-10 * np.linalg.norm(signal))
