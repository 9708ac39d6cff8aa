"""Estimates of models whose coefficients move, by the memetic search.

Autoregressive weights are solved for by least squares; those of C, or of the denominator of output
error, are searched, the others solved for at each point (variable projection: Golub & Pereyra
1973).  The variance of the noise may move too; a second pass weighs the errors by it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array, Flags, Indices
from evopem.config.settings import SearchSettings
from evopem.estimation.continuous import Fit, descents, gram_triangle, inverse_factor
from evopem.estimation.criteria import log_variance_of
from evopem.estimation.pem.covariance import coloured_covariance
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.pem.kernels.polynomials import stability_barriers
from evopem.estimation.search.memetic import discrete_recombination, memetic_search
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.varying import (
    Basis,
    BasisKind,
    VaryingModel,
    all_free,
    delayed_inputs,
    filtered,
    first_residual,
    lagged,
    root_radii,
    rows_of,
)
from evopem.signals.recording import Recording

# Population, offspring and refined ones of the search; its evaluations, those of its descents and
# of the last one.
POPULATION, OFFSPRING, REFINED = 4, 6, 2
EVALUATIONS, COARSE, FINE = 200, 10, 60
# Largest modulus of frozen roots of F; those of C forget the start in a share of the samples, as
# slow ones that nearly cancel slow poles would fit the record by what was before it.
RADIUS, FORGOTTEN = 0.9999, 20.0
HOPELESS = 1e6  # size of the errors, of those of the output, of a filter that grows without bound


@dataclass(frozen=True, eq=False)
class Scheduled:
    """A recording of one output, the schedule of its coefficients, (N,), and weights of errors.

    Of held-out samples the weight is 0: errors of others are fitted.
    """

    data: Recording
    schedule: Array
    weights: Array

    @classmethod
    def of(cls, data: Recording, schedule: ArrayLike | None = None) -> Self:
        """All samples alike; the schedule, of each sample or segment, is the time if not given."""
        s = data.times if schedule is None else np.asarray(schedule, dtype=float)
        if s.shape == (len(data.segments),):
            s = np.repeat(s, [segment.samples for segment in data.segments])
        return cls(data, s, np.ones(data.samples))

    @property
    def bounds(self) -> Indices:
        """Where the segments begin, and the end."""
        return np.array((*self.data.segment_starts, self.data.samples), dtype=np.intp)

    def basis(self, kind: BasisKind, dimension: int) -> Basis:
        """A basis over the range of the schedule."""
        return Basis(kind, dimension, float(self.schedule.min()), float(self.schedule.max()))


@dataclass(frozen=True, eq=False)
class VaryingEstimate:
    """A model with what its choice needs."""

    model: VaryingModel
    bic: float  # of all samples together
    errors: Array  # (N,) one step ahead, NaN where the past is not known
    free: Flags  # (n, dimension), the weights that were estimated

    @property
    def is_searched(self) -> bool:
        """Whether some of these are not solved for."""
        return bool(self.free[self.model.rows["searched"]].any())


@dataclass(frozen=True, eq=False)
class VaryingProblem:
    """Mean square of the weighted errors; a point holds the free weights of C, or of F."""

    scheduled: Scheduled
    orders: Orders
    basis: Basis
    free: Flags
    recombine = staticmethod(discrete_recombination)

    @cached_property
    def is_output_error(self) -> bool:
        """Whether the errors are those of simulation."""
        return any(self.orders.nf)

    @cached_property
    def kept(self) -> Indices:
        """Samples whose past in their segment is measured."""
        numbers = [np.arange(s.samples) for s in self.scheduled.data.segments]
        return np.flatnonzero(np.concatenate(numbers) >= first_residual(self.orders))

    @cached_property
    def bounds(self) -> Indices:
        """Where the kept samples of each segment begin, and the end."""
        return np.searchsorted(self.kept, self.scheduled.bounds)

    @cached_property
    def functions(self) -> Array:
        """The basis at the kept samples, (K, dimension)."""
        return self.basis.at(self.scheduled.schedule[self.kept])

    @cached_property
    def searched(self) -> slice:
        """Rows of the weights that are searched."""
        return rows_of(self.orders)["searched"]

    @cached_property
    def _is_linear(self) -> Flags:
        """Which of the free weights are solved for."""
        linear = self.free.copy()
        linear[self.searched] = False
        return linear

    @cached_property
    def _level(self) -> slice:
        """Columns of the level; those of what was before the segments of output error follow."""
        count = int(self._is_linear.sum())
        return slice(count - int(self.free[-1].sum()), count)

    @cached_property
    def _output(self) -> Array:
        return self.scheduled.data.output[self.kept]

    @cached_property
    def _weight(self) -> Array:
        return self.scheduled.weights[self.kept]

    @cached_property
    def _regressors(self) -> Array:
        """What the weights that are solved for multiply, (K, q), those of the level last."""
        data, bounds, n = self.scheduled.data, self.scheduled.bounds, self.orders.poles
        past = -lagged(data.output, range(1, n + 1), bounds)
        signals = [past, delayed_inputs(self.orders, data.inputs, bounds)]
        if not self.is_output_error:
            signals.append(np.zeros((data.samples, self.orders.nc)))
        every = np.hstack([*signals, np.ones((data.samples, 1))])[self.kept]
        return self._moving(every, self._is_linear)

    def _moving(self, signals: Array, free: Flags) -> Array:
        """Products of signals, (K, n), with the functions of their free weights."""
        rows, terms = np.nonzero(free)
        return np.asarray(signals[:, rows] * self.functions[:, terms])

    def coefficients(self, point: Array) -> Array:
        """Searched coefficients at each kept sample, (K, m)."""
        return np.asarray(self.functions @ self._weights_of(point).T)

    def _weights_of(self, point: Array) -> Array:
        weights = np.zeros(self.free[self.searched].shape)
        weights[self.free[self.searched]] = point
        return weights

    def projection(self, point: Array) -> Fit:
        """Errors of a point, weighted, whose other weights fit best."""
        moving, y, columns = self.coefficients(point), self._output, self._regressors
        frozen = self._at_moments @ self._weights_of(point).T
        if not np.isfinite(stability_barriers(frozen, self.limit * (1.0 + 1e-6))[0]).all():
            return self._hopeless
        with np.errstate(all="ignore"):
            if self.is_output_error:
                driven = np.hstack([columns, self._impulses])
                columns = filtered(driven, moving, self.bounds)
                columns[:, self._level] = driven[:, self._level]
            elif moving.shape[1]:
                both = filtered(np.column_stack([y, columns]), moving, self.bounds)
                y, columns = both[:, 0], both[:, 1:]
            size = float(np.linalg.norm(columns)) + float(np.linalg.norm(y))
        if not size < HOPELESS**2 * (1.0 + np.linalg.norm(self._output)):
            return self._hopeless
        return Fit.of(columns, y, self._weight)

    @cached_property
    def _hopeless(self) -> Fit:
        return Fit.of(0.0 * self._regressors, HOPELESS * self._output, self._weight)

    @cached_property
    def limit(self) -> float:
        """Largest modulus of the frozen roots that are searched."""
        return RADIUS if self.is_output_error else min(RADIUS, 1.0 - FORGOTTEN / len(self.kept))

    @cached_property
    def _at_moments(self) -> Array:
        return self.basis.at(self.basis.moments)

    @cached_property
    def _impulses(self) -> Array:
        """Impulses at the first samples of each segment: what was before it, (K, n segments)."""
        n, stop = self.orders.poles, len(self.kept)
        rows = [k for first in self.bounds[:-1] for k in range(first, min(first + n, stop))]
        impulses = np.zeros((stop, len(rows)))
        impulses[rows, np.arange(len(rows))] = 1.0
        return impulses

    def jacobian(self, point: Array, fit: Fit) -> Array:
        """Derivatives of the errors by a point, the other weights held, (K, k)."""
        lags = range(1, self.searched.stop - self.searched.start + 1)
        source = -fit.errors
        if self.is_output_error:
            level = fit.columns[:, self._level] @ fit.coefficients[self._level]
            source = self._output - fit.errors - level
        driven = self._moving(lagged(source, lags, self.bounds), self.free[self.searched])
        return filtered(driven, self.coefficients(point), self.bounds)

    def start(self) -> Array:
        """By two stages: the errors of a long autoregression are regressors of another one."""
        n, orders = self.orders.poles, self.orders
        long = n if self.is_output_error else 2 * n + orders.nc
        arx = Orders(na=long, nb=tuple(nb + long - n for nb in orders.nb), nk=orders.nk or 0)
        problem = VaryingProblem(self.scheduled, arx, self.basis, all_free(arx, self.basis))
        fit = problem.projection(np.empty(0))
        if self.is_output_error:
            weights = fit.coefficients.reshape(problem.free.shape)[:n]
            return weights[self.free[self.searched]]
        errors = np.zeros(self.scheduled.data.samples)
        errors[problem.kept] = fit.errors
        past = lagged(errors, range(1, orders.nc + 1), self.scheduled.bounds)[self.kept]
        columns = np.hstack([self._moving(past, self.free[self.searched]), self._regressors])
        solved = Fit.of(columns, self._output, self._weight).coefficients
        return solved[: int(self.free[self.searched].sum())]

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Random roots, and slopes of a tenth of what they give, (count, k)."""
        m, points = self.searched.stop - self.searched.start, []
        for _ in range(count):
            z = np.sqrt(generator.random(m // 2)) * np.exp(1j * np.pi * generator.random(m // 2))
            roots = np.r_[z, z.conj(), generator.uniform(-1.0, 1.0, m % 2)]
            constant = np.poly(roots).real[1:, None]
            shape = (m, self.basis.dimension - 1)
            weights = np.hstack([constant, 0.1 * constant * generator.normal(size=shape)])
            points.append(weights[self.free[self.searched]])
        return self.repair(np.array(points))

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population with the start in it."""
        return np.vstack([self.repair(self.start()[None]), self.random(count - 1, generator)]), 1

    def repair(self, points: Array) -> Array:
        """Points whose frozen roots lie within the circle: all roots drawn in alike."""
        repaired = []
        for point in points:
            weights = self._weights_of(point)
            radius = float(root_radii(self._at_moments @ weights.T).max())
            drawn_in = min(self.limit / max(radius, 1e-300), 1.0)
            powers = drawn_in ** np.arange(1, len(weights) + 1)
            repaired.append((weights * powers[:, None])[self.free[self.searched]])
        return np.array(repaired)

    def triangle(self) -> tuple[int, Array]:
        """How many errors of an autoregression count, and R of its regressors and the output."""
        rows = np.column_stack([self._regressors, self._output]) * self._weight[:, None]
        return int(np.count_nonzero(self._weight)), gram_triangle(rows)[0]

    def values(self, points: Array) -> Array:
        """Mean squares of the weighted errors, (M,)."""
        fits = map(self.projection, points)
        return np.array([np.sum((fit.errors * fit.weights) ** 2) for fit in fits]) / self._count

    @cached_property
    def _count(self) -> int:
        """How many errors count."""
        return max(int(np.count_nonzero(self._weight)), 1)

    def descend(self, points: Array, steps: int = COARSE, tolerance: float = 1e-4) -> Descent:
        """Descents that a generation refines."""
        given = self.repair(points), self._count, steps, tolerance
        return descents(self.projection, self.jacobian, *given, x_scale="jac")

    def polish(self, points: Array) -> Descent:
        """Descents to the last digits that count."""
        return self.descend(points, FINE, 1e-6)

    def estimate(self, point: Array, with_covariance: bool = True) -> VaryingEstimate:
        """The model of a point, with the variance of its noise."""
        fit, data = self.projection(point), self.scheduled.data
        counted, weights = self._weight > 0.0, np.zeros(self.free.shape)
        weights[self.searched] = self._weights_of(point)
        weights[self._is_linear] = fit.coefficients[: int(self._is_linear.sum())]
        of_noise = fit.errors[counted], self.functions[counted]
        log_variance, likelihood, terms = log_variance_of(*of_noise)
        errors = np.full(data.samples, np.nan)
        errors[self.kept] = fit.errors
        covariance = None
        if with_covariance:
            covariance = self._covariance(point, fit, counted, log_variance)
        model = VaryingModel(
            orders=self.orders,
            basis=self.basis,
            weights=weights,
            log_variance=log_variance,
            sampling_rate=data.sampling_rate,
            covariance=covariance,
            schedule="time",
            input_names=data.input_names,
            output_names=data.output_names,
        )
        bic = likelihood + (int(self.free.sum()) + terms) * float(np.log(self._count))
        return VaryingEstimate(model, bic, errors, self.free)

    def _covariance(
        self, point: Array, fit: Fit, counted: Flags, log_variance: Array
    ) -> ParameterCovariance | None:
        """Of all weights row by row, 0 of those that are not free."""
        deviations = np.exp(0.5 * self.functions[counted] @ log_variance)
        slopes = np.hstack([self.jacobian(point, fit), -fit.columns])[counted]
        slopes, errors = slopes / deviations[:, None], fit.errors[counted] / deviations
        place = np.arange(self.free.size).reshape(self.free.shape)
        at = np.r_[place[self.searched][self.free[self.searched]], place[self._is_linear]]
        if self.is_output_error:
            within = np.diff(np.searchsorted(np.flatnonzero(counted), self.bounds)).tolist()
            covariance = coloured_covariance(slopes, errors, len(at), "quadratic", True, within)
        else:
            freedom = len(errors) / max(len(errors) - slopes.shape[1], 1)
            inverse, null_space = inverse_factor(slopes)
            covariance = ParameterCovariance(np.sqrt(freedom) * inverse, null_space)
        if covariance is None:
            return None
        spread = np.zeros((self.free.size, len(at)))
        spread[at, np.arange(len(at))] = 1.0
        return covariance.through(spread)


def fit_varying(
    scheduled: Scheduled,
    orders: Orders,
    basis: Basis,
    free: Flags | None = None,
    starts: Sequence[Array] = (),
) -> VaryingEstimate:
    """Estimate AR, ARX, ARMA, ARMAX or output error with moving coefficients.

    ``free`` (n, dimension): the weights that are not 0.  ``starts``: descents in place of a search.
    """
    free = all_free(orders, basis) if free is None else free
    problem = VaryingProblem(scheduled, orders, basis, free)
    point = np.empty(0)
    if np.any(free[problem.searched]) and starts:
        ended = problem.polish(np.array(starts))
        point = ended.points[np.argmin(ended.values)]
    elif np.any(free[problem.searched]):
        settings = SearchSettings(
            evaluations=EVALUATIONS, mu=POPULATION, lambda_=OFFSPRING, nu=REFINED
        )
        key = (orders.na, *orders.nb, orders.nc, *orders.nf, *orders.nk, basis.dimension)
        generator = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
        point = memetic_search(problem, settings, generator).point
    first = problem.estimate(point)
    if not np.any(first.model.log_variance[1:]):
        return first
    # The second pass: errors in units of their deviation.
    deviations = np.sqrt(first.model.noise_variance(scheduled.schedule))
    weights = scheduled.weights / deviations * np.sqrt(np.mean(deviations**2))
    weighed = replace(problem, scheduled=replace(scheduled, weights=weights))
    if len(point):
        point = weighed.polish(point[None]).points[0]
    return weighed.estimate(point)
