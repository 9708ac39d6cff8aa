"""The general polynomial model ``A y = (B/F) u q^-nk + (C/D) e + level`` as plain data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.modes import Mode, modes_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import powers_of_z, roots
from evopem.models.structures import PolynomialOrders

Array = NDArray[np.float64]


# Samples from which on a prediction is computed by Fourier transforms.
LONG_HORIZON = 64


@dataclass(frozen=True, eq=False)
class PolynomialModel:
    """A single-input single-output polynomial model (Ljung 1999, section 4.2).

    Attributes
    ----------
    a, c, d, f : (n + 1,) arrays
        Coefficients of A, C, D and F, leading 1 included.
    b : (nb,) array
        Coefficients of B, the first at lag ``nk``; empty for a model without input.
    nk : int
        Delay in samples.
    sampling_rate : float
        Hz.
    level : float
        Constant of the equation, in the unit of the output.
    noise_variance : float
        Variance of the innovations, in the square of the output's unit.
    covariance : ParameterCovariance, optional
        Covariance of ``[a_1.., b_0.., c_1.., d_1.., f_1..]``.
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`; by default the smallest one that has
        the model's orders.

    Examples
    --------
    An ARMAX model, a resonance with a delay of two samples:

    >>> import numpy as np
    >>> from evopem import PolynomialModel
    >>> model = PolynomialModel(
    ...     a=np.array([1.0, -1.2, 0.8]),
    ...     b=np.array([0.5, 0.1]),
    ...     c=np.array([1.0, 0.4]),
    ...     nk=2,
    ...     sampling_rate=50.0,
    ... )
    >>> print(model.orders)
    ARMAX(2,2,1,2)
    >>> model.poles().round(3)
    array([0.6+0.663j, 0.6-0.663j])
    >>> model.zeros(), model.noise_zeros()
    (array([-0.2+0.j]), array([-0.4+0.j]))
    """

    a: Array
    b: Array
    c: Array
    d: Array = field(default_factory=lambda: np.ones(1))
    f: Array = field(default_factory=lambda: np.ones(1))
    nk: int = 0
    sampling_rate: float = 1.0
    level: float = 0.0
    noise_variance: float = float("nan")
    covariance: ParameterCovariance | None = None
    structure: str = ""

    @property
    def orders(self) -> PolynomialOrders:
        """Orders na, nb, nc, nd, nf and nk."""
        return PolynomialOrders(
            na=len(self.a) - 1,
            nb=len(self.b),
            nc=len(self.c) - 1,
            nd=len(self.d) - 1,
            nf=len(self.f) - 1,
            nk=self.nk,
            structure=self.structure,
        )

    @property
    def parameters(self) -> Array:
        """Parameter vector ``[a_1.., b_0.., c_1.., d_1.., f_1..]``, (n,)."""
        return np.concatenate([self.a[1:], self.b, self.c[1:], self.d[1:], self.f[1:]])

    def parameter_standard_errors(self) -> Array | None:
        """Standard errors of :attr:`parameters`, (n,); None where the covariance is not known.

        Infinite for a parameter that the data do not determine.
        """
        if self.covariance is None:
            return None
        return self.covariance.standard_errors(np.eye(len(self.parameters)))

    def part(self, letter: str) -> slice:
        """Where the coefficients of one of a, b, c, d, f stand in :attr:`parameters`."""
        o = self.orders
        first = dict(zip("abcdf", np.cumsum([0, o.na, o.nb, o.nc, o.nd]).tolist(), strict=True))
        return slice(first[letter], first[letter] + getattr(o, f"n{letter}"))

    @property
    def has_input(self) -> bool:
        """Whether the model has an input."""
        return len(self.b) > 0

    @property
    def delayed_b(self) -> Array:
        """B with its nk leading zeros, (nk + nb,); one zero for a model without input."""
        return np.concatenate([np.zeros(self.nk), self.b]) if len(self.b) else np.zeros(1)

    @property
    def plant_denominator(self) -> Array:
        """``A F``, the denominator of the plant G = B / (A F)."""
        return np.convolve(self.a, self.f)

    @property
    def noise_denominator(self) -> Array:
        """``A D``, the denominator of the noise filter H = C / (A D)."""
        return np.convolve(self.a, self.d)

    @property
    def output_level(self) -> float:
        """Mean of the output without input and noise, ``level / A(1)``."""
        return self.level / float(np.sum(self.a)) if self.level else 0.0

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the plant: roots of A and of F in the z plane, (na + nf,)."""
        return np.concatenate([roots(self.a[1:]), roots(self.f[1:])])

    def zeros(self) -> NDArray[np.complex128]:
        """Finite zeros of the plant in the z plane, delay aside."""
        b = np.trim_zeros(self.b, "f")
        return roots(b[1:] / b[0]) if len(b) else np.empty(0, dtype=complex)

    def noise_poles(self) -> NDArray[np.complex128]:
        """Poles of the noise filter: roots of A and of D in the z plane, (na + nd,)."""
        return np.concatenate([roots(self.a[1:]), roots(self.d[1:])])

    def noise_zeros(self) -> NDArray[np.complex128]:
        """Zeros of the noise filter: roots of C in the z plane, (nc,)."""
        return roots(self.c[1:])

    def residuals(
        self,
        input: ArrayLike,  # noqa: A002 - the field's word
        output: ArrayLike,
        plant_state: ArrayLike | None = None,
        noise_state: ArrayLike | None = None,
        start: int | None = None,
    ) -> Array:
        """One-step prediction errors ``e = (D/C) (A y - (B/F) u - level)``, (N,).

        Parameters
        ----------
        input, output : (N,) arrays
        plant_state : (nf,) array, optional
            What the past adds to the first nf equations of ``F x = -B u``.  Nothing by default.
        noise_state : (max(nc, nd),) array, optional
            What the past adds to the first equations of ``C e = D v``.  Nothing by default.
        start : int, optional
            First residual, by default ``orders.first_residual``.  Earlier residuals are NaN.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.residuals([1, 0, 0], [0, 2, 1.5])  # e(t) = y(t) - 0.5 y(t-1) - 2 u(t-1)
        array([nan, 0. , 0.5])
        """
        from scipy.signal import lfilter

        u, y = _signals(input, output)
        first = self.orders.first_residual if start is None else start
        if len(y) <= first:
            raise ValueError(f"the model needs more than {first} samples, not {len(y)}")
        from_input = -lfilter(self.delayed_b, [1.0], u)[first:]
        x = lfilter([1.0], self.f, _with_impulses(from_input, plant_state))
        v = lfilter(self.a, [1.0], y)[first:] + x - self.level
        by_d = _with_impulses(lfilter(self.d, [1.0], v), noise_state)
        e = np.full(len(y), np.nan)
        e[first:] = lfilter([1.0], self.c, by_d)
        return e

    def predict(
        self,
        input: ArrayLike,  # noqa: A002
        output: ArrayLike,
        horizon: int = 1,
        plant_state: ArrayLike | None = None,
        noise_state: ArrayLike | None = None,
    ) -> Array:
        """Prediction of the output from inputs and from outputs ``horizon`` samples ago, (N,).

        ``y_t`` less the innovations of the last ``horizon`` samples through the noise filter
        (Ljung 1999, eq. 3.29).  NaN where the past is not known; states as in :meth:`residuals`.

        Parameters
        ----------
        input, output : (N,) arrays
        horizon : int
            Samples, at least 1.
        plant_state, noise_state : arrays, optional

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.predict([1, 0, 0], [0, 2, 1.5])  # 0.5 y(t-1) + 2 u(t-1)
        array([nan, 2., 1.])
        """
        from scipy.signal import lfilter, oaconvolve

        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 sample, not {horizon}")
        _, y = _signals(input, output)
        e = self.residuals(input, output, plant_state, noise_state)
        first = int(np.isnan(e).sum())
        impulse = np.zeros(horizon)
        impulse[0] = 1.0
        response = lfilter(self.c, self.noise_denominator, impulse)
        predicted = np.full(len(y), np.nan)
        # Of long responses the product of spectra is faster than the sum.
        unknown = (
            lfilter(response, [1.0], e[first:])
            if horizon <= LONG_HORIZON
            else oaconvolve(e[first:], response)[: len(y) - first]
        )
        predicted[first:] = y[first:] - unknown
        return predicted

    def simulate(self, input: ArrayLike, initial: ArrayLike | None = None) -> Array:  # noqa: A002
        """Noise-free response to an input, (N,), that never sees a measured output.

        Parameters
        ----------
        input : (N,) array
        initial : (state_dimension,) array, optional
            State before the first sample, in the transposed direct form of B / (A F), as
            :func:`evopem.models.polynomial_states.estimate_simulation_state` returns it.  Rest by
            default.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.simulate([1, 0, 0, 0])
        array([0. , 2. , 1. , 0.5])
        """
        from scipy.signal import lfilter

        u = np.asarray(input, dtype=float)
        state = np.zeros(self.state_dimension)
        if initial is not None:
            state = np.asarray(initial, dtype=float)
        simulated: Array = lfilter(self.delayed_b, self.plant_denominator, u, zi=state)[0]
        return simulated + self.output_level

    @property
    def state_dimension(self) -> int:
        """Length of the state of the plant: ``max(na + nf, nk + nb - 1)``."""
        return max(len(self.plant_denominator), len(self.delayed_b)) - 1

    def frequency_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``G = B / (A F)`` at frequencies in Hz; complex, of the same shape.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.frequency_response([0.0, 0.5]).real.round(3)  # 2 / 0.5 and -2 / 1.5
        array([ 4.   , -1.333])
        """
        return self._ratio(self.delayed_b, self.plant_denominator, frequencies)

    def noise_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``H = C / (A D)`` at frequencies in Hz; complex, of the same shape.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.noise_response([0.0, 0.5]).real.round(3)  # 1 / 0.5 and 1 / 1.5
        array([2.   , 0.667])
        """
        return self._ratio(self.c, self.noise_denominator, frequencies)

    def impulse_response(self, samples: int) -> Array:
        """Response of the plant to a unit impulse at sample 0, (samples,)."""
        from scipy.signal import lfilter

        impulse = np.zeros(samples)
        impulse[:1] = 1.0
        response: Array = lfilter(self.delayed_b, self.plant_denominator, impulse)
        return response

    def step_response(self, samples: int) -> Array:
        """Response of the plant to a unit step at sample 0, (samples,)."""
        return np.cumsum(self.impulse_response(samples))

    def noise_impulse_response(self, samples: int) -> Array:
        """Response of the noise filter to a unit impulse at sample 0, (samples,)."""
        from scipy.signal import lfilter

        impulse = np.zeros(samples)
        impulse[:1] = 1.0
        response: Array = lfilter(self.c, self.noise_denominator, impulse)
        return response

    def modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the plant's oscillating poles, by frequency.

        With standard errors where the model knows its covariance.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> one = np.ones(1)
        >>> model = PolynomialModel(
        ...     a=one, b=one, c=one, f=np.array([1, -1.2, 0.8]), nk=1, sampling_rate=50.0
        ... )
        >>> (mode,) = model.modes()
        >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 3)
        (6.71, 0.132)
        """
        return _by_frequency([*self.modes_of_polynomial("a"), *self.modes_of_polynomial("f")])

    def noise_modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the noise filter's oscillating poles."""
        return _by_frequency([*self.modes_of_polynomial("a"), *self.modes_of_polynomial("d")])

    def modes_of_polynomial(self, letter: str) -> list[Mode]:
        """Modes of one of the polynomials a, d and f, by frequency."""
        known = self.covariance
        covariance = None if known is None else known.part(self.part(letter))
        return modes_of(getattr(self, letter)[1:], self.sampling_rate, covariance)

    def _ratio(
        self, numerator: Array, denominator: Array, frequencies: ArrayLike
    ) -> NDArray[np.complex128]:
        z = np.exp(-2j * np.pi * np.asarray(frequencies, dtype=float) / self.sampling_rate)
        polyval = np.polynomial.polynomial.polyval
        # At a pole on the unit circle the response is infinite.
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(polyval(z, numerator) / polyval(z, denominator), dtype=complex)

    def to_control(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``control.TransferFunction``; needs python-control.

        Of a model without input, the noise filter ``H``.
        """
        import control

        return control.TransferFunction(*self.transfer_function, 1.0 / self.sampling_rate)

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``scipy.signal.TransferFunction``.

        Of a model without input, the noise filter ``H``.  SciPy takes leading coefficients of B
        below 1e-14 for zero, and warns of it.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=2)
        >>> model.to_scipy()  # G = 2 q^-2 / (1 - 0.5 q^-1) = 2 / (z^2 - 0.5 z)
        TransferFunctionDiscrete(
        array([2.]),
        array([ 1. , -0.5,  0. ]),
        dt: 1.0
        )
        """
        from scipy.signal import TransferFunction

        return TransferFunction(*self.transfer_function, dt=1.0 / self.sampling_rate)

    @property
    def transfer_function(self) -> tuple[Array, Array]:
        """Numerator and denominator of G, or of H without an input, in descending powers of z."""
        if self.has_input:
            return powers_of_z(self.delayed_b, self.plant_denominator)
        return powers_of_z(self.c, self.noise_denominator)


def _by_frequency(modes: list[Mode]) -> list[Mode]:
    return sorted(modes, key=lambda mode: mode.frequency_hz)


def _signals(input: ArrayLike, output: ArrayLike) -> tuple[Array, Array]:  # noqa: A002
    u, y = np.asarray(input, dtype=float), np.asarray(output, dtype=float)
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    return u, y


def _with_impulses(signal: Array, impulses: ArrayLike | None) -> Array:
    """A signal with numbers added to its first samples."""
    if impulses is None:
        return signal
    added = np.asarray(impulses, dtype=float)[: len(signal)]
    changed = signal.copy()
    changed[: len(added)] += added
    return changed
