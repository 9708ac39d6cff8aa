"""Tests of parts of a model on samples that took no part in its estimation.

Whether the input matters cannot be judged on the estimation samples: the choice of delay and
orders, and nearly common factors of A and C, make Wald and likelihood-ratio tests reject far too
often.  On held-out samples neither has any influence on the level of a test.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.estimation.pem.autoregression import autoregression
from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

# Fewest samples from which a test is made.
FEWEST_SAMPLES = 50
# Largest order of the autoregression that whitens the errors before they are compared.
MOST_WHITENING = 30


@dataclass(frozen=True)
class HeldOutTest:
    """One-sided test that a part of a model improves predictions of held-out samples.

    Attributes
    ----------
    coefficient : float
        Regression coefficient of the prediction error without the part on what the part
        contributes: about 1 for a part that is right, about 0 for one that is made of noise.
    statistic : float
        Student's t of the coefficient.
    p_value : float
        Of the statistic, for coefficients above 0.  NaN where no test is possible: fewer than
        :data:`FEWEST_SAMPLES` samples, a part that contributes nothing, or an input that rests.
    samples : int
        Number of held-out samples.
    """

    coefficient: float
    statistic: float
    p_value: float
    samples: int

    def significant(self, level: float) -> bool | None:
        """Whether the part is significant at a level; None where no test is possible."""
        return None if math.isnan(self.p_value) else self.p_value < level


def input_significance(
    model: PolynomialModel,
    input: ArrayLike,  # noqa: A002
    output: ArrayLike,
    first: int = 0,
) -> HeldOutTest:
    """Test on held-out samples that the model's response to the input is in the output.

    The measured output is regressed on the simulated one, ``G u``, and on the free responses of
    1/(A F), which depend on signals before the held-out samples.  Where input and output are
    unrelated the two are independent there, whatever B, the orders and their selection.

    The noise model of the fit is not used: where A and C have nearly common factors, the
    predictor's errors without the input have a narrow peak just where ``(B/C) u`` has one.

    Parameters
    ----------
    model : PolynomialModel
        Stable.
    input, output : (N,) array_like
        Signals that end with the held-out samples; they may begin with the estimation samples.
    first : int
        First held-out sample.
    """
    held_out = np.asarray(output, dtype=float)[first:]
    if not np.ptp(np.asarray(input)[first:]) > 0.0:
        # What is simulated is then a free response alone.
        return HeldOutTest(math.nan, math.nan, math.nan, held_out.size)
    simulated = model.simulate(input)[first:]
    return contribution_test(
        held_out, simulated, free_responses(model.plant_denominator, len(held_out))
    )


def free_responses(denominator: Array, samples: int) -> Array:
    """Basis of the responses of ``1/denominator`` to its initial state alone, (samples, m)."""
    from scipy.signal import lfilter

    degree = len(denominator) - 1
    responses = np.zeros((samples, degree))
    for k in range(min(degree, samples)):
        responses[k, k] = 1.0
        responses[:, k] = lfilter([1.0], denominator, responses[:, k])
    return responses


def contribution_test(
    errors_without: ArrayLike, contribution: ArrayLike, nuisance: ArrayLike | None = None
) -> HeldOutTest:
    """Test that a contribution explains prediction errors made without it.

    Ordinary regression of the errors on the contribution and on what else may be in them.  An
    autoregression of the remaining errors, its order chosen by BIC, whitens both sides first
    (Cochrane & Orcutt 1949), so that the test holds where the noise model is imperfect.

    Parameters
    ----------
    errors_without, contribution : (N,) array_like
        Over held-out samples.
    nuisance : (N, k) array_like, optional
        Further regressors; a constant is always one.
    """
    e, x = np.asarray(errors_without, dtype=float), np.asarray(contribution, dtype=float)
    found = _whitened_regression(e, x, nuisance)
    if found is None:
        return HeldOutTest(math.nan, math.nan, math.nan, e.size)
    power = float(found.unexplained @ found.unexplained)
    coefficient = float(found.unexplained @ found.remainder) / power
    return _one_sided(coefficient, math.sqrt(found.variance / power), found.freedom, e.size)


@dataclass(frozen=True, eq=False)
class HeldOutContribution:
    """What one part of a model contributes to the outputs of a held-out record.

    Attributes
    ----------
    errors_without, contributions : (N, ny) arrays
    nuisance : sequence of (N, k) arrays
        Further regressors of each output, with coefficients of their own.
    """

    errors_without: Array
    contributions: Array
    nuisance: Sequence[Array]


def joint_contribution_test(records: Sequence[HeldOutContribution]) -> HeldOutTest:
    """The test of :func:`contribution_test` for several outputs, of one record or several.

    One coefficient for all outputs of all records, each weighed by the inverse of its noise
    (Zellner 1962 without the correlations).  Its standard error takes the correlations of the
    outputs' noise at the same sample into account.  A part that is weak at each output can be
    significant at all together.  Records and outputs where no test is possible are left out.
    """
    samples = sum(len(each.errors_without) for each in records)
    weighed = [found for each in records if (found := _weighed_record(each)) is not None]
    if not weighed:
        return HeldOutTest(math.nan, math.nan, math.nan, samples)
    precision = sum(each.precision for each in weighed)
    if not math.isfinite(precision):
        return HeldOutTest(1.0, math.inf, 0.0, samples)
    coefficient = sum(each.product for each in weighed) / precision
    error = math.sqrt(sum(each.spread for each in weighed)) / precision
    # Errors of different records are independent.
    freedom = sum(each.freedom for each in weighed)
    return _one_sided(coefficient, error, freedom, samples)


@dataclass(frozen=True)
class _WeighedRecord:
    """Sums over the outputs of a record, each over the variance of its noise.

    ``precision`` of squared contributions, infinite without noise; ``product`` of contributions
    and errors; ``spread`` is the variance of the product.
    """

    precision: float
    product: float
    spread: float
    freedom: int


def _weighed_record(record: HeldOutContribution) -> _WeighedRecord | None:
    """The sums of a record; None where no test is possible."""
    e, x = record.errors_without, record.contributions
    regressions = [
        found
        for k, others in enumerate(record.nuisance)
        if (found := _whitened_regression(e[:, k], x[:, k], others)) is not None
    ]
    if not regressions:
        return None
    # Whitening takes away a different number of first samples.
    common = min(len(found.rest) for found in regressions)
    freedom = min(found.freedom for found in regressions)
    deviations = [math.sqrt(found.variance) for found in regressions]
    if min(deviations) == 0.0:
        return _WeighedRecord(math.inf, math.inf, 0.0, freedom)
    scaled = list(zip(regressions, deviations, strict=True))
    unexplained = np.array([found.unexplained[-common:] / sd for found, sd in scaled])
    remainder = np.array([found.remainder[-common:] / sd for found, sd in scaled])
    correlation = np.corrcoef([found.rest[-common:] for found in regressions])
    return _WeighedRecord(
        float(np.sum(unexplained**2)),
        float(np.sum(unexplained * remainder)),
        float(np.sum(unexplained @ unexplained.T * correlation)),
        freedom,
    )


@dataclass(frozen=True, eq=False)
class _Regression:
    """A whitened signal and contribution, both without what other regressors explain.

    ``rest`` is what the contribution leaves of the signal, and ``variance`` that of its white
    noise, with ``freedom`` degrees of freedom.
    """

    remainder: Array
    unexplained: Array
    rest: Array
    variance: float
    freedom: int


def _whitened_regression(
    e: Array, x: Array, nuisance: ArrayLike | None = None
) -> _Regression | None:
    """The regression of :func:`contribution_test`; None where no test is possible."""
    if e.size < FEWEST_SAMPLES or not (np.isfinite(e).all() and np.isfinite(x).all()):
        return None
    others = np.ones((e.size, 1))
    if nuisance is not None:
        others = np.hstack([others, np.asarray(nuisance, dtype=float)])
    remainder, unexplained = _without(e, others), _without(x, others)
    if _vanishes(unexplained, x) or _vanishes(remainder, e):
        return None
    coefficient = float(unexplained @ remainder) / float(unexplained @ unexplained)
    whitening = autoregression(remainder - coefficient * unexplained, MOST_WHITENING)
    e, x, *columns = (np.convolve(signal, whitening, mode="valid") for signal in (e, x, *others.T))
    others = np.column_stack(columns)
    remainder, unexplained = _without(e, others), _without(x, others)
    freedom = e.size - others.shape[1] - len(whitening)
    if freedom < 1 or _vanishes(unexplained, x):
        return None
    coefficient = float(unexplained @ remainder) / float(unexplained @ unexplained)
    rest = remainder - coefficient * unexplained
    return _Regression(remainder, unexplained, rest, float(rest @ rest) / freedom, freedom)


def _one_sided(coefficient: float, error: float, freedom: int, samples: int) -> HeldOutTest:
    """Student's test of a coefficient above 0."""
    from scipy.special import stdtr

    # A part that explains the errors without remainder is as significant as can be.
    statistic = coefficient / error if error > 0.0 else math.inf
    p_value = float(stdtr(freedom, -statistic)) if math.isfinite(statistic) else 0.0
    return HeldOutTest(coefficient, statistic, p_value, samples)


def _without(signal: Array, regressors: Array) -> Array:
    """A signal less its least-squares fit by regressors, which are scaled to unit length."""
    length = np.linalg.norm(regressors, axis=0)
    basis = regressors[:, length > 0.0] / length[length > 0.0]
    fitted: Array = basis @ np.linalg.lstsq(basis, signal, rcond=1e-12)[0]
    return signal - fitted


def _vanishes(remainder: Array, signal: Array) -> bool:
    """Whether what is left of a signal is rounding error."""
    return bool(np.linalg.norm(remainder) <= 1e-10 * np.linalg.norm(signal))


def improvement_test(errors_without: ArrayLike, errors_with: ArrayLike) -> HeldOutTest:
    """Test that errors with a part of a model are smaller in mean square than without it.

    Student's t of the mean difference of squared errors (Diebold & Mariano 1995), whitened as in
    :func:`contribution_test`.  The coefficient is the relative decrease of the mean square.

    Parameters
    ----------
    errors_without, errors_with : (N,) array_like
        Over held-out samples.
    """
    from scipy.special import stdtr

    before = np.asarray(errors_without, dtype=float) ** 2
    difference = before - np.asarray(errors_with, dtype=float) ** 2
    samples = difference.size
    if samples < FEWEST_SAMPLES or not np.isfinite(difference).all() or not np.ptp(difference) > 0:
        return HeldOutTest(math.nan, math.nan, math.nan, samples)
    mean = float(difference.mean())
    whitening = autoregression(difference - mean, MOST_WHITENING)
    white = np.convolve(difference - mean, whitening, mode="valid")
    freedom = white.size - len(whitening)
    error = math.sqrt(float(white @ white) / freedom / samples) / abs(float(whitening.sum()))
    statistic = mean / error
    p_value = float(stdtr(freedom, -statistic))
    return HeldOutTest(mean / float(before.mean()), statistic, p_value, samples)
