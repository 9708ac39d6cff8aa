"""What a polynomial model does with signals, and its responses in time and frequency."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.polynomials import powers_of_z
from evopem.models.structures import Orders

if TYPE_CHECKING:
    from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# Samples from which on a prediction is computed by Fourier transforms.
LONG_HORIZON = 64


class PolynomialResponses:
    """The part of :class:`.PolynomialModel` that computes signals and responses."""

    A: Array
    B: tuple[Array, ...]
    C: Array
    D: Array
    F: tuple[Array, ...]
    nk: tuple[int, ...]
    sampling_rate: float
    level: float
    structure: str

    @property
    def orders(self) -> Orders:
        """Orders na, nb, nc, nd, nf and nk."""
        return Orders(
            self.structure,
            na=len(self.A) - 1,
            nb=tuple(map(len, self.B)),
            nc=len(self.C) - 1,
            nd=len(self.D) - 1,
            nf=tuple(len(f) - 1 for f in self.F),
            nk=self.nk,
        )

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.B)

    @property
    def has_input(self) -> bool:
        """Whether the model has an input."""
        return len(self.B) > 0

    @property
    def plant_denominator(self) -> Array:
        """``A F_1 ... F_m``, the common denominator of the plant G_i = B_i / (A F_i)."""
        return reduce(np.convolve, self.F, self.A)

    @property
    def noise_denominator(self) -> Array:
        """``A D``, the denominator of the noise filter H = C / (A D)."""
        return np.convolve(self.A, self.D)

    @property
    def output_level(self) -> float:
        """Mean of the output without input and noise, ``level / A(1)``."""
        return self.level / float(np.sum(self.A)) if self.level else 0.0

    def state_space(self) -> StateSpaceModel:
        """The same model in innovations form."""
        raise NotImplementedError

    def residuals(
        self,
        inputs: ArrayLike,
        output: ArrayLike,
        plant_state: ArrayLike | None = None,
        noise_state: ArrayLike | None = None,
        start: int | None = None,
    ) -> Array:
        """One-step prediction errors ``e = (D/C) (A y - sum (B_i/F_i) u_i - level)``, (N,).

        Parameters
        ----------
        inputs : (N,) or (N, m) array_like
        output : (N,) array_like
        plant_state : (nf_1 + ... + nf_m,) array, optional
            What the past adds to the first nf_i equations of ``F_i x_i = -B_i u_i``.  Nothing by
            default.
        noise_state : (max(nc, nd),) array, optional
            What the past adds to the first equations of ``C e = D v``.  Nothing by default.
        start : int, optional
            First residual, by default ``orders.first_residual``.  Earlier residuals are NaN.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=1)
        >>> model.residuals([1, 0, 0], [0, 2, 1.5])  # e(t) = y(t) - 0.5 y(t-1) - 2 u(t-1)
        array([nan, 0. , 0.5])
        """
        from scipy.signal import lfilter

        u, y = self._columns(inputs), np.asarray(output, dtype=float)
        if y.ndim != 1 or len(u) != len(y):
            raise ValueError(f"inputs and output do not match: {np.shape(inputs)} and {y.shape}")
        first = self.orders.first_residual if start is None else start
        if len(y) <= first:
            raise ValueError(f"the model needs more than {first} samples, not {len(y)}")
        ends = np.cumsum([len(f) - 1 for f in self.F])[:-1]
        states = [None] * self.inputs if plant_state is None else np.split(plant_state, ends)
        v = lfilter(self.A, [1.0], y)[first:] - self.level
        for i, (b, f, nk) in enumerate(zip(self.B, self.F, self.nk, strict=True)):
            from_input = -lfilter(_delayed(b, nk), [1.0], u[:, i])[first:]
            v = v + lfilter([1.0], f, _with_impulses(from_input, states[i]))
        by_d = _with_impulses(lfilter(self.D, [1.0], v), noise_state)
        e = np.full(len(y), np.nan)
        e[first:] = lfilter([1.0], self.C, by_d)
        return e

    def predict(
        self,
        inputs: ArrayLike,
        output: ArrayLike,
        horizon: int = 1,
        plant_state: ArrayLike | None = None,
        noise_state: ArrayLike | None = None,
    ) -> Array:
        """Prediction of the output from inputs and from outputs ``horizon`` samples ago, (N,).

        ``y_t`` less the innovations of the last ``horizon`` samples through the noise filter
        (Ljung 1999, eq. 3.29).  NaN where the past is not known; states as in :meth:`residuals`.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=1)
        >>> model.predict([1, 0, 0], [0, 2, 1.5])  # 0.5 y(t-1) + 2 u(t-1)
        array([nan, 2., 1.])
        """
        from scipy.signal import lfilter, oaconvolve

        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 sample, not {horizon}")
        y = np.asarray(output, dtype=float)
        e = self.residuals(inputs, output, plant_state, noise_state)
        first = int(np.isnan(e).sum())
        response = self.noise_impulse_response(horizon)
        predicted = np.full(len(y), np.nan)
        # Of long responses the product of spectra is faster than the sum.
        unknown = (
            lfilter(response, [1.0], e[first:])
            if horizon <= LONG_HORIZON
            else oaconvolve(e[first:], response)[: len(y) - first]
        )
        predicted[first:] = y[first:] - unknown
        return predicted

    def simulate(self, inputs: ArrayLike, initial: ArrayLike | None = None) -> Array:
        """Noise-free response to inputs, (N,), that never sees a measured output.

        Parameters
        ----------
        inputs : (N,) or (N, m) array_like
        initial : (state_dimension,) array, optional
            State before the first sample, in the transposed direct form of the plant with its
            common denominator, as
            :func:`evopem.models.polynomial_states.estimate_simulation_state` returns it.  Rest by
            default.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=1)
        >>> model.simulate([1, 0, 0, 0])
        array([0. , 2. , 1. , 0.5])
        """
        from scipy.signal import lfilter

        u = self._columns(inputs)
        simulated = np.zeros(len(u))
        for i, (b, f, nk) in enumerate(zip(self.B, self.F, self.nk, strict=True)):
            simulated += lfilter(_delayed(b, nk), np.convolve(self.A, f), u[:, i])
        if initial is not None:
            state = np.asarray(initial, dtype=float)
            length = max(self.state_dimension, len(self.plant_denominator) - 1)
            above = np.zeros(length + 1)
            state = np.concatenate([state, np.zeros(length - len(state))])
            simulated += lfilter(above, self.plant_denominator, np.zeros(len(u)), zi=state)[0]
        return simulated + self.output_level

    @property
    def state_dimension(self) -> int:
        """Length of the state of the plant with its common denominator."""
        common = len(self.plant_denominator)
        lengths = [
            nk + len(b) + common - len(self.A) - len(f) + 1
            for b, f, nk in zip(self.B, self.F, self.nk, strict=True)
        ]
        return max(common, *lengths, 1) - 1

    def frequency_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``G_i = B_i q^-nk_i / (A F_i)`` at frequencies in Hz, (..., 1, m).

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=1)
        >>> model.frequency_response([0.0, 0.5])[:, 0, 0].real.round(3)  # 2 / 0.5 and -2 / 1.5
        array([ 4.   , -1.333])
        """
        z = self._backward_shift(frequencies)
        columns = [
            _ratio(_delayed(b, nk), np.convolve(self.A, f), z)
            for b, f, nk in zip(self.B, self.F, self.nk, strict=True)
        ]
        if not columns:
            return np.empty((*z.shape, 1, 0), dtype=complex)
        return np.stack(columns, axis=-1)[..., None, :]

    def noise_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``H = C / (A D)`` at frequencies in Hz, (..., 1, 1).

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=1)
        >>> model.noise_response([0.0, 0.5])[:, 0, 0].real.round(3)  # 1 / 0.5 and 1 / 1.5
        array([2.   , 0.667])
        """
        z = self._backward_shift(frequencies)
        return _ratio(self.C, self.noise_denominator, z)[..., None, None]

    def impulse_response(self, samples: int, place: int = 0) -> Array:
        """Response of the plant to a unit impulse of an input at sample 0, (samples,)."""
        if not self.has_input:
            return np.zeros(samples)
        below = np.convolve(self.A, self.F[place])
        return _impulse_response(_delayed(self.B[place], self.nk[place]), below, samples)

    def step_response(self, samples: int, place: int = 0) -> Array:
        """Response of the plant to a unit step of an input at sample 0, (samples,)."""
        return np.cumsum(self.impulse_response(samples, place))

    def noise_impulse_response(self, samples: int) -> Array:
        """Response of the noise filter to a unit impulse at sample 0, (samples,)."""
        return _impulse_response(self.C, self.noise_denominator, samples)

    def to_control(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``control.TransferFunction``; needs python-control.

        Of a model without input, the noise filter ``H``.
        """
        import control

        above, below = zip(*self.transfer_functions, strict=True)
        return control.TransferFunction([list(above)], [list(below)], 1.0 / self.sampling_rate)

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """``G`` in discrete time: a ``TransferFunction`` of SciPy, a ``StateSpace`` of many inputs.

        Of a model without input, the noise filter ``H``.  SciPy takes leading coefficients of B
        below 1e-14 for zero, and warns of it.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> model = PolynomialModel(np.array([1, -0.5]), np.array([2.0]), nk=2)
        >>> model.to_scipy()  # G = 2 q^-2 / (1 - 0.5 q^-1) = 2 / (z^2 - 0.5 z)
        TransferFunctionDiscrete(
        array([2.]),
        array([ 1. , -0.5,  0. ]),
        dt: 1.0
        )
        """
        from scipy.signal import TransferFunction

        if self.inputs > 1:
            return self.state_space().to_scipy()
        return TransferFunction(*self.transfer_functions[0], dt=1.0 / self.sampling_rate)

    @property
    def transfer_functions(self) -> list[tuple[Array, Array]]:
        """Numerator and denominator of each G_i, or of H without input, in powers of z."""
        if not self.has_input:
            return [powers_of_z(self.C, self.noise_denominator)]
        return [
            powers_of_z(_delayed(b, nk), np.convolve(self.A, f))
            for b, f, nk in zip(self.B, self.F, self.nk, strict=True)
        ]

    def _columns(self, inputs: ArrayLike) -> Array:
        """The inputs as columns, (N, m)."""
        u = np.asarray(inputs, dtype=float)
        if u.ndim == 1:
            u = u[:, None]
        if self.has_input and u.shape[1] != self.inputs:
            raise ValueError(f"the model has {self.inputs} inputs, not {u.shape[1]}")
        return u

    def _backward_shift(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        angles = np.asarray(frequencies, dtype=float) / self.sampling_rate
        return np.asarray(np.exp(-2j * np.pi * angles), dtype=complex)


def _delayed(b: Array, nk: int) -> Array:
    return np.concatenate([np.zeros(nk), b])


def _ratio(above: Array, below: Array, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    polyval = np.polynomial.polynomial.polyval
    # At a pole on the unit circle the response is infinite.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(polyval(z, above) / polyval(z, below), dtype=complex)


def _impulse_response(above: Array, below: Array, samples: int) -> Array:
    from scipy.signal import lfilter

    impulse = np.zeros(samples)
    impulse[:1] = 1.0
    response: Array = lfilter(above, below, impulse)
    return response


def _with_impulses(signal: Array, impulses: ArrayLike | None) -> Array:
    """A signal with numbers added to its first samples."""
    if impulses is None:
        return signal
    added = np.asarray(impulses, dtype=float)[: len(signal)]
    changed = signal.copy()
    changed[: len(added)] += added
    return changed
