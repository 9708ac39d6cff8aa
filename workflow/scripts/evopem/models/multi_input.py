"""Polynomial models with several inputs and one output, as plain data.

``A y = sum_i (B_i / F_i) u_i q^-nk_i + (C / D) e + level`` (Ljung 1999, section 4.2), the model
``idpoly`` of MATLAB with one output.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.config.structures import ORDER_NAMES, STRUCTURES, structure_name
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import roots
from evopem.models.state_space import StateSpaceModel
from evopem.models.state_space_modes import ShapedMode
from evopem.models.structures import named_orders

Array = NDArray[np.float64]

PER_INPUT = ("nb", "nf", "nk")
"""Orders that each input has its own of."""

# Steps in the imaginary direction have no cancellation: the derivative is exact to rounding.
_COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class MultiInputOrders:
    """Orders of a polynomial model with several inputs.

    Attributes
    ----------
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES` that has an input.
    nb, nf, nk : tuple of int
        One for each input: coefficients of B_i, the first of them at lag nk_i; degree of F_i.
    na, nc, nd : int
        Degrees of A, C and D.

    Examples
    --------
    >>> print(MultiInputOrders("armax", nb=(2, 1), nf=(0, 0), nk=(1, 3), na=2, nc=2))
    ARMAX(2,[2 1],2,[1 3])
    """

    structure: str
    nb: tuple[int, ...]
    nf: tuple[int, ...]
    nk: tuple[int, ...]
    na: int = 0
    nc: int = 0
    nd: int = 0

    def __post_init__(self) -> None:
        if len({len(self.nb), len(self.nf), len(self.nk)}) > 1 or not self.nb:
            raise ValueError("nb, nf and nk need one entry for each input")
        if min(self.na, self.nc, self.nd, *self.nf, *self.nk) < 0 or min(self.nb) < 1:
            raise ValueError(f"{self}: nb must be at least 1, and no order negative")

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.nb)

    @property
    def coefficients(self) -> int:
        """Number of coefficients of all polynomials."""
        return self.na + sum(self.nb) + self.nc + self.nd + sum(self.nf)

    @property
    def noise_states(self) -> int:
        """Length of the noise state, the larger of nc and nd."""
        return max(self.nc, self.nd)

    @property
    def first_residual(self) -> int:
        """Index of the first residual whose past inputs and outputs are measured."""
        return max(self.na, *(nk + nb - 1 for nk, nb in zip(self.nk, self.nb, strict=True)), 0)

    @property
    def joint(self) -> int:
        """The largest degree of A and F_i; without poles the largest number of B's coefficients."""
        return max(self.na, *self.nf) or max(self.nb)

    def part(self, letter: str, place: int = 0) -> slice:
        """Where the coefficients of A, C, D, or B or F of an input, stand in the parameters."""
        lengths = [self.na, *self.nb, self.nc, self.nd, *self.nf]
        nu = self.inputs
        at = {"a": 0, "b": 1 + place, "c": 1 + nu, "d": 2 + nu, "f": 3 + nu + place}[letter]
        first = sum(lengths[:at])
        return slice(first, first + lengths[at])

    def __str__(self) -> str:
        texts = []
        for name in STRUCTURES[self.structure]:
            value = getattr(self, name)
            texts.append(f"[{' '.join(map(str, value))}]" if name in PER_INPUT else str(value))
        return f"{structure_name(self.structure)}({','.join(texts)})"


def multi_input_orders(
    structure: str, orders: MultiInputOrders | Mapping[str, Any] | Sequence[Any], inputs: int
) -> MultiInputOrders:
    """Orders from a mapping of names, or from MATLAB's tuple; one number stands for all inputs.

    Raises
    ------
    ValueError
        When the structure is not known or has no input, does not have an order that is given, or a
        list is not as long as there are inputs.

    Examples
    --------
    >>> print(multi_input_orders("oe", {"nb": 2, "nf": [2, 1], "nk": 1}, 2))
    OE([2 2],[2 1],[1 1])
    """
    if isinstance(orders, MultiInputOrders):
        return orders
    if structure not in STRUCTURES or "nb" not in STRUCTURES[structure]:
        known = ", ".join(name for name in STRUCTURES if "nb" in STRUCTURES[name])
        raise ValueError(f"structure must be one of {known}, not {structure!r}")
    given = named_orders(structure, orders)
    found: dict[str, Any] = {}
    for name in ORDER_NAMES:
        value = given.get(name, 0)
        several = isinstance(value, Sequence) and not isinstance(value, str)
        numbers = tuple(value) if several else (value,)
        if any(isinstance(each, bool) or not isinstance(each, Integral) for each in numbers):
            raise ValueError(f"order {name} must be a whole number, not {value!r}")
        if several and name not in PER_INPUT:
            raise ValueError(f"order {name} is one number for all inputs, not {value!r}")
        if several and len(numbers) != inputs:
            raise ValueError(f"{inputs} inputs need {inputs} orders {name}, not {value!r}")
        numbers = tuple(map(int, numbers))
        found[name] = (
            (numbers if several else numbers * inputs) if name in PER_INPUT else numbers[0]
        )
    return MultiInputOrders(structure, **found)


@dataclass(frozen=True, eq=False)
class MultiInputModel:
    """A polynomial model with several inputs and one output.

    Attributes
    ----------
    structure : str
    A, C, D : (n + 1,) arrays
        Leading 1 included.
    B : tuple of (nb_i,) arrays
        One for each input, the first coefficient at lag nk_i.
    F : tuple of (nf_i + 1,) arrays
    nk : tuple of int
        Delays in samples.
    sampling_rate : float
        Hz.
    level : float
        Constant of the equation, in the unit of the output.
    noise_variance : float
        Of the innovations e.
    covariance : ParameterCovariance, optional
        Of ``[a, b_1 ... b_m, c, d, f_1 ... f_m, level]``.
    input_names : tuple of str
    output_name : str

    Examples
    --------
    >>> model = MultiInputModel(
    ...     "oe", A=np.ones(1), B=(np.array([2.0]), np.array([1.0])), C=np.ones(1), D=np.ones(1),
    ...     F=(np.array([1.0, -0.5]), np.ones(1)), nk=(1, 0),
    ... )
    >>> model.simulate([[1.0, 0.0], [0.0, 0.0], [0.0, 3.0]])
    array([0., 2., 4.])
    >>> model.frequency_response([0.0]).real
    array([[[4., 1.]]])
    """

    structure: str
    A: Array
    B: tuple[Array, ...]
    C: Array
    D: Array
    F: tuple[Array, ...]
    nk: tuple[int, ...]
    sampling_rate: float = 1.0
    level: float = 0.0
    noise_variance: float = float("nan")
    covariance: ParameterCovariance | None = None
    input_names: tuple[str, ...] = ()
    output_name: str = ""

    @property
    def orders(self) -> MultiInputOrders:
        """All orders."""
        return MultiInputOrders(
            self.structure,
            nb=tuple(map(len, self.B)),
            nf=tuple(len(f) - 1 for f in self.F),
            nk=self.nk,
            na=len(self.A) - 1,
            nc=len(self.C) - 1,
            nd=len(self.D) - 1,
        )

    @property
    def parameters(self) -> Array:
        """``[a, b_1 ... b_m, c, d, f_1 ... f_m, level]``."""
        f = [each[1:] for each in self.F]
        return np.concatenate(
            [self.A[1:], *self.B, self.C[1:], self.D[1:], *f, np.array([self.level])]
        )

    def with_parameters(self, parameters: Array) -> MultiInputModel:
        """The model with other parameters."""
        o = self.orders

        def monic(letter: str, place: int = 0) -> Array:
            return np.concatenate([[1.0], parameters[o.part(letter, place)]])

        places = range(o.inputs)
        return replace(
            self,
            A=monic("a"),
            B=tuple(parameters[o.part("b", i)] for i in places),
            C=monic("c"),
            D=monic("d"),
            F=tuple(monic("f", i) for i in places),
            level=float(parameters[-1]),
        )

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the plant, roots of A and of all F_i in the z plane."""
        return np.concatenate([roots(self.A[1:]), *(roots(f[1:]) for f in self.F)])

    def residuals(self, inputs: ArrayLike, output: ArrayLike) -> Array:
        """One-step prediction errors, (N,), from rest: ``(D/C) (A y - sum (B_i/F_i) u_i - level)``.

        Parameters
        ----------
        inputs : (N, nu) array_like
        output : (N,) array_like
        """
        from scipy.signal import lfilter

        u, y = np.asarray(inputs, dtype=float), np.asarray(output, dtype=float)
        v = lfilter(self.A, [1.0], y) - self.level
        for i, (b, f, nk) in enumerate(zip(self.B, self.F, self.nk, strict=True)):
            v -= lfilter(np.concatenate([np.zeros(nk), b]), f, u[:, i])
        errors: Array = lfilter(self.D, self.C, v)
        return errors

    def simulate(self, inputs: ArrayLike) -> Array:
        """Noise-free response from rest, (N,), of inputs, (N, nu)."""
        from scipy.signal import lfilter

        u = np.asarray(inputs, dtype=float)
        driven = np.zeros(len(u))
        for i, (b, f, nk) in enumerate(zip(self.B, self.F, self.nk, strict=True)):
            driven += lfilter(np.concatenate([np.zeros(nk), b]), f, u[:, i])
        simulated: Array = lfilter([1.0], self.A, driven)
        return simulated + self.level / float(np.sum(self.A))

    def frequency_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """``G_i = B_i q^-nk_i / (A F_i)`` at frequencies in Hz, (..., 1, nu)."""
        z = np.exp(-2j * np.pi * np.asarray(frequencies, dtype=float) / self.sampling_rate)
        polyval = np.polynomial.polynomial.polyval
        columns = [
            z**nk * polyval(z, b) / (polyval(z, self.A) * polyval(z, f))
            for b, f, nk in zip(self.B, self.F, self.nk, strict=True)
        ]
        return np.asarray(np.stack(columns, axis=-1)[..., None, :], dtype=complex)

    def modes(self) -> list[ShapedMode]:
        """Oscillating modes of A and all F_i, by frequency, with standard errors."""
        return self.plant().state_space().modes()

    def plant(self) -> MultiInputModel:
        """The model without noise poles of its own: those of D, or C where there is no A."""
        o = self.orders
        if not _has_own_noise(o):
            return self
        covariance = None
        if self.covariance is not None:
            noise = np.r_[o.part("c"), o.part("d")]
            rows = np.delete(np.arange(o.coefficients + 1), noise)
            covariance = self.covariance.part(rows)
        one = np.ones(1)
        return replace(self, C=one, D=one, covariance=covariance)

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``scipy.signal.StateSpace`` with one output."""
        return self.state_space().to_scipy()

    def to_control(self):  # type: ignore[no-untyped-def]
        """``G`` as a ``control.TransferFunction`` of one row; needs python-control."""
        import control

        from evopem.models.polynomials import powers_of_z

        pairs = [
            powers_of_z(np.concatenate([np.zeros(nk), b]), np.convolve(self.A, f))
            for b, f, nk in zip(self.B, self.F, self.nk, strict=True)
        ]
        above, below = zip(*pairs, strict=True)
        return control.TransferFunction([list(above)], [list(below)], 1.0 / self.sampling_rate)

    def idpoly_arguments(self) -> dict[str, Any]:
        """Arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)``; B and F as cell arrays.

        ``Level``, which ``idpoly`` does not have, stands beside them.
        """
        B = [np.concatenate([np.zeros(nk), b]) for b, nk in zip(self.B, self.nk, strict=True)]
        return {
            "A": self.A[None, :],
            "B": _cells(B),
            "C": self.C[None, :],
            "D": self.D[None, :],
            "F": _cells(self.F),
            "NoiseVariance": self.noise_variance,
            "Ts": 1.0 / self.sampling_rate,
            "Level": self.level,
        }

    @property
    def plant_states(self) -> int:
        """States of :meth:`state_space` that belong to the plant; those of the noise follow."""
        return sum(_sizes(self.orders)[:-1])

    def state_space(self) -> StateSpaceModel:
        """The same model in innovations form, with the covariance of its entries.

        Observer forms side by side: of A with all that enters it directly, of each F_i, and of D
        where the noise has poles of its own.  The states of the plant come first.
        """
        o = self.orders
        parameters = self.parameters
        parts = _matrices(o, parameters)
        covariance = None
        if self.covariance is not None:
            steps = parameters + 1j * _COMPLEX_STEP * np.eye(len(parameters))
            jacobian = np.array(
                [
                    np.concatenate([part.ravel() for part in _matrices(o, step)]).imag
                    / _COMPLEX_STEP
                    for step in steps
                ]
            ).T
            covariance = ParameterCovariance(
                jacobian @ self.covariance.factor, jacobian @ self.covariance.null_space
            )
        A, B, C, D, K, level = (np.ascontiguousarray(part.real) for part in parts)
        shifts = tuple(max(nk - 1, 0) for nk in o.nk)
        return StateSpaceModel(
            *(A, B, C, D, K),
            sampling_rate=self.sampling_rate,
            level=level,
            noise_covariance=np.array([[self.noise_variance]]),
            input_delays=shifts if any(shifts) else (),
            covariance=covariance,
            form="innovations" if np.any(K) else "output_error",
            input_names=self.input_names,
            output_names=(self.output_name,) if self.output_name else (),
        )


def _cells(arrays: Sequence[Array]) -> NDArray[np.object_]:
    """A row of arrays that MATLAB reads as a cell array."""
    cells = np.empty((1, len(arrays)), dtype=object)
    for place, array in enumerate(arrays):
        cells[0, place] = array[None, :]
    return cells


def _taps(o: MultiInputOrders) -> Iterator[int]:
    """Lags above 0 at which the shifted inputs act."""
    for nb, nk in zip(o.nb, o.nk, strict=True):
        yield nb if nk else nb - 1


def _has_own_noise(o: MultiInputOrders) -> bool:
    """Whether the noise has states of its own."""
    return o.nd > 0 or (o.na == 0 and o.nc > 0)


def _sizes(o: MultiInputOrders) -> list[int]:
    """States of the blocks: A with what enters it directly, each F_i, the noise."""
    direct = [taps for taps, nf in zip(_taps(o), o.nf, strict=True) if nf == 0]
    own_noise = _has_own_noise(o)
    shared = max([o.na, *direct, 0 if own_noise else o.nc])
    of_inputs = [max(nf, taps) if nf else 0 for taps, nf in zip(_taps(o), o.nf, strict=True)]
    noise = o.noise_states if own_noise else 0
    # A model of one gain alone has an idle state: a state-space model has one at least.
    return [max(shared, int(not any(of_inputs))), *of_inputs, noise]


def _matrices(o: MultiInputOrders, parameters: NDArray) -> tuple[NDArray, ...]:
    """A, B, C, D, K and level of the innovations form; of complex parameters, complex."""
    sizes = _sizes(o)
    edges = list(pairwise(np.cumsum([0, *sizes]).tolist()))
    n, nu = sum(sizes), o.inputs
    A = np.zeros((n, n), dtype=complex)
    B, C = np.zeros((n, nu), dtype=complex), np.zeros((1, n), dtype=complex)
    D, K = np.zeros((1, nu), dtype=complex), np.zeros((n, 1), dtype=complex)
    for first, stop in edges:
        A[range(first, stop - 1), range(first + 1, stop)] = 1.0
        C[0, first : min(first + 1, stop)] = 1.0
    own_noise = _has_own_noise(o)
    a, c, d = (parameters[o.part(letter)] for letter in "acd")
    for i in range(nu):
        b, f = parameters[o.part("b", i)], parameters[o.part("f", i)]
        first = edges[1 + i][0] if o.nf[i] else 0
        if o.nk[i] == 0:
            D[0, i], b = b[0], b[1:]
        B[first : first + len(b), i] += b
        if o.nf[i]:
            A[first : first + len(f), first] -= f
            B[first : first + len(f), i] -= f * D[0, i]
    first = edges[-1][0] if own_noise else 0
    K[first : first + len(c), 0] += c
    if len(d):
        K[first : first + len(d), 0] -= d
        A[first : first + len(d), first] -= d
    # The output feeds back through A: y = C x + D u + e.
    rows = slice(0, len(a))
    A[rows] -= np.outer(a, C[0])
    B[rows] -= np.outer(a, D[0])
    K[rows, 0] -= a
    level = parameters[-1:] / (1.0 + np.sum(a))
    return A, B, C, D, K, level
