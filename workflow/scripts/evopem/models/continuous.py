"""Continuous-time models: state space in s, transfer functions, and what process engineers read."""

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eig, expm
from scipy.special import chdtrc

from evopem.arrays import Array, Complex
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Hold = Literal["zero-order", "first-order"]
"""How the input runs between its samples: constant, or along a straight line."""

# Angle of the first point of interpolation, so that none is a pole on an axis.
TURN = 0.37
# Part of a pole in a path, relative to the largest one, below which the path has not this pole.
NO_PART = 1e-9
# Level of the test of a relative degree.
LEVEL = 0.05


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
        """p-value of the hypothesis that the relative degree is so large (Wald's test).

        NaN where the covariance is not known or not finite.
        """
        leading, spread = self.num[:degree], np.full((degree, degree), np.nan)
        if self.covariance is not None:
            spread = self.covariance.of(np.eye(degree, len(self.covariance)))
        free = ~((leading == 0.0) & (np.diag(spread) == 0.0))  # zero by construction
        if not np.isfinite(spread[np.ix_(free, free)]).all():
            return float("nan")
        scale = np.sqrt(np.diag(spread))[free]
        if not np.all(scale > 0.0):
            return 0.0
        ratios = leading[free] / scale
        inverse = np.linalg.pinv(spread[np.ix_(free, free)] / np.outer(scale, scale))
        return float(chdtrc(len(ratios), ratios @ inverse @ ratios)) if len(ratios) else 1.0

    @property
    def relative_degree(self) -> int:
        """The largest one that the data do not contradict, at a level of 5 %."""
        degree = 0
        while degree < len(self.num) - 1 and self.relative_degree_p(degree + 1) > LEVEL:
            degree += 1
        return degree

    def with_relative_degree(self, degree: int) -> Self:
        """The nearest one of a relative degree, in the metric of its covariance.

        Its efficient estimate: the others follow the leading coefficients of num to zero by
        ``x - P_xl P_ll^-1 l``.  ValueError where the covariance is not known.
        """
        if self.covariance is None:
            raise ValueError("a relative degree needs the covariance of the model")
        if not 0 <= degree < len(self.num):
            raise ValueError(f"the relative degree is 0 to {len(self.num) - 1}, not {degree}")
        factor, size = self.covariance.factor, len(self.num)
        # Singular where leading coefficients are zero by construction.
        towards = factor @ np.linalg.pinv(factor[:degree])
        values = np.concatenate([self.num, self.den[1:]]) - towards @ self.num[:degree]
        values[:degree] = 0.0
        left = factor - towards @ factor[:degree]
        left[:degree] = 0.0
        covariance = ParameterCovariance(left, self.covariance.null_space)
        den = np.concatenate([[1.0], values[size:]])
        return replace(self, num=values[:size], den=den, covariance=covariance)

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

    def zeros(self, output: int = 0, place: int = 0) -> Complex:
        """Zeros of one path in rad/s, without those that its relative degree sends away."""
        path = self.transfer_function(output, place)
        known = path.covariance is not None
        return (path.with_relative_degree(path.relative_degree) if known else path).zeros()

    def frequency_response(self, frequencies: ArrayLike) -> Complex:
        """``C (sI - A)^-1 B + D`` with its delays at frequencies in Hz, (..., ny, nu)."""
        s = 2j * np.pi * np.asarray(frequencies, dtype=float)[..., None, None]
        solved = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray((self.C @ solved + self.D) * np.exp(-s * self.delays), dtype=complex)

    def transfer_function(self, output: int = 0, place: int = 0) -> TransferFunction:
        """The path from one input to one output, with the covariance of its coefficients.

        Interpolated from ``det(sI - A)`` and its product with the response at points of a circle.
        """
        n = len(self.A)
        poles = np.abs(self.poles())
        inner = poles[poles > 1e-12 * poles.max(initial=1e-300)]
        radius = float(np.exp(np.mean(np.log(inner)))) if len(inner) else 1.0
        angles = 2.0 * np.pi * np.arange(n + 1) / (n + 1) + TURN
        s = radius * np.exp(1j * angles)
        below = np.linalg.det(s[:, None, None] * np.eye(n) - self.A)
        response, slopes = self._response(s, output, place)
        d_below = np.zeros_like(slopes)
        resolvents = np.linalg.inv(s[:, None, None] * np.eye(n) - self.A)
        d_below[:, : n * n] = -below[:, None] * resolvents.transpose(0, 2, 1).reshape(n + 1, -1)
        d_above = d_below * response[:, None] + below[:, None] * slopes

        def coefficients(values: NDArray) -> Array:
            """Of the polynomial with these values, highest power first."""
            powers = np.exp(-1j * np.outer(np.arange(n, -1, -1), angles)) / (n + 1)
            scale = radius ** -np.arange(n, -1.0, -1.0)
            return np.asarray(((powers @ values).T * scale).T.real)

        num, den = coefficients(below * response), coefficients(below)
        if self.D[output, place] == 0.0:
            num[0] = 0.0
        covariance = None
        if self.covariance is not None:
            jacobian = np.vstack([coefficients(d_above), coefficients(d_below)[1:]])
            if num[0] == 0.0:
                jacobian[0, : n * n + self.B.size + self.C.size] = 0.0
            covariance = ParameterCovariance(
                jacobian @ self.covariance.factor, jacobian @ self.covariance.null_space
            )
        den = np.concatenate([[1.0], den[1:]])
        return TransferFunction(num, den, float(self.delays[place]), covariance)

    def static_gain(self, output: int = 0, place: int = 0) -> tuple[float, float]:
        """Gain at rest with its standard error; infinite for an integrating path."""
        if np.linalg.matrix_rank(self.A) < len(self.A):
            return float("inf"), float("nan")
        response, slopes = self._response(np.zeros(1, dtype=complex), output, place)
        return float(response[0].real), float(self._errors(slopes.real)[0])

    def quantities(self, output: int = 0, place: int = 0) -> list[Quantity]:
        """A path in the words of process engineers, the slowest pole first, with standard errors.

        Static gain, time constants, natural frequencies with damping ratios, delay.
        """
        listed = [Quantity("static gain", *self.static_gain(output, place), "")]
        poles, left, right = eig(self.A, left=True, right=True)
        parts = np.abs((self.C[output] @ right) * (left.conj().T @ self.B[:, place]))
        for k in np.argsort(np.abs(poles), kind="stable"):
            pole = poles[k]
            if parts[k] <= NO_PART * parts.max() or pole.imag < 0.0 or pole == 0.0:
                continue
            slopes = np.zeros((1, self._entries), dtype=complex)
            product = left[:, k].conj() @ right[:, k]
            slopes[0, : self.A.size] = np.outer(left[:, k].conj(), right[:, k]).ravel() / product
            if pole.imag == 0.0:
                name = "time constant" if pole.real < 0.0 else "time constant of growth"
                value = float(1.0 / abs(pole.real))
                listed.append(Quantity(name, value, self._errors(slopes.real * value**2)[0], "s"))
                continue
            size = abs(pole)
            d_size = (pole.conj() * slopes).real / size
            d_ratio = -slopes.real / size + pole.real * d_size / size**2
            hertz = 2.0 * np.pi
            error, of_ratio = self._errors(np.vstack([d_size / hertz, d_ratio]))
            listed.append(Quantity("natural frequency", float(size) / hertz, error, "Hz"))
            listed.append(Quantity("damping ratio", float(-pole.real / size), of_ratio, ""))
        of_delay = np.zeros((1, self._entries))
        of_delay[0, self._entries - len(self.delays) + place] = 1.0
        delay = float(self.delays[place])
        return [*listed, Quantity("delay", delay, self._errors(of_delay)[0], "s")]

    @property
    def _entries(self) -> int:
        parts = (self.A, self.B, self.C, self.D, self.delays)
        return sum(part.size for part in parts)

    def _errors(self, jacobian: Array) -> Array:
        if self.covariance is None:
            return np.full(len(jacobian), np.nan)
        return self.covariance.standard_errors(jacobian)

    def _response(self, s: Complex, output: int, place: int) -> tuple[Complex, Complex]:
        """One path at (M,) points without its delay, and its derivatives, (M, entries)."""
        matrices = s[:, None, None] * np.eye(len(self.A)) - self.A
        row, column = self.C[output].astype(complex), self.B[:, place].astype(complex)
        after = np.linalg.solve(matrices.transpose(0, 2, 1), row[:, None])[:, :, 0]
        before = np.linalg.solve(matrices, column[:, None])[:, :, 0]
        slopes = [np.zeros((len(s), *part.shape), dtype=complex) for part in self._parts]
        slopes[0] += after[:, :, None] * before[:, None, :]
        slopes[1][:, :, place] = after
        slopes[2][:, output] = before
        slopes[3][:, output, place] = 1.0
        joined = np.concatenate([part.reshape(len(s), -1) for part in slopes], axis=1)
        return before @ row + self.D[output, place], joined

    @property
    def _parts(self) -> tuple[Array, ...]:
        return self.A, self.B, self.C, self.D, self.delays

    def sampled(self, sampling_rate: float | None = None) -> StateSpaceModel:
        """The model at samples of its held input, without covariance: exact for this hold.

        At another rate in Hz where one is given.  A delay that is no multiple of the sample takes
        a state of its own; ValueError for one with a first-order hold.
        """
        rate = sampling_rate or self.sampling_rate
        n, nu, ny = len(self.A), self.B.shape[1], len(self.C)
        whole = np.floor(self.delays * rate + 1e-9)
        parts = np.maximum(self.delays - whole / rate, 0.0)
        parts[parts * rate < 1e-6] = 0.0
        A, B, C, D = sampled_matrices(self.A, self.B, self.C, self.D, 1.0 / rate, self.hold)
        late = np.flatnonzero(parts)
        if len(late) and (self.hold == "first-order" or np.any(self.D[:, late])):
            raise ValueError("only strictly proper models with a zero-order hold take such a delay")
        extra = len(late)
        A = np.block([[A, np.zeros((n, extra))], [np.zeros((extra, n + extra))]])
        B = np.vstack([B, np.eye(nu)[late]])
        for k, place in enumerate(late):
            of_part = self.A, self.B[:, [place]], self.C, self.D[:, [place]]
            early = sampled_matrices(*of_part, 1.0 / rate - parts[place], "zero-order")[1]
            rest = sampled_matrices(*of_part, parts[place], "zero-order")[1]
            B[:n, place] = early[:, 0]
            A[:n, n + k] = (expm(self.A * (1.0 / rate - parts[place])) @ rest)[:, 0]
        return StateSpaceModel(
            *(A, B, np.hstack([C, np.zeros((ny, extra))]), D, np.zeros((n + extra, ny))),
            sampling_rate=rate,
            level=self.level,
            noise_covariance=np.zeros((ny, ny)),
            input_delays=tuple(int(delay) for delay in whole) if np.any(whole) else (),
            structure="ss_oe",
            input_names=self.input_names,
            output_names=self.output_names,
        )

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """A ``scipy.signal.StateSpace`` in continuous time, which has no :attr:`delays`."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self):  # type: ignore[no-untyped-def]
        """A ``control.StateSpace`` in s, which has no :attr:`delays`; needs python-control."""
        import control

        return control.StateSpace(self.A, self.B, self.C, self.D)

    def matlab_arguments(self) -> dict[str, Any]:
        """Arguments of MATLAB's ``idtf(Numerator, Denominator, 'IODelay', IODelay)``, cell arrays,
        and of ``idss(A,B,C,D,zeros(n,ny),'Ts',0,'InputDelay',InputDelay)``.
        """
        shape = self.D.shape
        cells = np.empty(shape, dtype=object), np.empty(shape, dtype=object)
        for place in np.ndindex(*shape):
            path = self.transfer_function(*place)
            cells[0][place], cells[1][place] = path.num[None, :], path.den[None, :]
        return {
            "Numerator": cells[0],
            "Denominator": cells[1],
            "IODelay": np.broadcast_to(self.delays, shape),
            **{name: getattr(self, name) for name in "ABCD"},
            "Ts": 0.0,
            "InputDelay": self.delays[:, None],
            "Level": self.level[:, None],
        }


def sampled_matrices(
    A: NDArray, B: NDArray, C: NDArray, D: NDArray, step: float, hold: Hold
) -> tuple[NDArray, ...]:
    """A, B, C, D at samples of a held input: ``exp(Ah)``, ``h phi1(Ah) B`` with a zero-order hold.

    With a first-order hold ``h phi1(Ah)^2 B``, and ``D + h C phi2(Ah) B``.
    """
    power, first, second = phi_functions(A * step)
    if hold == "zero-order":
        return power, step * first @ B, C, D
    return power, step * first @ first @ B, C, D + step * C @ second @ B


def phi_functions(matrix: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """``exp(M)``, ``phi1 = sum M^k / (k+1)!`` and ``phi2 = sum M^k / (k+2)!`` of a square M."""
    n = len(matrix)
    raised = np.zeros((3 * n, 3 * n), dtype=matrix.dtype)
    raised[:n, :n], raised[: 2 * n, n:] = matrix, np.eye(2 * n)
    power = expm(raised)[:n]
    return power[:, :n], power[:, n : 2 * n], power[:, 2 * n :]
