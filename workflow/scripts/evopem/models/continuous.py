"""Continuous-time models: state space in s, transfer functions, and what process engineers read."""

from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import scipy  # whose parts load on first use: they take longer than a small estimate
from numpy.typing import ArrayLike, NDArray

from evopem.arrays import Array, Complex
from evopem.config.settings import Hold
from evopem.errors import InputError
from evopem.models.parameter_covariance import ParameterCovariance

TURN = 0.37  # angle of the first point of interpolation, so that none is a pole on an axis
TIED = 1e-12  # entries of A below this share of the largest one tie no states to each other
# Share of the largest coefficient, at the typical frequency of the poles, that is rounding.
ROUNDING = 1e-11
AT_ZERO = 1e-6  # poles in z so close to zero hold an input for a sample
LEVEL = 0.05  # level of the test of a relative degree


class Quantity(NamedTuple):
    """One number of a path from an input to an output, such as a time constant."""

    name: str
    value: float
    standard_error: float  # NaN where the covariance is not known
    unit: str


@dataclass(frozen=True, eq=False)
class TransferFunction:
    """``exp(-delay s) num(s) / den(s)``, powers of s descending, den monic, both of degree n."""

    num: Array  # (n + 1,) leading zeros where the relative degree asks for them
    den: Array  # (n + 1,)
    delay: float  # s
    covariance: ParameterCovariance | None = None  # of ``[num, den[1:]]``

    def standard_errors(self) -> Array | None:
        """Of ``[num, den[1:]]``, (2 n + 1,)."""
        if self.covariance is None:
            return None
        return self.covariance.standard_errors(np.eye(len(self.covariance)))

    def relative_degree_p(self, degree: int) -> float:
        """p-value of the hypothesis that the relative degree is so large, by Wald's test."""
        if self.covariance is None:
            return float("nan")
        leading = self.num[:degree]
        spread = self.covariance.of(np.eye(degree, len(self.covariance)))
        scale = np.sqrt(np.diag(spread))
        free = (leading != 0.0) | (scale != 0.0)  # others are zero by construction
        with np.errstate(all="ignore"):
            ratios, spread = leading / scale, spread / np.outer(scale, scale)
        ratios, spread = ratios[free], spread[np.ix_(free, free)]
        if not np.isfinite(spread).all():
            return float("nan")
        wald = ratios @ np.linalg.pinv(spread) @ ratios
        return float(scipy.special.chdtrc(max(len(ratios), 1), wald))

    @property
    def relative_degree(self) -> int:
        """The largest one that the data do not contradict, at a level of 5 %."""
        tested = (self.relative_degree_p(degree) > LEVEL for degree in range(1, len(self.num)))
        return sum(takewhile(bool, tested))

    def with_relative_degree(self, degree: int) -> Self:
        """The nearest one of a relative degree: ``x - P_xl P_ll^-1 l``, l the leading coefficients.

        Its efficient estimate, with its covariance.  ValueError where that is not known.
        """
        if self.covariance is None or not 0 <= degree < len(self.num):
            raise ValueError(f"a relative degree of {degree} needs a covariance, and as many poles")
        factor = self.covariance.factor
        towards = factor @ np.linalg.pinv(factor[:degree])
        values = np.r_[self.num, self.den[1:]] - towards @ self.num[:degree]
        left = factor - towards @ factor[:degree]
        values[:degree], left[:degree] = 0.0, 0.0
        num, den = np.split(values, [len(self.num)])
        covariance = ParameterCovariance(left, self.covariance.null_space)
        return replace(self, num=num, den=np.r_[1.0, den], covariance=covariance)

    def zeros(self) -> Complex:
        """Roots of num in s, but for those that a relative degree of 1 and more sends away."""
        return np.asarray(np.roots(self.num), dtype=complex)


@dataclass(frozen=True, eq=False)
class ContinuousModel:
    """``dx/dt = A x + B u(t - delays), y = level + C x + D u(t - delays)``, t in seconds.

    A model of nu inputs, n states and ny outputs.  Poles are known up to the Nyquist frequency:
    faster ones would leave the same samples.

    Examples
    --------
    >>> import evopem
    >>> sampled = evopem.PolynomialModel([1.0, -0.9], [0.2], nk=3, sampling_rate=10.0)
    >>> model = sampled.to_continuous()
    >>> [(name, round(value, 3), unit) for name, value, _, unit in model.quantities()]
    [('static gain', 2.0, ''), ('time constant', 0.949, 's'), ('delay', 0.2, 's')]
    >>> model.transfer_function().num.round(4), model.transfer_function().den.round(4)
    (array([0.    , 2.1072]), array([1.    , 1.0536]))
    """

    A: Array
    B: Array
    C: Array
    D: Array
    level: Array
    delays: Array  # (nu,) s
    hold: Hold
    sampling_rate: float  # Hz, of the samples that it was identified from
    covariance: ParameterCovariance | None = None  # of ``[A, B, C, D, delays]``, row by row
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    def poles(self) -> Complex:
        """Eigenvalues of A in rad/s, (n,)."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=complex)

    def frequency_response(self, frequencies: ArrayLike) -> Complex:
        """``C (sI - A)^-1 B + D`` with its delays at frequencies in Hz, (..., ny, nu)."""
        s = 2j * np.pi * np.asarray(frequencies, dtype=float)[..., None, None]
        solved = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray((self.C @ solved + self.D) * np.exp(-s * self.delays), dtype=complex)

    def path(self, output: int = 0, place: int = 0) -> Self:
        """The model from one input to one output, of the states that both are tied to."""
        tied = np.abs(self.A) > TIED * np.abs(self.A).max(initial=0.0)
        driven, seen = self.B[:, place] != 0.0, self.C[output] != 0.0
        for _ in self.A:
            driven, seen = driven | (tied @ driven), seen | (tied.T @ seen)
        kept = driven & seen

        def cut(A: Array, B: Array, C: Array, D: Array, delays: Array) -> list[Array]:
            row, column = C[output][None, kept], B[kept][:, [place]]
            return [A[kept][:, kept], column, row, D[[output]][:, [place]], delays[[place]]]

        parts = self.A, self.B, self.C, self.D, self.delays
        ends = np.cumsum([0, *(part.size for part in parts)])
        numbers = [
            k + np.arange(p.size).reshape(p.shape) for k, p in zip(ends, parts, strict=False)
        ]
        rows = np.concatenate([part.ravel() for part in cut(*numbers)])
        A, B, C, D, delays = cut(*parts)
        covariance = self.covariance and self.covariance.part(rows)
        names = self.input_names[place : place + 1], self.output_names[output : output + 1]
        about = delays, self.hold, self.sampling_rate, covariance, *names
        return type(self)(A, B, C, D, self.level[[output]], *about)

    def transfer_function(self, output: int = 0, place: int = 0) -> TransferFunction:
        """The path from one input to one output, with the covariance of its coefficients.

        Interpolated from ``det(sI - A)`` and its product with the response at points of a circle.
        """
        path, poles = self.path(output, place), np.abs(self.path(output, place).poles())
        n, inner = len(poles), poles[poles > 1e-12 * poles.max(initial=1e-300)]
        radius = float(np.exp(np.mean(np.log(inner)))) if len(inner) else 1.0
        angles = 2.0 * np.pi * np.arange(n + 1) / (n + 1) + TURN
        s = radius * np.exp(1j * angles)
        matrices = s[:, None, None] * np.eye(n) - path.A
        below, (response, slopes) = np.linalg.det(matrices), path._response(s)
        d_below = np.zeros_like(slopes)
        resolvents = np.linalg.inv(matrices).transpose(0, 2, 1)
        d_below[:, : n * n] = -below[:, None] * resolvents.reshape(n + 1, -1)
        d_above = d_below * response[:, None] + below[:, None] * slopes

        def coefficients(values: NDArray) -> Array:
            """Of the polynomial with these values, highest power first."""
            powers = np.exp(-1j * np.outer(np.arange(n, -1, -1), angles)) / (n + 1)
            scale = radius ** -np.arange(n, -1.0, -1.0)
            return np.asarray(((powers @ values).T * scale).T.real)

        num, den = coefficients(below * response), coefficients(below)
        covariance, sizes = path.covariance, [np.abs(num)]
        if covariance is not None:
            both = coefficients(d_above), coefficients(d_below)[1:]
            covariance = covariance.through(np.vstack(both))
            moves = covariance.factor, covariance.null_space
            sizes += [np.linalg.norm(part[: n + 1], axis=1) for part in moves]
        # What is zero by construction is rounding here, and moves as little.
        relative = np.array(sizes) * radius ** np.arange(n, -1.0, -1.0)
        rounded = np.all(ROUNDING * relative.max(axis=1) >= relative.T, axis=1).nonzero()[0]
        num[rounded] = 0.0
        if covariance is not None:
            covariance.factor[rounded], covariance.null_space[rounded] = 0.0, 0.0
        return TransferFunction(num, np.r_[1.0, den[1:]], float(path.delays[0]), covariance)

    def static_gain(self, output: int = 0, place: int = 0) -> tuple[float, float]:
        """Gain at rest with its standard error; infinite for an integrating path."""
        path = self.path(output, place)
        if np.linalg.matrix_rank(path.A) < len(path.A):
            return float("inf"), float("nan")
        response, slopes = path._response(np.zeros(1, dtype=complex))
        return float(response[0].real), path._error(slopes[0].real)

    def quantities(self, output: int = 0, place: int = 0) -> list[Quantity]:
        """A path in the words of process engineers, the slowest pole first, with standard errors.

        Static gain, time constants, natural frequencies with damping ratios, delay.
        """
        listed = [Quantity("static gain", *self.static_gain(output, place), "")]
        path = self.path(output, place)
        poles, left, right = scipy.linalg.eig(path.A, left=True, right=True)
        slopes = np.zeros(path.A.size + 2 * len(path.A) + 2, dtype=complex)
        for k in np.argsort(np.abs(poles), kind="stable"):
            pole, size = complex(poles[k]), float(abs(poles[k]))
            if pole.imag < 0.0 or size == 0.0:
                continue
            of_A = np.outer(left[:, k].conj(), right[:, k]) / (left[:, k].conj() @ right[:, k])
            slopes[: path.A.size] = of_A.ravel()
            d_size = (pole.conjugate() * slopes).real / size
            if pole.imag == 0.0:
                name = "time constant" if pole.real < 0.0 else "time constant of growth"
                listed.append(Quantity(name, 1.0 / size, path._error(d_size / size**2), "s"))
                continue
            d_ratio = pole.real * d_size / size**2 - slopes.real / size
            turn, error = 2.0 * np.pi, path._error(d_size / (2.0 * np.pi))
            listed.append(Quantity("natural frequency", size / turn, error, "Hz"))
            listed.append(Quantity("damping ratio", -pole.real / size, path._error(d_ratio), ""))
        of_delay = path._error(np.eye(len(slopes))[-1])
        return [*listed, Quantity("delay", float(path.delays[0]), of_delay, "s")]

    def _error(self, gradient: Array) -> float:
        if self.covariance is None:
            return float("nan")
        return float(self.covariance.standard_errors(gradient[None])[0])

    def _response(self, s: Complex) -> tuple[Complex, Complex]:
        """A path at (M,) points without its delay, and its derivatives, (M, entries)."""
        matrices = s[:, None, None] * np.eye(len(self.A)) - self.A
        after = np.linalg.solve(matrices.transpose(0, 2, 1), self.C.T.astype(complex))[:, :, 0]
        before = np.linalg.solve(matrices, self.B.astype(complex))[:, :, 0]
        by_A = (after[:, :, None] * before[:, None, :]).reshape(len(s), -1)
        ones = np.ones((len(s), 1))
        return before @ self.C[0] + self.D[0, 0], np.hstack([by_A, after, before, ones, 0 * ones])

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """A ``scipy.signal.StateSpace`` in continuous time, which has no :attr:`delays`."""
        return scipy.signal.StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self):  # type: ignore[no-untyped-def]
        """A ``control.StateSpace`` in s, which has no :attr:`delays`; needs python-control."""
        import control

        return control.StateSpace(self.A, self.B, self.C, self.D)

    def matlab_arguments(self) -> dict[str, Any]:
        """Arguments of MATLAB's ``idss(A,B,C,D,K,'Ts',0,'InputDelay',InputDelay)``, K of zeros, and
        of ``idtf(Numerator,Denominator,'IODelay',IODelay)``, cell arrays.
        """
        cells = np.empty((2, *self.D.shape), dtype=object)
        for at in np.ndindex(*self.D.shape):
            path = self.transfer_function(*at)
            cells[0][at], cells[1][at] = path.num[None], path.den[None]
        delays = np.broadcast_to(self.delays, self.D.shape)
        idtf = {"Numerator": cells[0], "Denominator": cells[1], "IODelay": delays}
        idss = {name: getattr(self, name) for name in "ABCD"}
        return idtf | idss | {"InputDelay": self.delays[:, None], "Level": self.level[:, None]}


@dataclass(frozen=True, eq=False)
class ContinuousRecord:
    """How a model in continuous time was found."""

    model: ContinuousModel | None
    method: Literal["conversion", "estimate"]  # of the sampled model, or directly in s
    reason: str  # why there is no conversion, or why it was not taken


def phi_functions(matrix: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """``exp(M)``, ``phi1 = sum M^k / (k+1)!`` and ``phi2 = sum M^k / (k+2)!`` of a square M."""
    n = len(matrix)
    raised = np.zeros((3 * n, 3 * n), dtype=matrix.dtype)
    raised[:n, :n], raised[: 2 * n, n:] = matrix, np.eye(2 * n)
    power = scipy.linalg.expm(raised)[:n]
    return power[:, :n], power[:, n : 2 * n], power[:, 2 * n :]


def continuous_of(
    parts: tuple[Array, ...],
    covariance: ParameterCovariance | None,
    sampling_rate: float,
    hold: Hold,
) -> tuple[list[Array], ParameterCovariance | None]:
    """The plant of A, B, C, D in continuous time, without states of noise alone behind its own.

    Each direction of the covariance is carried as the upper right block of ``[[M, dM], [0, M]]``,
    where a function of matrices has its derivative (Higham 2008, section 3.2).  Returns the four
    matrices and the covariance of their entries and of the delays.

    Raises
    ------
    InputError
        When no continuous-time model of the same order has these samples.
    """
    A, B, _, D = parts
    driven, n, nu = np.flatnonzero(np.any(B != 0.0, axis=1)), len(A), D.shape[1]
    last = int(driven[-1]) + 1 if len(driven) else n
    if not np.any(A[:last, last:]) and not np.any(A[last:, :last]):
        n = last
    plant, every = slice(n), slice(None)
    cuts = (plant, plant), (plant, every), (every, plant), (every, every)
    _check_continuous(A[cuts[0]], nu)
    ends = np.cumsum([part.size for part in parts])
    directions = np.zeros((int(ends[-1]), 1))
    if covariance is not None:
        # K and level follow, which the plant does not depend on.
        carried = np.hstack([covariance.factor, covariance.null_space])[: ends[-1]]
        directions = np.hstack([directions, carried])
    sizes = np.maximum(np.abs(directions).max(axis=0), 1e-300)
    derivatives = []
    for column in (directions / sizes).T:
        duals = [
            np.block([[part[cut], move.reshape(part.shape)[cut]], [0.0 * part[cut], part[cut]]])
            for part, move, cut in zip(parts, np.split(column, ends[:-1]), cuts, strict=True)
        ]
        halves = [
            np.hsplit(part[: len(part) // 2], 2)
            for part in _in_continuous_time(duals, 1.0 / sampling_rate, hold)
        ]
        derivatives.append(np.concatenate([*(move.ravel() for _, move in halves), np.zeros(nu)]))
    if covariance is not None:
        rank, moved = 1 + covariance.factor.shape[1], np.array(derivatives).T * sizes
        covariance = ParameterCovariance(moved[:, 1:rank], moved[:, rank:])
    return [value for value, _ in halves], covariance


def _check_continuous(dynamics: Array, inputs: int) -> None:
    """Refuse what no continuous-time model of the same order has."""
    poles = np.linalg.eigvals(dynamics)
    real = poles[(np.abs(poles.imag) <= 1e-9 * np.abs(poles)) & (poles.real <= 0.0)].real
    remedy = "estimate it in continuous time, `continuous_time: zero-order`, or with other orders"
    if not inputs:
        problem, remedy = "a model without input has no plant", "take its modes, which are in s"
    elif np.all(np.abs(poles) < AT_ZERO):
        problem = "the model has no pole but a response of finite length"
    elif np.any(np.abs(real) < AT_ZERO):
        problem = "the model has a pole at z = 0: its delay is no multiple of the sample"
    elif len(real):
        problem = f"the model has a real pole at z = {real[0]:.3g}, which no pole in s has"
    else:
        return
    raise InputError("to_continuous", problem, remedy)


def _in_continuous_time(parts: list[Array], step: float, hold: Hold) -> list[Array]:
    """A, B, C, D in s by the principal logarithm: the inverse of ``exp(Ah)``, ``h phi1(Ah) B``.
    With a first-order hold, of ``h phi1(Ah)^2 B`` and ``D + h C phi2(Ah) B``."""
    logarithm, (B, C, D) = np.real(scipy.linalg.logm(parts[0])), parts[1:]
    _, first, second = phi_functions(logarithm)
    if hold == "zero-order":
        return [logarithm / step, np.linalg.solve(first, B) / step, C, D]
    B = np.linalg.solve(first @ first, B) / step
    return [logarithm / step, B, C, D - step * C @ second @ B]
