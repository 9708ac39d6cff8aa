"""Polynomial models in state space, and as the arguments of MATLAB's ``idpoly``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Steps in the imaginary direction have no cancellation: the derivative is exact to rounding.
_COMPLEX_STEP = 1e-30


def plant_of(model: PolynomialModel) -> PolynomialModel:
    """The model without noise poles of its own: those of D, or C where there is no A."""
    o = model.orders
    if not _has_own_noise(o):
        return model
    covariance = model.covariance
    if covariance is not None:
        noise = np.r_[o.part("c"), o.part("d")]
        covariance = covariance.part(np.delete(np.arange(len(covariance)), noise))
    one = np.ones(1)
    return replace(model, C=one, D=one, covariance=covariance)


def idpoly_arguments(model: PolynomialModel) -> dict[str, Any]:
    """Arguments of MATLAB's ``idpoly(A,B,C,D,F,NoiseVariance,Ts)``.

    B and F of several inputs are cell arrays, and empty without an input, as ``idpoly`` takes them
    for a time series.  ``Level``, which ``idpoly`` does not have, stands beside them.
    """
    B = [np.concatenate([np.zeros(nk), b]) for b, nk in zip(model.B, model.nk, strict=True)]
    return {
        "A": model.A[None, :],
        "B": _cells(B),
        "C": model.C[None, :],
        "D": model.D[None, :],
        "F": _cells(model.F),
        "NoiseVariance": model.noise_variance,
        "Ts": 1.0 / model.sampling_rate,
        "Level": model.level,
    }


def _cells(arrays: Sequence[Array]) -> NDArray[Any]:
    """A row, nothing, or a row of arrays that MATLAB reads as a cell array."""
    if len(arrays) < 2:
        return arrays[0][None, :] if arrays else np.zeros((0, 0))
    cells = np.empty((1, len(arrays)), dtype=object)
    for place, array in enumerate(arrays):
        cells[0, place] = array[None, :]
    return cells


def innovations_form(model: PolynomialModel) -> StateSpaceModel:
    """The same model in innovations form, with the covariance of its entries.

    Observer forms side by side: of A with all that enters it directly, of each F_i, and of D
    where the noise has poles of its own.  The states of the plant come first.
    """
    o = model.orders
    parameters = np.append(model.parameters, model.level)
    covariance = None
    if model.covariance is not None:
        steps = parameters + 1j * _COMPLEX_STEP * np.eye(len(parameters))
        columns = [np.concatenate([part.ravel() for part in _matrices(o, step)]) for step in steps]
        jacobian = np.array(columns).imag.T[:, : len(model.covariance)] / _COMPLEX_STEP
        covariance = ParameterCovariance(
            jacobian @ model.covariance.factor, jacobian @ model.covariance.null_space
        )
    A, B, C, D, K, level = (
        np.ascontiguousarray(part.real) for part in _matrices(o, parameters.astype(complex))
    )
    shifts = tuple(max(nk - 1, 0) for nk in o.nk)
    return StateSpaceModel(
        *(A, B, C, D, K),
        sampling_rate=model.sampling_rate,
        level=level,
        noise_covariance=np.array([[model.noise_variance]]),
        input_delays=shifts if any(shifts) else (),
        covariance=covariance,
        structure="ss" if np.any(K) else "ss_oe",
        input_names=model.input_names,
        output_names=(model.output_name,) if model.output_name else (),
    )


def _taps(o: Orders) -> Iterator[int]:
    """Lags above 0 at which the shifted inputs act."""
    for nb, nk in zip(o.nb, o.nk, strict=True):
        yield nb if nk else nb - 1


def _has_own_noise(o: Orders) -> bool:
    """Whether the noise has states of its own."""
    return o.nd > 0 or (o.na == 0 and o.nc > 0)


def block_sizes(o: Orders) -> list[int]:
    """States of the blocks: A with what enters it directly, each F_i, the noise."""
    direct = [taps for taps, nf in zip(_taps(o), o.nf, strict=True) if nf == 0]
    own_noise = _has_own_noise(o)
    shared = max([o.na, *direct, 0 if own_noise else o.nc])
    of_inputs = [max(nf, taps) if nf else 0 for taps, nf in zip(_taps(o), o.nf, strict=True)]
    noise = o.noise_states if own_noise else 0
    # A model of one gain alone has an idle state: a state-space model has one at least.
    return [max(shared, int(not any(of_inputs))), *of_inputs, noise]


def _matrices(o: Orders, parameters: NDArray) -> tuple[NDArray, ...]:
    """A, B, C, D, K and level of the innovations form; of complex parameters, complex."""
    sizes = block_sizes(o)
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
