"""The polynomial model ``A y = sum_i (B_i/F_i) u_i q^-nk_i + (C/D) e + level`` as plain data."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike, NDArray

from evopem.arrays import Array, Complex, columns
from evopem.config.settings import Hold
from evopem.files.atomic import atomic_write
from evopem.models.continuous import ContinuousModel, ContinuousRecord
from evopem.models.conversions import block_sizes, has_own_noise, innovations_form
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.models.polynomial_form import Polynomials, impulse_response
from evopem.models.polynomial_roots import on_circle, powers_of_z, roots
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

LONG_HORIZON = 64  # samples from which on a prediction is computed by Fourier transforms


@dataclass(frozen=True, eq=False, init=False)
class PolynomialModel(Polynomials):
    """A polynomial model with any number of inputs and one output (Ljung 1999, section 4.2).

    Attributes
    ----------
    A, C, D : (n + 1,) arrays
        Coefficients, leading 1 included.
    B : tuple of (nb_i,) arrays
        One for each input, the first coefficient at lag nk_i.  An array stands for one input, an
        empty one for none.
    F : tuple of (nf_i + 1,) arrays
        One for each input, leading 1 included; an array for all inputs, by default 1.
    nk : tuple of int
        Delays in samples; a number for all inputs.
    sampling_rate : float
        Hz.
    level : float
        Constant of the equation, in the unit of the output.
    noise_variance : float
        Variance of the innovations, in the square of the output's unit.
    covariance : ParameterCovariance, optional
        Covariance of :attr:`parameters`.
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`; by default the smallest one that has
        the model's orders.
    input_names, output_names : tuple of str
        Empty where the channels have no names.

    Examples
    --------
    An ARMAX model, a resonance with a delay of two samples:

    >>> import numpy as np
    >>> from evopem import PolynomialModel
    >>> model = PolynomialModel(
    ...     A=np.array([1.0, -1.2, 0.8]),
    ...     B=np.array([0.5, 0.1]),
    ...     C=np.array([1.0, 0.4]),
    ...     nk=2,
    ...     sampling_rate=50.0,
    ... )
    >>> print(model.orders)
    ARMAX(2,2,1,2)
    >>> model.poles().round(3)
    array([0.6+0.663j, 0.6-0.663j])
    >>> model.zeros(), model.noise_zeros()
    (array([-0.2+0.j]), array([-0.4+0.j]))
    >>> (mode,) = model.modes()
    >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 3)
    (6.71, 0.132)
    >>> model.frequency_response([0.0])[0, 0].real, model.noise_response([0.0])[0, 0].real.round(3)
    (array([1.]), array([2.333]))
    >>> u, y = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.6, 0.7]
    >>> model.simulate(u)
    array([0. , 0. , 0.5, 0.7])
    >>> model.predict(u, y).round(3), model.residuals(u, y).round(3)  # from the fourth sample on
    (array([ nan,  nan,  nan, 0.82]), array([  nan,   nan,   nan, -0.12]))
    >>> model.to_scipy().den
    array([ 1. , -1.2,  0.8,  0. ])

    An output-error model with two inputs:

    >>> one = np.ones(1)
    >>> model = PolynomialModel(one, ([2.0], [1.0]), F=([1.0, -0.5], one), nk=(1, 0))
    >>> model.simulate([[1.0, 0.0], [0.0, 0.0], [0.0, 3.0]])
    array([0., 2., 4.])
    >>> model.frequency_response([0.0]).real
    array([[[4., 1.]]])
    """

    def with_parameters(self, parameters: Array, **changes: Any) -> PolynomialModel:
        """The model with other coefficients, and other attributes."""
        names = ("sampling_rate", "level", "noise_variance", "covariance")
        beside = {name: getattr(self, name) for name in (*names, "input_names", "output_names")}
        return model_of(self.orders, parameters, **(beside | changes))

    def scaled(self, of_inputs: Array, of_outputs: Array) -> PolynomialModel:
        """The model of signals so many times as large, (m,) and (1,); without covariance."""
        scale = float(of_outputs[0])
        return replace(
            self,
            B=tuple(b * scale / of_input for b, of_input in zip(self.B, of_inputs, strict=False)),
            level=self.level * scale,
            noise_variance=self.noise_variance * scale**2,
            covariance=None,
        )

    def modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the plant's oscillating poles, by frequency.

        With standard errors where the model knows its covariance, and with participations of the
        inputs, each delayed by all but one of its nk samples, and of the innovations.
        """
        return self._modes_but([self.D])

    def noise_modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the noise filter's oscillating poles."""
        return self._modes_but(self.F)

    def _modes_but(self, left_out: Sequence[Array]) -> list[Mode]:
        """The modes without those of some polynomials."""
        modes = self.state_space().modes()
        for pole in np.concatenate([np.empty(0), *(roots(p[1:]) for p in left_out)]):
            if pole.imag > 0.0:
                modes.remove(min(modes, key=lambda mode: abs(mode.pole - pole)))
        return modes

    def plant(self) -> PolynomialModel:
        """The model without noise poles of its own: those of D, or C where there is no A."""
        orders, covariance = self.orders, self.covariance
        if not has_own_noise(orders):
            return self
        if covariance is not None:
            noise = np.r_[orders.part("c"), orders.part("d")]
            covariance = covariance.part(np.delete(np.arange(len(covariance)), noise))
        unit = np.ones(1)
        return replace(self, C=unit, D=unit, covariance=covariance)

    def state_space(self) -> StateSpaceModel:
        """The same model in innovations form, states of the plant first, with its covariance."""
        return self._state_space

    @cached_property
    def _state_space(self) -> StateSpaceModel:
        return innovations_form(
            self.orders,
            self.parameters,
            self.level,
            self.covariance,
            sampling_rate=self.sampling_rate,
            noise_covariance=np.array([[self.noise_variance]]),
            input_names=self.input_names,
            output_names=self.output_names,
        )

    @property
    def plant_states(self) -> int:
        """States of :meth:`state_space` that belong to the plant; those of the noise follow."""
        return sum(block_sizes(self.orders)[:-1])

    def to_continuous(self, hold: Hold = "zero-order") -> ContinuousModel:
        """The plant in s, its input held between samples, with its covariance.

        InputError where no continuous-time model of the same order has these samples.
        """
        if hold == "zero-order":
            return self.plant().state_space().to_continuous()
        now = replace(self.plant(), nk=(0,) * self.inputs)
        return now.state_space().to_continuous(hold, self.nk)

    def matlab_arguments(self) -> dict[str, ArrayLike]:
        """Arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)``, and a level.

        B and F of several inputs are cell arrays, and empty without an input, as ``idpoly`` takes
        them for a time series.  ``Level``, which ``idpoly`` does not have, stands beside them.
        """
        return {
            "A": self.A[None, :],
            "B": _cells([self.delayed_b(place) for place in range(self.inputs)]),
            "C": self.C[None, :],
            "D": self.D[None, :],
            "F": _cells(self.F),
            "NoiseVariance": self.noise_variance,
            "Ts": 1.0 / self.sampling_rate,
            "Level": self.level,
        }

    def predict(self, inputs: ArrayLike, output: ArrayLike, horizon: int = 1) -> Array:
        """Prediction of the output from inputs and from outputs ``horizon`` samples ago, (N,).

        ``y_t`` less the innovations of the last ``horizon`` samples through the noise filter
        (Ljung 1999, eq. 3.29), from rest; NaN where the past is not known.
        """
        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 sample, not {horizon}")
        y = columns(output, 1, "output")[:, 0]
        e = self.residuals(inputs, y)
        first = int(np.isnan(e).sum())
        response = self.noise_impulse_response(horizon)[:, 0, 0]
        predicted = np.full(len(y), np.nan)
        # Of long responses the product of spectra is faster than the sum.
        unknown = (
            scipy.signal.lfilter(response, [1.0], e[first:])
            if horizon <= LONG_HORIZON
            else scipy.signal.oaconvolve(e[first:], response)[: len(y) - first]
        )
        predicted[first:] = y[first:] - unknown
        return predicted

    def simulate(self, inputs: ArrayLike) -> Array:
        """Noise-free response to (N,) or (N, m) inputs from rest, (N,).

        From other initial states: :meth:`.StateSpaceModel.simulate` of :meth:`state_space`.
        """
        u = self._inputs(inputs)
        simulated = np.full(len(u), self.output_level)
        for i in range(self.inputs):
            simulated += scipy.signal.lfilter(*self._path(i), u[:, i])
        return simulated

    def frequency_response(self, frequencies: ArrayLike) -> Complex:
        """``G_i = B_i q^-nk_i / (A F_i)`` at frequencies in Hz, (..., 1, m)."""
        z = on_circle(frequencies, self.sampling_rate).conj()
        columns = [_ratio(*self._path(place), z)[..., None] for place in range(self.inputs)]
        return np.concatenate([np.empty((*z.shape, 0), complex), *columns], axis=-1)[..., None, :]

    def noise_response(self, frequencies: ArrayLike) -> Complex:
        """``H = C / (A D)`` at frequencies in Hz, (..., 1, 1)."""
        z = on_circle(frequencies, self.sampling_rate).conj()
        return _ratio(self.C, self.noise_denominator, z)[..., None, None]

    def impulse_response(self, samples: int) -> Array:
        """Responses of the plant to unit impulses at sample 0, (samples, 1, m)."""
        responses = [impulse_response(*self._path(i), samples) for i in range(self.inputs)]
        return np.reshape(responses, (self.inputs, samples)).T[:, None, :]

    def step_response(self, samples: int) -> Array:
        """Responses of the plant to unit steps at sample 0, (samples, 1, m)."""
        return np.cumsum(self.impulse_response(samples), axis=0)

    def noise_impulse_response(self, samples: int) -> Array:
        """Response of the noise filter to a unit impulse at sample 0, (samples, 1, 1)."""
        return impulse_response(self.C, self.noise_denominator, samples)[:, None, None]

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
        """
        if self.inputs > 1:
            return self.state_space().to_scipy()
        return scipy.signal.TransferFunction(
            *self.transfer_functions[0], dt=1.0 / self.sampling_rate
        )

    @property
    def transfer_functions(self) -> list[tuple[Array, Array]]:
        """Numerator and denominator of each G_i, or of H without input, in powers of z."""
        if not self.has_input:
            return [powers_of_z(self.C, self.noise_denominator)]
        return [powers_of_z(*self._path(place)) for place in range(self.inputs)]

    def _path(self, place: int) -> tuple[Array, Array]:
        """Numerator with its delay and denominator of G_i."""
        return self.delayed_b(place), np.convolve(self.A, self.F[place])


Model = PolynomialModel | StateSpaceModel
Form = TypeVar("Form", PolynomialModel, StateSpaceModel)


def of_signals(model: Form, signals: Recording) -> Form:
    """The model with the rate and the names of the channels of signals."""
    return replace(
        model,
        sampling_rate=signals.sampling_rate,
        input_names=signals.input_names,
        output_names=signals.output_names,
    )


def state_space_of(model: Model) -> StateSpaceModel:
    """The same model in innovations form."""
    return model if isinstance(model, StateSpaceModel) else model.state_space()


def simulated_form(model: Model) -> StateSpaceModel:
    """The plant in state space, for simulations from other states than rest; no covariance."""
    if isinstance(model, StateSpaceModel):
        return model
    plain = model if model.covariance is None else replace(model, covariance=None)
    return plain.plant().state_space()


def model_of(orders: Orders, parameters: Array, **attributes: Any) -> PolynomialModel:
    """The model of orders and coefficients, with attributes as its constructor takes them."""

    def monic(letter: str, place: int = 0) -> Array:
        return np.concatenate([[1.0], parameters[orders.part(letter, place)]])

    places = range(orders.inputs)
    return PolynomialModel(
        A=monic("a"),
        B=tuple(np.array(parameters[orders.part("b", i)]) for i in places),
        C=monic("c"),
        D=monic("d"),
        F=tuple(monic("f", i) for i in places),
        nk=orders.nk,
        structure=orders.structure,
        **attributes,
    )


def save_model_mat(
    model: Model, path: str | os.PathLike[str], continuous: ContinuousRecord | None = None
) -> None:
    """Write the arguments of MATLAB's ``idpoly`` or ``idss`` to a v5 MAT file.

    The level of the outputs, which they do not have, is stored beside them, and what ``idtf`` takes
    of the model in continuous time in a structure.
    """
    with atomic_write(Path(path)) as temporary, temporary.open("wb") as stream:
        in_s = continuous.model if continuous else None
        beside = {"Continuous": in_s.matlab_arguments()} if in_s else {}
        scipy.io.savemat(stream, {**model.matlab_arguments(), **beside})
        # SciPy stamps the header with the time of writing; the same model must give the same
        # bytes.  The first 116 bytes are free text (MATLAB Level 5 MAT-file format).
        stream.seek(0)
        stream.write(b"MATLAB 5.0 MAT-file, written by evopem".ljust(116))


def _cells(arrays: Sequence[Array]) -> NDArray[Any]:
    """A row, nothing, or a row of arrays that MATLAB reads as a cell array."""
    if len(arrays) < 2:
        return arrays[0][None, :] if arrays else np.zeros((0, 0))
    cells = np.empty((1, len(arrays)), dtype=object)
    for place, array in enumerate(arrays):
        cells[0, place] = array[None, :]
    return cells


def _ratio(above: Array, below: Array, z: Complex) -> Complex:
    polyval = np.polynomial.polynomial.polyval
    # At a pole on the unit circle the response is infinite.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(polyval(z, above) / polyval(z, below), dtype=complex)
