"""Criteria of estimates, and the likelihood and colour of errors by a vector autoregression."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from evopem.arrays import Array, Integers
from evopem.errors import LostModelError
from evopem.models.state_space import StateSpaceModel
from evopem.models.states import delayed

# A root this close to the largest allowed radius, relative to the distance of that radius from the
# unit circle, counts as lying at the stability bound.
BOUND_WIDTH = 0.05
# Largest order tried, and the share of the samples that its coefficients of one output may take.
MOST_LAGS, SHARE = 30, 0.1
# Lags go on until the autocovariances are below this share of the variances, at most so many.
NEGLIGIBLE, LONGEST = 1e-3, 2000

# Relative excess of the squared errors of a returned model, over some first samples, from which on
# it is taken for broken; and the share of the outputs' squares that is rounding.  Four roots of C
# at the bound, of which companion matrices know few digits, make 0.02; most models below 1e-6.
LOST, FIRST_SAMPLES, ROUNDING = 0.05, 8192, 1e-10

# Errors beyond this many standard deviations, from the median of the absolute ones, stand out.
LIMIT, DEVIATIONS = 3.0, 1.4826
VARIANCE_STEPS = 30  # steps of Fisher's scoring towards the logarithm of a variance


@dataclass(frozen=True)
class Criteria:
    """Criteria of an estimate over the samples of its loss (chapter eq. 20 to 23). The chapter's
    fit (eq. 21) is 100 minus the absolute objective."""

    objective: float
    fit_percent: float
    rss: float
    bic: float


def criteria_of(residuals: Array, output: Array, objective: str, parameters: int) -> Criteria:
    """Criteria of residuals, (N,), the outputs of the same samples, and estimated parameters."""
    square_sum, count = float(residuals @ residuals), len(residuals)
    rss = 100.0 * square_sum / float(output @ output)
    absolute = 100.0 * float(np.sum(np.abs(residuals)) / np.sum(np.abs(output)))
    deviation = float(np.linalg.norm(output - output.mean()))
    return Criteria(
        objective=rss if objective == "quadratic" else absolute,
        fit_percent=100.0 * (1.0 - np.sqrt(square_sum) / deviation),
        rss=rss,
        bic=float(np.log(square_sum / count) + parameters * np.log(count) / count),
    )


def log_variance_of(errors: Array, functions: Array) -> tuple[Array, float, int]:
    """Weights of the logarithm of a variance, -2 ln likelihood, and how many were needed.

    Constant unless BIC prefers that it moves, by Fisher's scoring (Aitkin 1987).
    """
    count, terms = functions.shape
    constant = np.zeros(terms)
    constant[0] = np.log(max(float(np.mean(errors**2)), 1e-300))
    best = constant, count * (constant[0] + 1.0), 1
    if terms == 1:
        return best
    weights, squares, inverse = constant.copy(), errors**2, np.linalg.pinv(functions, 1e-12)
    for _ in range(VARIANCE_STEPS):
        ratio = squares * np.exp(-functions @ weights)
        step = inverse @ (ratio - 1.0)
        weights = weights + np.clip(step, -1.0, 1.0)
        if np.max(np.abs(step)) < 1e-8:
            break
    logarithm = functions @ weights
    likelihood = float(np.sum(logarithm + squares * np.exp(-logarithm)))
    gain = best[1] - likelihood - (terms - 1) * np.log(count)
    return (weights, likelihood, terms) if gain > 0.0 else best


def power_of_two_scale(signal: Array) -> float:
    """The power of two next below a signal's largest magnitude, which changes no mantissa; or 1."""
    largest = float(np.max(np.abs(signal)))
    return 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0


def lies_at_bound(radius: float, bound: float) -> bool:
    """Whether a root of some radius lies at the largest radius allowed."""
    return bool(1.0 - radius <= (1.0 + BOUND_WIDTH) * (1.0 - bound))


def log_loss(errors: Array, objective: str) -> float:
    """Minus twice the largest log-likelihood of errors, (N, l), but for a constant. Correlated
    normal ones; for the absolute objective independent ones with Laplace's distribution."""
    if objective == "absolute":
        with np.errstate(divide="ignore"):
            return 2.0 * float(np.sum(np.log(np.mean(np.abs(errors), axis=0))))
    sign, log_determinant = np.linalg.slogdet(errors.T @ errors / len(errors))
    return float(log_determinant) if sign > 0 else -np.inf


def limited(errors: Array) -> Array:
    """Errors, (N, l), with those that stand out drawn in: outliers have no colour."""
    middle = np.median(errors, axis=0)
    limit = LIMIT * DEVIATIONS * np.median(np.abs(errors - middle), axis=0)
    return np.asarray(np.clip(errors, middle - limit, middle + limit))


def sample_autocovariances(errors: Array, bounds: Integers, lags: int) -> Array:
    """Biased estimates of ``E e_(t+k) e_t'`` for k = 0 ... lags, (lags + 1, l, l)."""
    covariances = np.zeros((lags + 1, errors.shape[1], errors.shape[1]))
    for first, stop in pairwise(bounds):
        part = errors[first:stop]
        for lag in range(min(lags + 1, len(part))):
            covariances[lag] += part[lag:].T @ part[: len(part) - lag]
    return covariances / len(errors)


@dataclass(frozen=True, eq=False)
class Autoregression:
    """A vector autoregression of errors, ``e_t = sum_k coefficients[k - 1] e_(t-k) + noise``."""

    coefficients: Array  # (order, l, l)
    autocovariances: Array  # (order + 1, l, l): sample ones of the errors
    bic: float  # ln det(cov noise) + p ln(N) / N with p coefficients


def autoregression_of(errors: Array, bounds: Integers) -> Autoregression:
    """The vector autoregression of the order of lowest BIC, by multivariate Yule-Walker equations.
    Of (N, l) errors; ``bounds`` are the first samples of the segments, and N."""
    samples, ny = errors.shape
    most = int(min(MOST_LAGS, SHARE * samples / ny))
    gamma = sample_autocovariances(errors, bounds, max(most, 1))
    best, chosen = np.inf, np.empty((0, ny, ny))
    for order, (coefficients, noise) in enumerate(_recursion(gamma, most)):
        sign, log_determinant = np.linalg.slogdet(0.5 * (noise + noise.T))
        if sign <= 0:
            break
        bic = log_determinant + order * ny**2 * np.log(samples) / samples
        if bic < best:
            best, chosen = float(bic), coefficients
    return Autoregression(chosen, gamma[: len(chosen) + 1], best)


def coloured_autocovariances(errors: Array, bounds: Integers) -> Array:
    """``E e_(t+k) e_t'`` of :func:`autoregression_of` until they are negligible, (lags, l, l)."""
    samples, ny = errors.shape
    fitted = autoregression_of(errors, bounds)
    chosen, covariances = fitted.coefficients, list(fitted.autocovariances)
    limit = NEGLIGIBLE * np.trace(covariances[0])
    while len(chosen) and len(covariances) <= min(LONGEST, samples // 2):
        covariances.append(sum(chosen[k] @ covariances[-1 - k] for k in range(len(chosen))))
        if max(np.abs(c).max() for c in covariances[-len(chosen) - 5 :]) < limit / ny:
            break
    return np.array(covariances)


def _recursion(gamma: Array, most: int) -> Iterator[tuple[Array, Array]]:
    """Coefficients and noise covariance of the orders 0 ... ``most``. By the recursion of Levinson
    for several channels (Whittle 1963, Wiggins & Robinson 1965)."""
    ny = gamma.shape[1]
    forward, backward = np.empty((0, ny, ny)), np.empty((0, ny, ny))
    ahead, behind = gamma[0], gamma[0]
    for order in range(most + 1):
        yield forward, ahead
        if order == most:
            return
        # What the next lag explains beyond those before it.
        rest = gamma[order + 1] - sum(
            (forward[k] @ gamma[order - k] for k in range(order)), np.zeros((ny, ny))
        )
        try:
            last = np.linalg.solve(behind.T, rest.T).T
            first = np.linalg.solve(ahead.T, rest).T
        except np.linalg.LinAlgError:
            return  # the outputs' errors are one signal
        longer = np.concatenate([forward - last @ backward[::-1], last[None]])
        backward = np.concatenate([backward - first @ forward[::-1], first[None]])
        forward = longer
        ahead, behind = ahead - last @ rest.T, behind - first @ rest


def check_returned(
    model: StateSpaceModel, inputs: Array, outputs: Array, errors: Array, text: str
) -> None:
    """LostModelError where a model predicts worse than its search, whose last errors are given.

    It predicts from the initial state that fits (N, l) outputs best.  Rounding in a change of
    coordinates may spoil poles that nearly coincide.
    """
    first = len(outputs) - len(errors)
    u = delayed(inputs, model.delays)[first:][:FIRST_SAMPLES]
    y, errors = outputs[first:][:FIRST_SAMPLES], errors[:FIRST_SAMPLES]
    searched = np.sum(errors**2, axis=0) + ROUNDING * np.sum(outputs**2, axis=0)
    searched += np.finfo(float).tiny  # of samples at rest
    plain = replace(model, input_delays=(), noise_covariance=np.diag(searched), covariance=None)
    with np.errstate(all="ignore"):
        returned = plain.residuals(u, y, plain.prediction_state(u, y))
        excess = float(np.mean(np.sum(returned**2, axis=0) / searched)) - 1.0
    if not excess <= LOST:
        raise lost_model(text, f"their squares are {excess:.2g} times above those of its search")


def lost_model(text: str, compared: str) -> LostModelError:
    """The refusal of a model whose errors are not those of its search."""
    problem = f"the errors of the best {text} are lost in rounding: {compared}"
    return LostModelError("search", problem, "lower the orders")
