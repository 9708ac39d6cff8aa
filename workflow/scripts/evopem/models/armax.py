"""The ARMAX model ``A(q) y = B(q) u + C(q) e`` (chapter eq. 2-7) as plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.modes import Mode, modes_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import powers_of_z, roots

Array = NDArray[np.float64]


@dataclass(frozen=True, order=True)
class Orders:
    """Orders of an ARMAX model.

    ``na`` and ``nc`` are degrees of A and C; ``nb`` is the **number** of B coefficients, the
    first of which stands at lag ``nk`` (the convention of Ljung 1999 and of MATLAB's ``armax``).

    Examples
    --------
    >>> orders = Orders(na=2, nb=1, nc=2, nk=3)
    >>> orders.parameters, orders.first_residual
    (5, 3)
    >>> Orders(2, 2, 2, 2).contains(orders)
    True
    """

    na: int
    nb: int
    nc: int
    nk: int

    def __post_init__(self) -> None:
        if self.na < 0 or self.nb < 1 or self.nc < 0 or self.nk < 0:
            raise ValueError(f"{self} needs na, nc, nk of at least 0 and nb of at least 1")

    @property
    def parameters(self) -> int:
        """Number of parameters n = na + nb + nc."""
        return self.na + self.nb + self.nc

    @property
    def first_residual(self) -> int:
        """Index of the first residual that has all its measured past."""
        return max(self.na, self.nb + self.nk - 1, self.nc)

    def contains(self, other: Orders) -> bool:
        """Whether every model of other orders is one of these, with zeros added."""
        return (
            other.na <= self.na
            and other.nc <= self.nc
            and other.nk >= self.nk
            and other.nk + other.nb <= self.nk + self.nb
        )

    def __str__(self) -> str:
        return f"ARMAX({self.na},{self.nb},{self.nc},{self.nk})"


@dataclass(frozen=True, eq=False)
class ArmaxModel:
    """A single-input single-output ARMAX model.

    Attributes
    ----------
    a : (na + 1,) array
        Coefficients of A, leading 1 included.
    b : (nb,) array
        Coefficients of B, the first at lag ``nk``.
    c : (nc + 1,) array
        Coefficients of C, leading 1 included.
    nk : int
        Delay in samples.
    sampling_rate : float
        Hz.
    noise_variance : float
        Variance of the innovations, in the square of the output's unit.
    covariance : ParameterCovariance, optional
        Covariance of ``[a_1.., b_0.., c_1..]``.

    Examples
    --------
    A resonance with a delay of two samples:

    >>> import numpy as np
    >>> from evopem import ArmaxModel
    >>> model = ArmaxModel(
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
    nk: int
    sampling_rate: float = 1.0
    noise_variance: float = float("nan")
    covariance: ParameterCovariance | None = None

    @property
    def orders(self) -> Orders:
        """Orders na, nb, nc and nk."""
        return Orders(len(self.a) - 1, len(self.b), len(self.c) - 1, self.nk)

    @property
    def parameters(self) -> Array:
        """Parameter vector ``[a_1.., b_0.., c_1..]``, (n,)."""
        return np.concatenate([self.a[1:], self.b, self.c[1:]])

    def parameter_standard_errors(self) -> Array | None:
        """Standard errors of :attr:`parameters`, (n,); None where the covariance is not known.

        Infinite for a parameter that the data do not determine.
        """
        if self.covariance is None:
            return None
        return self.covariance.standard_errors(np.eye(len(self.parameters)))

    @property
    def delayed_b(self) -> Array:
        """B with its nk leading zeros, as polynomials are written elsewhere; (nk + nb,)."""
        return np.concatenate([np.zeros(self.nk), self.b])

    def poles(self) -> NDArray[np.complex128]:
        """Roots of A in the z plane, (na,)."""
        return roots(self.a[1:])

    def zeros(self) -> NDArray[np.complex128]:
        """Finite zeros of G = B/A in the z plane, delay aside."""
        b = np.trim_zeros(self.b, "f")
        return roots(b[1:] / b[0]) if len(b) else np.empty(0, dtype=complex)

    def noise_zeros(self) -> NDArray[np.complex128]:
        """Roots of C in the z plane, (nc,)."""
        return roots(self.c[1:])

    def residuals(
        self,
        input: ArrayLike,  # noqa: A002
        output: ArrayLike,
        noise_state: ArrayLike | None = None,
        start: int | None = None,
    ) -> Array:
        """One-step prediction errors ``C e = A y - B u`` (chapter eq. 8 and 19), (N,).

        Parameters
        ----------
        input, output : (N,) arrays
        noise_state : (nc,) array, optional
            What the noise before the first residual adds to the first nc equation errors, as
            :func:`.initial_state.estimate_noise_state` returns it.  By default nothing:
            the transient then decays with the roots of C.
        start : int, optional
            First residual, by default ``orders.first_residual``, the first that has all its
            measured past.  Earlier residuals are NaN, since nothing predicts those samples.

        Examples
        --------
        The innovation of a record is recovered:

        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> output = model.simulate([1.0, 0.0, 1.0, 0.0])
        >>> output[3] += 0.1
        >>> model.residuals([1.0, 0.0, 1.0, 0.0], output)
        array([nan, 0. , 0. , 0.1])
        """
        from scipy.signal import lfilter

        u, y = _signals(input, output)
        t0 = self.orders.first_residual if start is None else start
        if len(y) <= t0:
            raise ValueError(f"{self.orders} needs more than {t0} samples, not {len(y)}")
        equation_error = lfilter(self.a, [1.0], y) - lfilter(self.delayed_b, [1.0], u)
        if noise_state is not None:
            state = np.asarray(noise_state, dtype=float)[: len(y) - t0]
            equation_error[t0 : t0 + len(state)] += state
        e = np.full(len(y), np.nan)
        e[t0:] = lfilter([1.0], self.c, equation_error[t0:])
        return e

    def predict(
        self,
        input: ArrayLike,  # noqa: A002
        output: ArrayLike,
        noise_state: ArrayLike | None = None,
    ) -> Array:
        """One-step-ahead prediction of the output from past measured output and input, (N,).

        NaN where the past is not known; ``noise_state`` as in :meth:`residuals`.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.predict([1.0, 0.0, 1.0], [0.0, 2.2, 1.2])  # 0.5 y(t-1) + 2 u(t-1)
        array([nan, 2. , 1.1])
        """
        _, y = _signals(input, output)
        predicted: Array = y - self.residuals(input, output, noise_state)
        return predicted

    def simulate(self, input: ArrayLike, initial: ArrayLike | None = None) -> Array:  # noqa: A002
        """Noise-free response ``G u``, (N,), that never sees a measured output.

        Parameters
        ----------
        input : (N,) array
        initial : (max(na, nk + nb - 1),) array, optional
            State before the first sample, as
            :func:`evopem.models.initial_state.estimate_initial_state` returns it.  Rest by default.

        Examples
        --------
        The impulse response:

        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
        >>> model.simulate([1.0, 0.0, 0.0, 0.0])
        array([0. , 2. , 1. , 0.5])
        """
        from scipy.signal import lfilter

        u = np.asarray(input, dtype=float)
        if initial is None:
            simulated: Array = lfilter(self.delayed_b, self.a, u)
        else:
            state = np.asarray(initial, dtype=float)
            simulated = lfilter(self.delayed_b, self.a, u, zi=state)[0]
        return simulated

    def frequency_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``G = B/A`` (chapter eq. 6) at frequencies in Hz; complex, of the same shape.

        Examples
        --------
        The gain at zero and at the Nyquist frequency:

        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(
        ...     np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1, sampling_rate=100.0
        ... )
        >>> np.abs(model.frequency_response([0.0, 50.0])).round(3)
        array([4.   , 1.333])
        """
        return _ratio(self.delayed_b, self.a, frequencies, self.sampling_rate)

    def noise_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``H = C/A`` (chapter eq. 7) at frequencies in Hz.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1, 0.4]), nk=1)
        >>> np.abs(model.noise_response([0.0, 0.5])).round(3)
        array([2.8, 0.4])
        """
        return _ratio(self.c, self.a, frequencies, self.sampling_rate)

    def modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the oscillating poles, by frequency.

        With standard errors where the model knows its covariance.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(
        ...     np.array([1, -1.2, 0.8]), np.array([0.5]), np.array([1.0]), nk=1, sampling_rate=50.0
        ... )
        >>> (mode,) = model.modes()
        >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 3)
        (6.71, 0.132)
        """
        na = len(self.a) - 1
        covariance = None if self.covariance is None else self.covariance.part(slice(na))
        return modes_of(self.a[1:], self.sampling_rate, covariance)

    def to_control(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``control.TransferFunction``; needs python-control."""
        import control

        return control.TransferFunction(
            *powers_of_z(self.delayed_b, self.a), 1.0 / self.sampling_rate
        )

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``scipy.signal.TransferFunction``.

        SciPy takes leading coefficients of B below 1e-14 for zero, and warns of it.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import ArmaxModel
        >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=2)
        >>> model.to_scipy()  # G = 2 q^-2 / (1 - 0.5 q^-1) = 2 / (z^2 - 0.5 z)
        TransferFunctionDiscrete(
        array([2.]),
        array([ 1. , -0.5,  0. ]),
        dt: 1.0
        )
        """
        from scipy.signal import TransferFunction

        return TransferFunction(*powers_of_z(self.delayed_b, self.a), dt=1.0 / self.sampling_rate)


def _signals(input: ArrayLike, output: ArrayLike) -> tuple[Array, Array]:  # noqa: A002
    u, y = np.asarray(input, dtype=float), np.asarray(output, dtype=float)
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    return u, y


def _ratio(
    numerator: Array, denominator: Array, frequencies: ArrayLike, rate: float
) -> NDArray[np.complex128]:
    z = np.exp(-2j * np.pi * np.asarray(frequencies, dtype=float) / rate)
    response = np.polynomial.polynomial.polyval(z, numerator) / np.polynomial.polynomial.polyval(
        z, denominator
    )
    return np.asarray(response, dtype=complex)
