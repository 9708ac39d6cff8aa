"""Direct estimates in continuous time: output error in s, by the memetic search.

Poles and delays are searched; numerators, initial states and levels enter the output linearly and
are solved for (variable projection: Golub & Pereyra 1973).  Derivatives are exact: those by a
denominator F are states of 1/F that the output itself drives.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dtrtri

from evopem.arrays import Array
from evopem.config.settings import Hold, SearchSettings
from evopem.errors import InputError
from evopem.estimation.pem.covariance import coloured_covariance, pseudo_inverse_factor
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.search.memetic import discrete_recombination, memetic_search
from evopem.models.continuous import AT_ZERO, ContinuousModel, ContinuousRecord, phi_functions
from evopem.models.parameter_covariance import jacobian_of
from evopem.models.polynomial import Model, PolynomialModel, state_space_of
from evopem.models.states import states_of
from evopem.signals.recording import Recording

# Evaluations of the search, and of its descents and the last one.
EVALUATIONS, COARSE, FINE = 600, 15, 100
# Share of a column that is not along those before it, below which a Gram matrix loses its digits.
CLEAR = 1e-5
EDGE = 1e-6  # what a descent starts away from the limits
STABLE = 1.0 - 1e-9  # radius in z from which on a pole integrates or grows
# Poles times the sampling interval below which the coefficients in z of all models are much alike.
FAST_SAMPLING = 0.1


class Path(NamedTuple):
    """What is estimated of the path from one input."""

    coefficients: int  # of its numerator
    delay: float = 0.0  # samples
    has_free_delay: bool = False


class Fit(NamedTuple):
    """Errors of a point, with what their derivatives need."""

    columns: Array  # (N, c) what enters the output linearly
    weights: Array  # (N,)
    rows: Array  # (N, c) weighted columns
    factor: Array  # (c, r) of the pseudo-inverse of rows' rows
    coefficients: Array  # (c,)
    errors: Array  # (N,)

    @classmethod
    def of(cls, columns: Array, y: Array, weights: Array) -> Self:
        """Weighted least squares; a second pass for the digits that a Gram matrix loses."""
        rows, coefficients, errors = columns * weights[:, None], np.zeros(columns.shape[1]), y
        factor, _ = inverse_factor(rows)
        for _ in range(2):
            coefficients = coefficients + factor @ (factor.T @ (rows.T @ (errors * weights)))
            errors = y - columns @ coefficients
        return cls(columns, weights, rows, factor, coefficients, errors)

    def across(self, directions: Array) -> Array:
        """What of weighted directions, (N, k), is not along the rows."""
        directions = (directions.T * self.weights).T
        along = self.factor @ (self.factor.T @ (self.rows.T @ directions))
        return np.asarray(directions - self.rows @ along)


def gram_triangle(rows: Array) -> tuple[Array, bool]:
    """R of a QR decomposition, (n, n), and whether a Gram matrix was exact enough to give it."""
    gram = rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    triangle, fails = dpotrf(gram / scale / scale[:, None])
    if fails or np.diag(triangle).min(initial=1.0) < CLEAR:
        return np.asarray(np.linalg.qr(rows, mode="r")), False
    return triangle * scale, True


def inverse_factor(rows: Array) -> tuple[Array, Array]:
    """A factor F of the pseudo-inverse ``F F'`` of ``rows' rows``, and its null space."""
    triangle, is_regular = gram_triangle(rows)
    if is_regular:
        return np.asarray(dtrtri(triangle)[0]), np.zeros((len(triangle), 0))
    return pseudo_inverse_factor(triangle)


@dataclass(frozen=True, eq=False)
class ContinuousProblem:
    """Output error of n common poles; frequencies in ``unit`` (rad/s), delays in samples.

    A point holds the logarithms of the coefficients of sections ``s^2 + c s + d`` and ``s + d``,
    which are all stable denominators F, then the free delays.
    """

    data: Recording
    hold: Hold
    paths: tuple[Path, ...]
    start: Array
    unit: float
    recombine = staticmethod(discrete_recombination)

    @cached_property
    def n(self) -> int:
        """Number of poles."""
        return len(self.start) - sum(path.has_free_delay for path in self.paths)

    def denominator(self, point: NDArray) -> NDArray:
        """Coefficients of F behind the leading 1, (n,)."""
        values = np.exp(point[: self.n])
        sections = [np.r_[1.0, values[k : k + 2]] for k in range(0, self.n, 2)]
        return np.asarray(reduce(np.convolve, sections)[1:])

    def delays(self, point: NDArray) -> list[float]:
        """Of all inputs, in samples."""
        free = iter(point[self.n :])
        return [next(free) if path.has_free_delay else path.delay for path in self.paths]

    def _companion(self, point: Array) -> Array:
        """``x' = A x + e_1 u`` of 1/F: its states are ``s^(n-1) ... 1`` times its output."""
        return np.vstack([-self.denominator(point), np.eye(self.n)[:-1]])

    def projection(self, point: Array) -> Fit:
        """Errors of a point whose linear coefficients fit best."""
        A, y = self._companion(point), self.data.output * self._known
        columns = [
            self._states(A, place, delay)[:, self.n - path.coefficients :]
            for place, (path, delay) in enumerate(zip(self.paths, self.delays(point), strict=True))
        ]
        columns += [self._states(A, segment=k) for k in range(len(self._rows))]
        recordings = np.repeat(self.data.segment_recordings, [r.stop - r.start for r in self._rows])
        columns.append((recordings[:, None] == np.unique(recordings)).astype(float))
        return Fit.of(np.hstack(columns) * self._known[:, None], y, self._known)

    def jacobian(self, point: Array, fit: Fit) -> Array:
        """Derivatives of the errors by the entries of a point, its coefficients held, (N, k)."""
        A, n, left = self._companion(point), self.n, fit.coefficients
        by_coefficient, by_delay = np.zeros((self.data.samples, n)), []
        sources: list[tuple[int, int, int | None]]
        sources = [(path.coefficients, place, None) for place, path in enumerate(self.paths)]
        sources += [(n, 0, segment) for segment in range(len(self._rows))]
        delays = self.delays(point)
        for count, place, segment in sources:
            numerator, left = np.split(left, [count])
            both = scipy.linalg.block_diag(A, A)
            both[n, n - count : n] = numerator
            states = self._states(both, place, delays[place], segment)
            by_coefficient += states[:, n:]
            if segment is None and self.paths[place].has_free_delay:
                u = self.data.inputs[:, place]
                held = [_later(u[rows], int(delays[place]) + 1) for rows in self._rows]
                slope = states[:, :n] @ (both[n, :n] @ A) + both[n, 0] * np.concatenate(held)
                by_delay.append(self._step * slope)
        by_point = jacobian_of(lambda x: [self.denominator(x)], point)[:, :n]
        return np.column_stack([by_coefficient @ by_point, *by_delay])

    @cached_property
    def _rows(self) -> list[slice]:
        bounds = (*self.data.segment_starts, self.data.samples)
        return [slice(*pair) for pair in pairwise(bounds)]

    @cached_property
    def _known(self) -> Array:
        """1 at the samples that count: those that no input from before their segment acts on."""
        latest = max(path.delay + 3.0 * path.has_free_delay for path in self.paths)
        starts = [np.arange(rows.stop - rows.start) for rows in self._rows]
        return np.asarray(np.concatenate(starts) >= np.ceil(latest), dtype=float)

    @property
    def _step(self) -> float:
        return self.unit / self.data.sampling_rate

    def _states(
        self, A: Array, place: int = 0, delay: float = 0.0, segment: int | None = None
    ) -> Array:
        """States of ``x' = A x + e_1 u(t - delay)``, (N, n); an impulse begins a segment."""
        power, phi_1, phi_2 = phi_functions(A * self._step)
        states, first = np.zeros((self.data.samples, len(A))), np.eye(len(A))[0]
        if segment is not None:
            rows = self._rows[segment]
            states[rows] = states_of(power, states[rows], first)
            return states
        whole, u = int(delay), self.data.inputs[:, place]
        left = self._step * (1.0 - delay + whole)
        # Parts of a step that the inputs of this sample, the one before and the next one drive.
        drives = {whole: left * phi_functions(A * left)[1] @ first}
        drives[whole + 1] = self._step * phi_1 @ first - drives[whole]
        if self.hold == "first-order":
            drives = {
                whole: self._step * (phi_1 - phi_2) @ first,
                whole - 1: self._step * phi_2 @ first,
            }
        for rows in self._rows:
            drive = sum(np.outer(_later(u[rows], lag), part) for lag, part in drives.items())
            states[rows] = states_of(power, np.asarray(drive), None)
        return states

    @cached_property
    def _limits(self) -> Array:
        """Sections that a record can show, and delays that leave half of it, (2, k)."""
        longest = max(rows.stop - rows.start for rows in self._rows)
        low, high = np.log(np.array([0.1 / longest, np.pi]) / self._step)
        orders, delays = 1 + np.arange(self.n) % 2, np.ones(len(self.start) - self.n)
        ends = (low * orders, 0.0 * delays), (high * orders, self.data.samples / 2 * delays)
        return np.array([np.concatenate(end) for end in ends])

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Random sections, and delays around those of the start, (count, k)."""
        low, high = self._limits.copy()
        high[self.n :] = 2.0 * self.start[self.n :] + 3.0
        return generator.uniform(low, high, (count, len(low)))

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population with the start in it."""
        return np.vstack([self.start, self.random(count - 1, generator)]), 0

    def repair(self, points: Array) -> Array:
        """Points within the limits."""
        return np.clip(points, *self._limits + EDGE * np.array([[1.0], [-1.0]]))

    def values(self, points: Array) -> Array:
        """Mean squares of the errors, (M,)."""
        return np.array([np.mean(self.projection(point).errors ** 2) for point in points])

    def descend(self, points: Array, steps: int = COARSE, tolerance: float = 1e-4) -> Descent:
        """Descents that a generation refines."""
        given = self.repair(points), self.data.samples, steps, tolerance
        return descents(self.projection, self.jacobian, *given, bounds=self._limits)

    def polish(self, points: Array) -> Descent:
        """Descents to the last digits."""
        return self.descend(points, FINE, 1e-12)

    def matrices(self, values: NDArray) -> tuple[NDArray, ...]:
        """A, B, C, D in observer form and delays (s), of a point and the numerators behind it."""
        n, m = self.n, len(self.paths)
        point, left = np.split(values, [len(self.start)])
        powers = self.unit ** np.arange(1.0, n + 1.0)
        A = np.eye(n, k=1, dtype=complex)
        A[:, 0] -= self.denominator(point) * powers
        B = np.zeros((n, m), dtype=complex)
        for place, path in enumerate(self.paths):
            numerator, left = np.split(left, [path.coefficients])
            B[n - len(numerator) :, place] = numerator * powers[n - len(numerator) :]
        delays = np.array(self.delays(point), dtype=complex) / self.data.sampling_rate
        return A, B, np.eye(1, n, dtype=complex), np.zeros((1, m), dtype=complex), delays

    def model(self, point: Array) -> ContinuousModel:
        """The model of a point, with its covariance for errors of any colour."""
        fit, known = self.projection(point), self._known > 0.0
        lengths = [int(known[rows].sum()) for rows in self._rows]
        values = np.r_[point, fit.coefficients[: sum(path.coefficients for path in self.paths)]]
        A, B, C, D, delays = (part.real.copy() for part in self.matrices(values.astype(complex)))
        delays[delays * self.data.sampling_rate < EDGE] = 0.0  # at the limit
        jacobian = np.hstack([self.jacobian(point, fit), -fit.columns])[known]
        covariance = coloured_covariance(
            *(jacobian, fit.errors[known], len(values), "quadratic", True, lengths)
        )
        covariance = covariance and covariance.through(jacobian_of(self.matrices, values))
        about = self.data.sampling_rate, covariance, self.data.input_names, self.data.output_names
        return ContinuousModel(A, B, C, D, fit.coefficients[-1:], delays, self.hold, *about)


def descents(
    projection: Callable[[Array], Fit],
    jacobian: Callable[[Array, Fit], Array],
    starts: Array,
    samples: int,
    steps: int,
    tolerance: float,
    **options: Any,
) -> Descent:
    """Descents by SciPy's ``least_squares`` and Kaufman's (1975) derivatives.

    Values are mean squares of so many weighted errors.
    """
    last: list[Fit] = []  # slopes are asked for where the last errors were

    def errors(point: Array) -> Array:
        last[:] = [projection(point)]
        return last[0].errors * last[0].weights

    def slopes(point: Array) -> Array:
        return last[0].across(jacobian(point, last[0]))

    options |= {"ftol": tolerance, "xtol": tolerance, "gtol": None, "max_nfev": steps}
    ends = [scipy.optimize.least_squares(errors, start, slopes, **options) for start in starts]
    values = np.array([2.0 * end.cost / samples for end in ends])
    converged = np.array([end.status > 0 for end in ends])
    used = sum(end.nfev + end.njev for end in ends)
    return Descent(np.array([end.x for end in ends]), values, converged, used)


def _later(u: Array, lag: int) -> Array:
    """An input so many samples ago; before its first sample it was what it is there."""
    return u[np.clip(np.arange(len(u)) - lag, 0, len(u) - 1)]


def estimate_continuous(
    data: Recording,
    paths: Sequence[Path],
    poles: NDArray,
    hold: Hold = "zero-order",
    settings: SearchSettings | None = None,
) -> ContinuousModel:
    """Output error in s of one output, searched from poles (rad/s); unstable ones are mirrored."""
    sizes = np.maximum(np.abs(poles), 1e-4 * np.abs(poles).max())
    unit = float(np.exp(np.mean(np.log(sizes))))
    decays = np.maximum(np.abs(poles.real) / unit, 1e-4)
    real = np.sort(decays[poles.imag == 0.0])
    pairs = zip(decays, poles.imag / unit, strict=True)
    sections = [(2.0 * a, a**2 + b**2) for a, b in pairs if b > 0.0]
    sections += [(a + b, a * b) for a, b in zip(real[::2], real[1::2], strict=False)]
    start = np.log(np.r_[np.ravel(sections), real[len(real) // 2 * 2 :]])
    start = np.r_[start, [path.delay for path in paths if path.has_free_delay]]
    problem = ContinuousProblem(data, hold, tuple(paths), start, unit)
    settings = replace(settings or SearchSettings(), evaluations=EVALUATIONS)
    key = len(start), *(path.coefficients for path in paths)
    generator = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    return problem.model(memetic_search(problem, settings, generator).point)


def in_continuous_time(
    plant: Model, data: Recording | None, hold: Hold, settings: SearchSettings
) -> ContinuousRecord:
    """A plant converted, or estimated directly where that is ill-conditioned or does not exist.

    Not estimated are plants without samples, of several outputs, whose inputs have denominators of
    their own, or that are not stable.
    """
    converted, reason, rate = None, "sampling is fast against the dynamics", plant.sampling_rate
    try:
        converted = plant.to_continuous(hold)
    except InputError as error:
        reason = error.problem
    is_fast = converted and np.abs(converted.poles()).max() < FAST_SAMPLING * rate
    is_divided = isinstance(plant, PolynomialModel) and plant.inputs > 1 and any(plant.orders.nf)
    is_fit = plant.inputs > 0 and plant.outputs == 1 and np.all(np.abs(plant.poles()) < STABLE)
    if data is None or is_divided or not is_fit or (converted and not is_fast):
        return ContinuousRecord(converted, "conversion", "" if converted else reason)
    form, z = state_space_of(plant), plant.poles()
    counts = plant.orders.nb if isinstance(plant, PolynomialModel) else (form.order,) * form.inputs
    # Other poles than those have no counterpart; where none are left, one of a radian per sample.
    kept = z[(z.imag != 0.0) | (z.real > AT_ZERO)]
    poles = rate * (np.log(kept) if len(kept) else -np.ones(1))
    paths = []
    for lag, count in zip(form.delays, counts, strict=True):
        taps = count > len(z)
        free = hold == "zero-order" and (lag > 0 or taps)
        paths.append(Path(min(len(poles), count), lag + 0.5 * taps, free))
    direct = estimate_continuous(data, paths, poles, hold, settings)
    return ContinuousRecord(direct, "estimate", reason)
