"""The polynomial model ``A y = sum_i (B_i/F_i) u_i q^-nk_i + (C/D) e + level`` as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.modes import Mode, modes_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial_responses import PolynomialResponses
from evopem.models.polynomials import residue, roots
from evopem.models.structures import Orders

if TYPE_CHECKING:
    from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, init=False)
class PolynomialModel(PolynomialResponses):
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
    input_names : tuple of str
    output_name : str

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

    An output-error model with two inputs:

    >>> one = np.ones(1)
    >>> model = PolynomialModel(one, ([2.0], [1.0]), F=([1.0, -0.5], one), nk=(1, 0))
    >>> model.simulate([[1.0, 0.0], [0.0, 0.0], [0.0, 3.0]])
    array([0., 2., 4.])
    >>> model.frequency_response([0.0]).real
    array([[[4., 1.]]])
    """

    A: Array
    B: tuple[Array, ...]
    C: Array
    D: Array
    F: tuple[Array, ...]
    nk: tuple[int, ...]
    sampling_rate: float
    level: float
    noise_variance: float
    covariance: ParameterCovariance | None
    structure: str
    input_names: tuple[str, ...]
    output_name: str

    def __init__(
        self,
        A: ArrayLike,
        B: Array | Sequence[ArrayLike],
        C: ArrayLike = (1.0,),
        D: ArrayLike = (1.0,),
        F: Array | Sequence[ArrayLike] = (1.0,),
        nk: int | Sequence[int] = 0,
        sampling_rate: float = 1.0,
        level: float = 0.0,
        noise_variance: float = float("nan"),
        covariance: ParameterCovariance | None = None,
        structure: str = "",
        input_names: Sequence[str] = (),
        output_name: str = "",
    ) -> None:
        of_inputs = _arrays(B) or ()
        monic = _arrays(F)
        delays = tuple(nk) if isinstance(nk, Sequence) else (int(nk),) * len(of_inputs)
        values = {
            "A": np.asarray(A, dtype=float),
            "B": of_inputs,
            "C": np.asarray(C, dtype=float),
            "D": np.asarray(D, dtype=float),
            "F": monic * len(of_inputs) if len(monic) == 1 else monic[: len(of_inputs)],
            "nk": delays[: len(of_inputs)],
            "sampling_rate": sampling_rate,
            "level": level,
            "noise_variance": noise_variance,
            "covariance": covariance,
            "structure": structure,
            "input_names": tuple(input_names),
            "output_name": output_name,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        if len({len(self.B), len(self.F), len(self.nk)}) > 1:
            raise ValueError("B, F and nk need one entry for each input")

    @property
    def a(self) -> Array:
        """A; with :attr:`b` to :attr:`f` the polynomials of a model with at most one input."""
        return self.A

    @property
    def b(self) -> Array:
        """B of the one input, (nb,); empty without an input."""
        return self._single(self.B, np.empty(0))

    @property
    def c(self) -> Array:
        """C."""
        return self.C

    @property
    def d(self) -> Array:
        """D."""
        return self.D

    @property
    def f(self) -> Array:
        """F of the one input, (nf + 1,); 1 without an input."""
        return self._single(self.F, np.ones(1))

    @property
    def delay(self) -> int:
        """Delay of the one input in samples; 0 without an input."""
        return self.orders.single.nk

    def _single(self, of_inputs: tuple[Array, ...], without: Array) -> Array:
        if len(of_inputs) > 1:
            raise ValueError(f"the model has {len(of_inputs)} inputs, not one")
        return of_inputs[0] if of_inputs else without

    @property
    def parameters(self) -> Array:
        """Coefficients ``[a_1.., b_1 ... b_m, c_1.., d_1.., f_1 ... f_m]``, (n,)."""
        f = [each[1:] for each in self.F]
        return np.concatenate([self.A[1:], *self.B, self.C[1:], self.D[1:], *f])

    def with_parameters(self, parameters: Array, **changes: Any) -> PolynomialModel:
        """The model with other coefficients, and other attributes."""
        return model_of(self.orders, parameters, **(self._beside() | changes))

    def _beside(self) -> dict[str, Any]:
        names = ("sampling_rate", "level", "noise_variance", "covariance")
        return {name: getattr(self, name) for name in (*names, "input_names", "output_name")}

    def parameter_standard_errors(self) -> Array | None:
        """Standard errors of :attr:`parameters`, (n,); None where the covariance is not known.

        Infinite for a parameter that the data do not determine.
        """
        if self.covariance is None:
            return None
        return self.covariance.standard_errors(np.eye(self.orders.parameters))

    def part(self, letter: str, place: int = 0) -> slice:
        """Where the coefficients of one of a, b, c, d, f stand in :attr:`parameters`."""
        return self.orders.part(letter, place)

    @property
    def delayed_b(self) -> Array:
        """B of the one input with its leading zeros, (nk + nb,); one zero without an input."""
        return np.concatenate([np.zeros(self.delay), self.b]) if self.has_input else np.zeros(1)

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the plant: roots of A and of all F_i in the z plane."""
        return np.concatenate([roots(self.A[1:]), *(roots(f[1:]) for f in self.F)])

    def zeros(self, place: int = 0) -> NDArray[np.complex128]:
        """Finite zeros from an input in the z plane, delay aside."""
        b = np.trim_zeros(self.B[place], "f") if self.has_input else np.empty(0)
        return roots(b[1:] / b[0]) if len(b) else np.empty(0, dtype=complex)

    def noise_poles(self) -> NDArray[np.complex128]:
        """Poles of the noise filter: roots of A and of D in the z plane, (na + nd,)."""
        return np.concatenate([roots(self.A[1:]), roots(self.D[1:])])

    def noise_zeros(self) -> NDArray[np.complex128]:
        """Zeros of the noise filter: roots of C in the z plane, (nc,)."""
        return roots(self.C[1:])

    def modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the plant's oscillating poles, by frequency.

        With standard errors where the model knows its covariance, and with participations of the
        inputs, each delayed by all but one of its nk samples, and of the innovations.

        Examples
        --------
        >>> import numpy as np
        >>> from evopem import PolynomialModel
        >>> one = np.ones(1)
        >>> model = PolynomialModel(one, one, F=np.array([1, -1.2, 0.8]), nk=1, sampling_rate=50.0)
        >>> (mode,) = model.modes()
        >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 3)
        (6.71, 0.132)
        """
        of_all = [self._driven(mode) for mode in self.modes_of_polynomial("a")]
        of_one = [
            self._driven(mode, place)
            for place in range(self.inputs)
            for mode in self.modes_of_polynomial("f", place)
        ]
        return _by_frequency([*of_all, *of_one])

    def _driven(self, mode: Mode, place: int | None = None) -> Mode:
        """A mode of A, or of the F of an input, with what drives it: residues at its pole."""
        of_inputs = np.zeros(self.inputs, dtype=complex)
        for i, (b, f, nk) in enumerate(zip(self.B, self.F, self.nk, strict=True)):
            if place in (None, i):
                found = residue(b, np.convolve(self.A, f), mode.pole)
                of_inputs[i] = found if nk else found * mode.pole
        of_noise = 0.0 if place is not None else residue(self.C, self.noise_denominator, mode.pole)
        return replace(
            mode,
            input_participation=of_inputs,
            noise_participation=np.array([of_noise * mode.pole], dtype=complex),
        )

    def noise_modes(self) -> list[Mode]:
        """Natural frequencies and damping ratios of the noise filter's oscillating poles."""
        return _by_frequency([*self.modes_of_polynomial("a"), *self.modes_of_polynomial("d")])

    def modes_of_polynomial(self, letter: str, place: int = 0) -> list[Mode]:
        """Modes of one of the polynomials a, d and f, by frequency."""
        part = self.part(letter, place)
        covariance = None if self.covariance is None else self.covariance.part(part)
        return modes_of(self.parameters[part], self.sampling_rate, covariance)

    def plant(self) -> PolynomialModel:
        """The model without noise poles of its own: those of D, or C where there is no A."""
        from evopem.models.polynomial_conversions import plant_of

        return plant_of(self)

    def state_space(self) -> StateSpaceModel:
        """The same model in innovations form, with the covariance of its entries."""
        from evopem.models.polynomial_conversions import innovations_form

        return innovations_form(self)

    @property
    def plant_states(self) -> int:
        """States of :meth:`state_space` that belong to the plant; those of the noise follow."""
        from evopem.models.polynomial_conversions import block_sizes

        return sum(block_sizes(self.orders)[:-1])

    def matlab_arguments(self) -> dict[str, ArrayLike]:
        """Arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)``, and a level.

        B and F of several inputs are cell arrays, and empty without an input, as ``idpoly`` takes
        them for a time series.  ``Level``, which ``idpoly`` does not have, stands beside them.
        """
        from evopem.models.polynomial_conversions import idpoly_arguments

        return idpoly_arguments(self)


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


def _by_frequency(modes: list[Mode]) -> list[Mode]:
    return sorted(modes, key=lambda mode: mode.frequency_hz)


def _arrays(given: Array | Sequence[ArrayLike]) -> tuple[Array, ...]:
    """One array for each input; numbers are the array of one input, nothing is no input."""
    if len(given) == 0:
        return ()
    if np.ndim(given[0]) == 0:
        return (np.asarray(given, dtype=float),)
    return tuple(np.asarray(each, dtype=float) for each in given)
