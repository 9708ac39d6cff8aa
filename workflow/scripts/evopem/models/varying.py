"""Models whose coefficients move: functional series ``sum_k w_k G_k(s)`` of a schedule s.

(Poulimenos & Fassois 2006; of a measured condition Sakellariou & Fassois 2016.)  The schedule is
the time, or what is measured beside the signals; at every moment its value freezes a polynomial
model with its covariance, and all that follows from one.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy  # whose parts load on first use
from numpy.polynomial.legendre import legvander
from numpy.typing import ArrayLike

from evopem.arrays import Array, Flags, Indices, columns
from evopem.errors import InputError
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import NORMAL_95, ParameterCovariance
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.polynomial_roots import roots_of_each

BasisKind = Literal["legendre", "cosine", "spline"]
KINDS: tuple[BasisKind, ...] = ("legendre", "cosine", "spline")
# Values of the schedule, evenly spaced, at which a model is frozen to judge its stability.
MOMENTS = 101


@dataclass(frozen=True)
class Basis:
    """Functions of a schedule within its range; the first one is 1."""

    kind: BasisKind
    dimension: int
    low: float
    high: float

    def at(self, schedule: ArrayLike) -> Array:
        """The functions, (N, dimension), at values (N,); InputError outside their range."""
        s, width = np.atleast_1d(np.asarray(schedule, dtype=float)), self.high - self.low
        if not np.all((s >= self.low - 1e-9 * width) & (s <= self.high + 1e-9 * width)):
            problem = f"is needed from {np.min(s):.6g} to {np.max(s):.6g}"
            remedy = f"stay within {self.low:.6g} and {self.high:.6g}, where it was estimated"
            raise InputError("the moving model", problem, remedy)
        x = np.clip((s - self.low) / (width or 1.0), 0.0, 1.0)
        if self.kind == "legendre":
            return np.asarray(legvander(2.0 * x - 1.0, self.dimension - 1))
        if self.kind == "cosine":
            return np.asarray(np.cos(np.pi * x[:, None] * np.arange(self.dimension)))
        degree = min(3, self.dimension - 1)
        inner = np.linspace(0.0, 1.0, self.dimension - degree + 1)
        knots = np.r_[np.zeros(degree), inner, np.ones(degree)]
        splines = scipy.interpolate.BSpline.design_matrix(x, knots, degree).toarray()
        return np.column_stack([np.ones(len(x)), splines[:, 1:]])  # they add to 1

    @property
    def moments(self) -> Array:
        """Values evenly over the range, (MOMENTS,)."""
        return np.linspace(self.low, self.high, MOMENTS)


def lagged(signal: Array, lags: range, bounds: Indices) -> Array:
    """A signal at some lags, (N, lags); 0 before its segment."""
    columns = np.zeros((len(signal), len(lags)))
    for first, stop in pairwise(bounds):
        for place, lag in enumerate(lags):
            columns[first + lag : stop, place] = signal[first : max(stop - lag, first)]
    return columns


def filtered(columns: Array, coefficients: Array, bounds: Indices) -> Array:
    """Solutions of ``x_t + sum_j c_j(t) x_(t-j) = columns_t``, (N, q), at rest before a segment.

    By substitution in bands, of coefficients (N, m).
    """
    samples, m = coefficients.shape
    bands = np.zeros((m + 1, samples))
    for lag in range(1, m + 1):
        bands[lag, : samples - lag] = coefficients[lag:, lag - 1]
        for first in bounds[1:-1]:
            bands[lag, max(first - lag, 0) : first] = 0.0
    return np.asarray(scipy.linalg.lapack.dtbtrs(bands, columns, uplo="L", diag="U")[0])


@dataclass(frozen=True)
class MovingMode:
    """A frozen mode along the schedule, at the values where it oscillates."""

    values: tuple[float, ...]
    modes: tuple[Mode, ...]

    @property
    def lowest(self) -> Mode:
        """Where its frequency is lowest."""
        return min(self.modes, key=lambda mode: mode.frequency_hz)

    @property
    def highest(self) -> Mode:
        """Where its frequency is highest."""
        return max(self.modes, key=lambda mode: mode.frequency_hz)

    @property
    def moves(self) -> bool:
        """Whether it goes further than the 95 % error of the difference can be.

        The errors of two moments are correlated, and that of a difference is their sum at most.
        """
        low, high = self.lowest, self.highest
        largest = low.frequency_se_hz + high.frequency_se_hz
        return high.frequency_hz - low.frequency_hz > NORMAL_95 * largest


@dataclass(frozen=True, eq=False)
class VaryingModel:
    """``A(s) y = sum_i B_i(s) u_i q^-nk_i + C(s) e + level(s)``; of output error C = A.

    Orders are those of AR, ARX, ARMA, ARMAX, or OE, whose inputs share their denominator.
    """

    orders: Orders
    basis: Basis
    weights: Array  # (n, dimension), rows of A or F, B_1 ... B_m, C, level
    log_variance: Array  # (dimension,) of the innovations, in the same basis
    sampling_rate: float
    covariance: ParameterCovariance | None = None  # of the weights, row by row
    schedule: str = "time"
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Structure, orders and basis."""
        orders = str(self.orders) if self.orders.nb or self.orders.nc else f"AR({self.orders.na})"
        kinds = {"legendre": "polynomials", "cosine": "cosines", "spline": "splines"}
        return f"{orders} along {self.basis.dimension} {kinds[self.basis.kind]}"

    @cached_property
    def rows(self) -> dict[str, slice]:
        """Rows of the weights of each polynomial: see :func:`rows_of`."""
        return rows_of(self.orders)

    def coefficients(self, schedule: ArrayLike) -> Array:
        """All coefficients at values of the schedule, (N, n)."""
        return np.asarray(self.basis.at(schedule) @ self.weights.T)

    def noise_variance(self, schedule: ArrayLike) -> Array:
        """Variance of the innovations, (N,)."""
        return np.asarray(np.exp(self.basis.at(schedule) @ self.log_variance))

    @cached_property
    def frozen_orders(self) -> Orders:
        """Orders of the frozen model: output error is ARMAX with C = A."""
        orders, n = self.orders, self.orders.poles
        nc = n if self._is_output_error else orders.nc
        return Orders(na=n, nb=orders.nb or 0, nc=nc, nk=orders.nk or 0)

    def frozen(self, value: float) -> PolynomialModel:
        """The model that stays as it is at one value of the schedule, with its covariance."""
        functions, rows = self.basis.at(value)[0], self.rows
        values = self.weights @ functions
        order = np.r_[rows["a"], rows["b"], rows["c"] if self.orders.nc else rows["a"]]
        order = order[: self.frozen_orders.parameters].astype(int)
        covariance = self.covariance
        if covariance is not None:
            covariance = covariance.through(np.kron(np.eye(len(values))[order], functions))
        return model_of(
            self.frozen_orders,
            values[order],
            sampling_rate=self.sampling_rate,
            level=float(values[-1]),
            noise_variance=float(np.exp(self.log_variance @ functions)),
            covariance=covariance,
            input_names=self.input_names,
            output_names=self.output_names,
        )

    def radii(self) -> Array:
        """Largest modulus of the frozen poles at each moment, (MOMENTS,)."""
        return root_radii(self.coefficients(self.basis.moments)[:, self.rows["a"]])

    def modes(self, values: ArrayLike) -> list[MovingMode]:
        """Frozen modes followed over values of the schedule; neighbours have the nearest poles."""
        paths: list[list[tuple[float, Mode]]] = []
        for value in np.atleast_1d(values).tolist():
            modes = self.frozen(value).modes()
            last = np.array([path[-1][1].pole for path in paths])
            distances = np.abs(np.subtract.outer(last, [mode.pole for mode in modes]))
            pairs = scipy.optimize.linear_sum_assignment(distances) if paths and modes else ((), ())
            for k, j in zip(*pairs, strict=True):
                paths[k].append((value, modes[j]))
            paths += [[(value, modes[j])] for j in range(len(modes)) if j not in pairs[1]]
        followed = [MovingMode(*zip(*path, strict=True)) for path in paths]
        return sorted(followed, key=lambda mode: mode.lowest.frequency_hz)

    def simulate(self, inputs: ArrayLike, schedule: ArrayLike) -> Array:
        """Noise-free response to (N, m) inputs from rest, (N,), at values (N,) of the schedule."""
        theta, rows = self.coefficients(schedule), self.rows
        bounds = np.array([0, len(theta)], dtype=np.intp)
        level = theta[:, rows["level"]]
        drive = self._forced(inputs, theta, bounds)[:, None]
        if self._is_output_error:
            return (filtered(drive, theta[:, rows["a"]], bounds) + level)[:, 0]
        return filtered(drive + level, theta[:, rows["a"]], bounds)[:, 0]

    def predict(
        self, inputs: ArrayLike, output: ArrayLike, schedule: ArrayLike, horizon: int = 1
    ) -> Array:
        """Prediction from inputs and from outputs ``horizon`` samples ago, (N,).

        The innovations of the last samples are taken for 0; NaN where the past is not known.
        """
        theta, rows, y = self.coefficients(schedule), self.rows, columns(output, 1, "output")[:, 0]
        bounds, first = np.array([0, len(y)], dtype=np.intp), first_residual(self.orders)
        a, level = theta[:, rows["a"]], theta[:, rows["level"]][:, 0]
        c = a if self._is_output_error else theta[:, rows["c"]]
        y = y - level if self._is_output_error else y
        drive = self._forced(inputs, theta, bounds) + (0.0 if self._is_output_error else level)
        past = lagged(y, range(1, a.shape[1] + 1), bounds)
        errors = y - drive + np.sum(a * past, axis=1)
        errors[:first] = 0.0
        e = filtered(errors[:, None], c, bounds)[:, 0]
        ahead: list[Array] = []  # predictions 1, 2, ... samples ahead
        for h in range(1, horizon + 1):
            value = drive.copy()
            for lag in range(1, a.shape[1] + 1):
                source = ahead[h - lag - 1] if lag < h else y
                value[lag:] -= a[lag:, lag - 1] * source[: len(y) - lag]
            for lag in range(h, c.shape[1] + 1):
                value[lag:] += c[lag:, lag - 1] * e[: len(y) - lag]
            ahead.append(value)
        predicted = ahead[-1] + (level if self._is_output_error else 0.0)
        predicted[: first + horizon - 1] = np.nan
        return predicted

    @property
    def _is_output_error(self) -> bool:
        return any(self.orders.nf)

    def _forced(self, inputs: ArrayLike, theta: Array, bounds: Indices) -> Array:
        u = columns(inputs, len(self.orders.nb) or None, "inputs")
        driving = delayed_inputs(self.orders, u, bounds)
        return np.asarray(np.sum(driving * theta[:, self.rows["b"]], axis=1))


def first_residual(orders: Orders) -> int:
    """First sample of a segment whose past inputs and outputs are measured."""
    return max(orders.first_residual, orders.poles)


def rows_of(orders: Orders) -> dict[str, slice]:
    """Rows of ``a`` (F of output error), ``b``, ``c``, ``level``; ``searched`` are C, or F."""
    ends = np.cumsum([0, orders.poles, sum(orders.nb), orders.nc, 1]).tolist()
    a, b, c, level = (slice(*pair) for pair in pairwise(ends))
    return {"a": a, "b": b, "c": c, "level": level, "searched": a if any(orders.nf) else c}


def all_free(orders: Orders, basis: Basis) -> Flags:
    """Every weight, (n, dimension)."""
    return np.ones((rows_of(orders)["level"].stop, basis.dimension), dtype=bool)


def delayed_inputs(orders: Orders, inputs: Array, bounds: Indices) -> Array:
    """The inputs that the coefficients of B_1 ... B_m multiply, (N, sum of nb)."""
    paths = zip(inputs.T, orders.nb, orders.nk, strict=True)
    parts = [lagged(u, range(nk, nk + nb), bounds) for u, nb, nk in paths]
    return np.hstack([np.zeros((len(inputs), 0)), *parts])


def root_radii(coefficients: Array) -> Array:
    """Largest modulus of the roots of monic polynomials, (M,), of (M, n) coefficients."""
    return np.asarray(np.abs(roots_of_each(coefficients)).max(axis=1, initial=0.0))
