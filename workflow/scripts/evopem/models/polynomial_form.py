"""The polynomials ``A y = sum_i (B_i/F_i) u_i q^-nk_i + (C/D) e + level`` with their roots."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array, Complex, columns
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial_roots import roots, uncertain_roots


@dataclass(frozen=True, eq=False, init=False)
class Polynomials:
    """The fields of a :class:`.PolynomialModel`, and what follows from its coefficients."""

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
    output_names: tuple[str, ...]

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
        output_names: Sequence[str] = (),
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
            "output_names": tuple(output_names),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        if len({len(self.B), len(self.F), len(self.nk)}) > 1:
            raise ValueError("B, F and nk need one entry for each input")

    @cached_property
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
    def outputs(self) -> int:
        """Number of outputs, 1."""
        return 1

    @property
    def has_input(self) -> bool:
        """Whether the model has an input."""
        return len(self.B) > 0

    @property
    def parameters(self) -> Array:
        """Coefficients ``[a_1.., b_1 ... b_m, c_1.., d_1.., f_1 ... f_m]``, (n,)."""
        f = [denominator[1:] for denominator in self.F]
        return np.concatenate([self.A[1:], *self.B, self.C[1:], self.D[1:], *f])

    def parameter_standard_errors(self) -> Array | None:
        """Standard errors of :attr:`parameters`, (n,); None where the covariance is not known.

        Infinite for a parameter that the data do not determine.
        """
        if self.covariance is None:
            return None
        return self.covariance.standard_errors(np.eye(self.orders.parameters))

    def delayed_b(self, place: int = 0) -> Array:
        """B of an input with its leading zeros, (nk + nb,)."""
        return np.concatenate([np.zeros(self.nk[place]), self.B[place]])

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

    def poles(self) -> Complex:
        """Poles of the plant: roots of A and of all F_i in the z plane."""
        return np.concatenate([roots(self.A[1:]), *(roots(f[1:]) for f in self.F)])

    def zeros(self, place: int = 0) -> Complex:
        """Finite zeros from an input in the z plane, delay aside."""
        b = np.trim_zeros(self.B[place], "f") if self.has_input else np.empty(0)
        return roots(b[1:] / b[0]) if len(b) else np.empty(0, dtype=complex)

    def noise_poles(self) -> Complex:
        """Poles of the noise filter: roots of A and of D in the z plane, (na + nd,)."""
        return np.concatenate([roots(self.A[1:]), roots(self.D[1:])])

    def noise_zeros(self) -> Complex:
        """Zeros of the noise filter: roots of C in the z plane, (nc,)."""
        return roots(self.C[1:])

    def uncertain_roots(self, letter: str) -> list[tuple[complex, Array]]:
        """Roots of one of a, b, c, d, f of a model of at most one input, with covariances."""
        if letter in "bf" and not self.has_input:
            return []
        covariance = (
            None if self.covariance is None else self.covariance.part(self.orders.part(letter))
        )
        polynomial = getattr(self, letter.upper())
        return uncertain_roots(polynomial[0] if letter in "bf" else polynomial, covariance)

    def residuals(self, inputs: ArrayLike, output: ArrayLike) -> Array:
        """One-step prediction errors ``e = (D/C) (A y - sum (B_i/F_i) u_i - level)``, (N,).

        Of (N,) or (N, m) inputs and (N,) or (N, 1) outputs, from rest; NaN before
        ``orders.first_residual``.
        With a fitted state: :meth:`.StateSpaceModel.residuals` of the model in state space.
        """
        u, y = self._inputs(inputs), columns(output, 1, "output")[:, 0]
        if len(u) != len(y):
            raise ValueError(f"inputs have {len(u)} samples, the output has {len(y)}")
        first = self.orders.first_residual
        if len(y) <= first:
            raise ValueError(f"the model needs more than {first} samples, not {len(y)}")
        v = scipy.signal.lfilter(self.A, [1.0], y)[first:] - self.level
        for i, f in enumerate(self.F):
            driven = scipy.signal.lfilter(self.delayed_b(i), [1.0], u[:, i])
            v = v - scipy.signal.lfilter([1.0], f, driven[first:])
        e = np.full(len(y), np.nan)
        e[first:] = scipy.signal.lfilter(self.D, self.C, v)
        return e

    def _inputs(self, inputs: ArrayLike) -> Array:
        return columns(inputs, self.inputs or None, "inputs")


def _arrays(given: Array | Sequence[ArrayLike]) -> tuple[Array, ...]:
    """One array for each input; numbers are the array of one input, nothing is no input."""
    if len(given) == 0:
        return ()
    if np.ndim(given[0]) == 0:
        return (np.asarray(given, dtype=float),)
    return tuple(np.asarray(polynomial, dtype=float) for polynomial in given)


def impulse_response(above: Array, below: Array, samples: int) -> Array:
    """Response of a filter to a unit impulse at sample 0, (samples,)."""
    impulse = np.zeros(samples)
    impulse[:1] = 1.0
    return np.asarray(scipy.signal.lfilter(above, below, impulse))
