"""Regularised impulse responses: FIR models whose coefficients have a normal prior.

The coefficients of each input have zero mean and a covariance P, a *kernel*, that makes them decay
and be smooth (Chen, Ohlsson & Ljung 2012; Pillonetto et al. 2014).  What a kernel is scaled and
shaped by, and the variance of the noise, have the largest marginal likelihood, computed from one QR
decomposition of the regressors (Chen & Ljung 2013).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.estimation.criteria import criteria_of
from evopem.estimation.pem.covariance import filtered_backwards, innovations_of, is_coloured
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.signals.least_squares import triangle_of

Kernel = Callable[[Array, int], tuple[Array, list[Array]]]
"""P (n, n) of hyper-parameters, or (n,) weights of responses that are 1 up to each lag, on which P
is diagonal; and its derivatives by each of them."""
Prior = tuple[Array, Array, list[Array]]  # X, or its sums up to each lag, P and its derivatives

# Logarithms of the scale, of signals and coefficients of unit length, over the noise variance: of a
# kernel that leaves nothing, and beyond which rounding counts.
SCALES = (-12.0, 25.0)
# Time constants of the decay in samples, the longest in lengths of the response, and the largest
# Fisher transform of the correlation between neighbours.
SHORTEST, LONGEST, MOST_CORRELATED = 0.3, 10.0, 4.0
# Where searches begin: scales, and time constants in lengths of the response.
FIRST_SCALES, FIRST_SHARES = (0.0, 4.0, 8.0), (0.02, 0.08, 0.3)
# Relative change of twice the logarithm of the likelihood at which a search ends.
CONVERGED = 1e-7
SPOILT = 1e12  # value of hyper-parameters whose covariance rounding makes indefinite
PAST, LAGS = 40, 100  # past outputs and lags of the input in a predictor of which a delay is judged
# Hyper-parameters are searched for delays so far apart.  Those between take over the likelier ones
# of both, and search where that comes so near to the lowest value, as twice a logarithm; where both
# are so far from it, they are far as well.
APART, NEAR, FAR = 16, 10.0, 100.0


def tuned_correlated(h: Array, n: int) -> tuple[Array, list[Array]]:
    """TC: ``c λ^max(i, j)``; ``h`` the logarithms of c and of the time constant ``-1/ln λ``."""
    lags, decay = np.arange(1.0, n + 1.0), -np.exp(-h[1])
    p = np.exp(h[0] + decay * lags)
    by_time = -decay * lags * p
    for row in (p, by_time):
        row[:-1] -= row[1:]
    return p, [p, by_time]


def diagonal_correlated(h: Array, n: int) -> tuple[Array, list[Array]]:
    """DC: ``c λ^((i + j)/2) ρ^|i - j|``; the third of ``h`` is ``artanh ρ``."""
    lags, decay, rho = np.arange(1.0, n + 1.0), -np.exp(-h[1]), np.tanh(h[2])
    root = np.exp(0.5 * (h[0] + decay * lags))
    size, half = np.multiply.outer(root, root), -0.5 * decay * lags
    powers = rho ** (lags - 1.0)
    by_rho = size * scipy.linalg.toeplitz((lags - 1.0) * np.append(0.0, powers[: n - 1]))
    p = size * scipy.linalg.toeplitz(powers)
    return p, [p, np.add.outer(half, half) * p, (1.0 - rho**2) * by_rho]


def stable_spline(h: Array, n: int) -> tuple[Array, list[Array]]:
    """SS: ``c (λ^(i + j + max(i, j)) / 2 - λ^(3 max(i, j)) / 6)``; ``h`` as of TC."""
    lags, decay = np.arange(1.0, n + 1.0), -np.exp(-h[1])
    last = np.maximum.outer(lags, lags)
    longer = np.add.outer(lags, lags) + last
    first, second = 0.5 * np.exp(h[0] + decay * longer), np.exp(h[0] + 3.0 * decay * last) / 6.0
    return first - second, [first - second, -decay * (longer * first - 3.0 * last * second)]


KERNELS: dict[str, Kernel] = {"TC": tuned_correlated, "DC": diagonal_correlated}
KERNELS["SS"] = stable_spline


@dataclass(frozen=True, eq=False)
class Evidence:
    """Marginal likelihood of a reduced regression ``y = X b + e``, its rows as many as needed.

    ``blocks``: columns (k, n_i) of X of each input, but for last rows of zeros; ``target`` (k,) y;
    ``samples`` that they stand for, those taken by levels not counted.
    """

    blocks: tuple[Array, ...]
    target: Array
    samples: int

    def value(self, kernel: Kernel, hyper: Array) -> float:
        """Minus twice the logarithm of the likelihood but for a constant.

        ``hyper``: rows of the inputs one after the other, scales relative to the noise variance,
        which has its likeliest value.
        """
        likelihood = self._whitened(self._priors(kernel, hyper))
        return likelihood[0] if likelihood else SPOILT

    def value_and_gradient(self, kernel: Kernel, hyper: Array) -> tuple[float, Array]:
        """:meth:`value` and its gradient."""
        priors = self._priors(kernel, hyper)
        likelihood = self._whitened(priors)
        if likelihood is None:
            return SPOILT, np.zeros(hyper.size)
        value, lower, whitened = likelihood
        share, gradient = self.samples / float(whitened @ whitened), []
        for x, p, derivatives in priors:
            below = np.zeros((len(lower) - len(x), x.shape[1]))
            half = scipy.linalg.lapack.dtrtrs(lower, np.vstack([x, below]), lower=1)[0]
            b = whitened @ half
            squares = np.sum(half**2, axis=0) if p.ndim == 1 else half.T @ half
            by_p = squares - share * (b**2 if p.ndim == 1 else np.outer(b, b))
            gradient += [float(np.vdot(by_p, by_hyper)) for by_hyper in derivatives]
        return value, np.array(gradient)

    def _priors(self, kernel: Kernel, hyper: Array) -> list[Prior]:
        pairs = zip(self.blocks, self._rows(hyper), strict=True)
        priors = ((x, *kernel(h, x.shape[1])) for x, h in pairs)
        return [(x.cumsum(axis=1) if p.ndim == 1 else x, p, slopes) for x, p, slopes in priors]

    def _whitened(self, priors: Sequence[Prior]) -> tuple[float, Array, Array] | None:
        """The value, the Cholesky factor of the target's covariance, and the target whitened. None
        for priors of such a scale that rounding leaves nothing."""
        covariance = np.eye(len(self.target))
        for x, p, _ in priors:
            of_input = (root := x * np.sqrt(p)) @ root.T if p.ndim == 1 else x @ p @ x.T
            covariance[: len(x), : len(x)] += of_input
        try:
            lower = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            return None
        whitened = scipy.linalg.lapack.dtrtrs(lower, self.target, lower=1)[0]
        power = float(whitened @ whitened)
        value = self.samples * np.log(power) + 2.0 * float(np.sum(np.log(np.diag(lower))))
        return value, np.asarray(lower, dtype=float), whitened

    def _rows(self, hyper: Array) -> Array:
        return np.reshape(hyper, (len(self.blocks), -1))

    def likeliest(self, near: tuple[Kernel, Array] | None = None) -> tuple[Kernel, Array]:
        """The kernel and the hyper-parameters of the largest likelihood of descents."""
        if near is not None:
            return near[0], self.descended(near[0], [self._rows(near[1])])[1]
        optima, known = [], np.empty(0)
        for name, kernel in KERNELS.items():
            starts = list(self.starts())
            if name == "DC":
                # Of which TC is the case of ρ = √λ.
                rows = self._rows(known)
                rho = np.arctanh(np.minimum(np.exp(-0.5 * np.exp(-rows[:, 1])), 0.999))
                starts = [np.column_stack([rows, rho])]
            value, known = self.descended(kernel, starts)
            optima.append((value, name, known))
        _, name, hyper = min(optima, key=lambda optimum: optimum[0])
        return KERNELS[name], hyper

    def starts(self) -> Iterator[Array]:
        """Hyper-parameters of TC and SS that searches begin with."""
        for scale, share in product(FIRST_SCALES, FIRST_SHARES):
            yield np.array([(scale, np.log(share * x.shape[1])) for x in self.blocks])

    def descended(self, kernel: Kernel, starts: Sequence[Array]) -> tuple[float, Array]:
        """The lowest value of a descent from the best of some starts, and where it is."""
        first = starts[0]
        if len(starts) > 1:
            first = min(starts, key=lambda start: self.value(kernel, start.ravel()))
        bounds = [
            limits
            for x in self.blocks
            for limits in (
                SCALES,
                (np.log(SHORTEST), np.log(LONGEST * x.shape[1])),
                (-MOST_CORRELATED, MOST_CORRELATED),
            )[: first.shape[1]]
        ]
        ended = scipy.optimize.minimize(
            lambda hyper: self.value_and_gradient(kernel, hyper),
            np.clip(first.ravel(), *np.transpose(bounds)),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": CONVERGED},
        )
        return float(ended.fun), np.asarray(ended.x)

    def fitted(self, kernel: Kernel, hyper: Array) -> tuple[Array, Array, float, float]:
        """Mean of b, a factor of its covariance over the noise variance, that variance, and the
        trace of the hat matrix, by a QR decomposition that bears any noise variance."""
        pairs = zip(self._rows(hyper), self.blocks, strict=True)
        root = scipy.linalg.block_diag(*(_root(kernel(h, x.shape[1])[0]) for h, x in pairs))
        # Of b = root beta, where beta has the variance of the noise.
        x = np.hstack(self.blocks) @ root
        orthogonal, upper = np.linalg.qr(np.vstack([x, np.eye(len(root))]))
        inverse = np.linalg.inv(upper)
        beta = inverse @ (orthogonal[: len(x)].T @ self.target)
        left = self.target - x @ beta
        variance = float(left @ left + beta @ beta) / self.samples
        return root @ beta, root @ inverse, variance, len(root) - float(np.sum(inverse**2))


def _root(matrix: Array) -> Array:
    """A square root of a kernel that rounding may have made indefinite."""
    if matrix.ndim == 1:
        return np.triu(np.tile(np.sqrt(matrix), (len(matrix), 1)))
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, eq=False)
class Posterior:
    """What samples tell of the coefficients and levels of a regularised response.

    ``point`` as of :class:`.PolynomialErrors`, the mean; ``factor`` (n, r) of the covariance of the
    coefficients for white noise; ``effective`` number that the samples determine; its ``prior``.
    """

    point: Array
    factor: Array
    noise_variance: float
    effective: float
    prior: tuple[Kernel, Array]

    @property
    def parameters(self) -> int:
        """Coefficients that the samples determine, and levels."""
        return round(self.effective) + len(self.point) - len(self.factor)

    def covariance(self, errors: PolynomialErrors) -> ParameterCovariance:
        """Covariance of the coefficients, of residuals of any colour.

        With the gain ``K = S X'/s^2``, S the covariance for white noise of variance s^2, the error
        of the mean is that of the prior, ``(I - K X) b``, and ``K v``, v the coloured noise.
        """
        nothing, residuals = np.zeros((len(self.factor), 0)), errors.residuals(self.point)
        if not is_coloured(residuals):
            return ParameterCovariance(self.factor, nothing)
        jacobian, count = errors.jacobian(self.point), len(self.factor)
        x, of_levels = jacobian[:, :count] @ self.factor, jacobian[:, count:]
        x = x - of_levels @ np.linalg.lstsq(of_levels, x, rcond=None)[0]
        s = np.sqrt(self.noise_variance)
        noise_filter, deviation = innovations_of(residuals, round(self.effective), s)
        back = filtered_backwards(x, noise_filter, errors.residual_counts())
        of_prior = np.eye(x.shape[1]) - x.T @ x / s**2
        both = of_prior + (deviation / s**2) ** 2 * (back.T @ back)
        return ParameterCovariance(self.factor @ _root(both), nothing)


def posterior(errors: PolynomialErrors, near: tuple[Kernel, Array] | None = None) -> Posterior:
    """The response of largest marginal likelihood, or so next to a prior, of B and levels."""
    count, levels = errors.orders.parameters, errors.levels
    triangle = _triangle(errors)
    # Levels have no prior: the rows below theirs are those of the likelihood without them.
    below = triangle[levels:, levels:]
    size = float(np.linalg.norm(below[:, -1])) or 1.0
    blocks, units = [], []
    for x in np.split(below[:, :-1], np.cumsum(errors.orders.nb)[:-1], axis=1):
        units.append(float(np.linalg.norm(x)) / np.sqrt(x.shape[1]) or 1.0)
        blocks.append(x / units[-1])
    evidence = Evidence(tuple(blocks), below[:, -1] / size, errors.scored_samples - levels)
    prior = evidence.likeliest(near)
    b, factor, variance, effective = evidence.fitted(*prior)
    unit = size / np.repeat(units, errors.orders.nb)
    point, variance = np.concatenate([unit * b, np.zeros(levels)]), size**2 * variance
    if levels:
        known = triangle[:levels, levels:-1] @ point[:count]
        point[count:] = np.linalg.solve(triangle[:levels, :levels], triangle[:levels, -1] - known)
    factor = np.sqrt(variance) / np.repeat(units, errors.orders.nb)[:, None] * factor
    return Posterior(point, factor, variance, effective, prior)


def _triangle(errors: PolynomialErrors) -> Array:
    """R of the regressors of levels and coefficients, and the outputs, as last column."""
    origin, first = np.zeros(errors.dimension), 0
    outputs, count = errors.residuals(origin), errors.orders.parameters

    def rows() -> Iterator[Array]:
        nonlocal first
        for block in errors.jacobian_blocks(origin):
            target = outputs[first : first + len(block)]
            first += len(block)
            yield np.column_stack([-block[:, count:], -block[:, :count], target])

    return triangle_of(rows())


def estimate_response(errors: PolynomialErrors, sampling_rate: float) -> PolynomialEstimate:
    """The estimate of a regularised response, whose orders are those of ``errors``.

    NoModelError when there are fewer samples than levels and one more.
    """
    response, outputs = posterior(errors), errors.scored_outputs()
    point = response.point
    counted = errors.residuals(point)
    criteria = criteria_of(counted, outputs, errors.objective, response.parameters)
    search = SearchResult(point, criteria.objective, SearchDiagnostics.none())
    variance, covariance = response.noise_variance, response.covariance(errors)
    about = criteria, search, sampling_rate, variance, covariance
    return PolynomialEstimate.at(errors, point, *about)


def delay_evidence(past: Array, lagged: Array, target: Array, samples: int, delays: range) -> Array:
    """Minus twice the logarithm of the marginal likelihood of each delay of an input, but for a
    constant, of predictors from past outputs and lags of the input behind the delay, whose
    coefficients have a prior. Those far above the lowest one are upper bounds.

    ``past`` outputs (k, p), ``lagged`` inputs from lag 0 on (k, n), and the ``target`` output (k,)
    are reduced to as many rows as needed, which stand for ``samples``.
    """
    size = float(np.linalg.norm(target))
    if size == 0.0:
        return np.zeros(len(delays))
    past, lagged = _of_unit_length(past), _of_unit_length(lagged)

    @cache
    def evidence(place: int) -> Evidence:
        first, p = delays[place], past.shape[1]
        columns = past, lagged[:, first : first + LAGS], target[:, None] / size
        r = triangle_of([np.hstack(columns)])
        return Evidence((r[:p, :p], r[:, p:-1]), r[:, -1], samples)

    return _lowest_values(evidence, len(delays)) + 2.0 * samples * np.log(size)


def _of_unit_length(columns: Array) -> Array:
    """Columns over their mean length."""
    length = float(np.linalg.norm(columns)) / np.sqrt(columns.shape[1])
    return columns / (length or 1.0)


def _lowest_values(evidence: Callable[[int], Evidence], count: int) -> Array:
    """The lowest value of each of them, where it comes near to the lowest of all."""
    values, searched = np.full(count, np.inf), dict[int, Array]()

    def search(k: int, starts: Sequence[Array]) -> None:
        value, hyper = evidence(k).descended(tuned_correlated, starts)
        values[k], searched[k] = min(value, values[k]), hyper.reshape(2, -1)

    ends = [*range(0, count - 1, APART), count - 1]
    for k in ends:
        search(k, [*evidence(k).starts(), *list(searched.values())[-1:]])
    hopeless = values.min() + FAR
    for k in range(count):
        around = [end for end in ends if abs(end - k) < APART]
        known = min(values[around])
        if known < hopeless:
            known = min(
                evidence(k).value(tuned_correlated, searched[end].ravel()) for end in around
            )
        values[k] = min(known, values[k])
    while True:
        near = [k for k in np.argsort(values).tolist() if values[k] < values.min() + NEAR]
        waiting = [k for k in near if k not in searched]
        if not waiting:
            return values
        search(waiting[0], [searched[min(searched, key=lambda k: abs(k - waiting[0]))]])
