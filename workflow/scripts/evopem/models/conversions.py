"""Other forms of models: polynomials in state space, and a plant beside noise."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import NDArray

from evopem.arrays import Array
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import ParameterCovariance, jacobian_of
from evopem.models.state_space import StateSpaceModel


def innovations_form(
    o: Orders,
    coefficients: Array,
    level: float,
    covariance: ParameterCovariance | None,
    **attributes: Any,
) -> StateSpaceModel:
    """A polynomial model in innovations form, with the covariance of its entries.

    Observer forms side by side: of A with all that enters it directly, of each F_i, and of D
    where the noise has poles of its own.  The states of the plant come first.
    """
    parameters = np.append(coefficients, level)
    if covariance is not None:
        covariance = covariance.through(
            jacobian_of(partial(_matrices, o), parameters)[:, : len(covariance)]
        )
    A, B, C, D, K, levels = _matrices(o, parameters)
    shifts = tuple(max(nk - 1, 0) for nk in o.nk)
    return StateSpaceModel(
        *(A, B, C, D, K),
        level=levels,
        input_delays=shifts if any(shifts) else (),
        covariance=covariance,
        structure="ss" if np.any(K) else "ss_oe",
        **attributes,
    )


def has_own_noise(o: Orders) -> bool:
    """Whether the noise has states of its own."""
    return o.nd > 0 or (o.na == 0 and o.nc > 0)


def block_sizes(o: Orders) -> list[int]:
    """States of the blocks: A with what enters it directly, each F_i, the noise."""
    # Lags above 0 at which the shifted inputs act.
    taps = [nb if nk else nb - 1 for nb, nk in zip(o.nb, o.nk, strict=True)]
    direct = [lags for lags, nf in zip(taps, o.nf, strict=True) if nf == 0]
    own_noise = has_own_noise(o)
    shared = max([o.na, *direct, 0 if own_noise else o.nc])
    of_inputs = [max(nf, lags) if nf else 0 for lags, nf in zip(taps, o.nf, strict=True)]
    noise = o.noise_states if own_noise else 0
    # A model of one gain alone has an idle state: a state-space model has one at least.
    return [max(shared, int(not any(of_inputs))), *of_inputs, noise]


def _matrices(o: Orders, parameters: NDArray) -> tuple[NDArray, ...]:
    """A, B, C, D, K and level of the innovations form; of complex parameters, complex."""
    sizes = block_sizes(o)
    edges = list(pairwise(np.cumsum([0, *sizes]).tolist()))
    n, nu = sum(sizes), o.inputs
    shapes = (n, n), (n, nu), (1, n), (1, nu), (n, 1)
    A, B, C, D, K = (np.zeros(shape, parameters.dtype) for shape in shapes)
    for first, stop in edges:
        A[range(first, stop - 1), range(first + 1, stop)] = 1.0
        C[0, first : min(first + 1, stop)] = 1.0
    own_noise = has_own_noise(o)
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
    level = parameters[-1:] / (1.0 + np.sum(a)) if parameters[-1] else parameters[-1:]
    return A, B, C, D, K, level


def side_by_side(plant: StateSpaceModel, noise: StateSpaceModel) -> StateSpaceModel:
    """A plant without noise model and a noise model without input in one model, the plant first.

    The state-space counterpart of a Box-Jenkins model; entries of the two are independent.
    """
    model = _stacked(plant, noise)
    if plant.covariance is None or noise.covariance is None:
        return model
    entries, more = plant.parameters.size, noise.parameters.size
    numbered = _stacked(
        plant.with_parameters(np.arange(1.0, entries + 1.0)),
        noise.with_parameters(np.arange(entries + 1.0, entries + more + 1.0)),
    )
    # Of each entry of the model that of either, or none: 0.
    source = numbered.parameters.astype(np.intp)
    both = [(known.factor, known.null_space) for known in (plant.covariance, noise.covariance)]
    parts = [scipy.linalg.block_diag(*pair) for pair in zip(*both, strict=True)]
    joint = ParameterCovariance(*(np.vstack([np.zeros(part.shape[1]), part]) for part in parts))
    return replace(model, covariance=joint.part(source))


def _stacked(plant: StateSpaceModel, noise: StateSpaceModel) -> StateSpaceModel:
    return replace(
        plant,
        A=scipy.linalg.block_diag(plant.A, noise.A),
        B=np.vstack([plant.B, np.zeros((noise.order, plant.inputs))]),
        C=np.hstack([plant.C, noise.C]),
        K=np.vstack([plant.K, noise.K]),
        noise_covariance=noise.noise_covariance,
        structure="ss",
        covariance=None,
    )


def plant_of(model: StateSpaceModel, states: int) -> StateSpaceModel:
    """A model without the states of noise alone behind so many, with its part of the covariance."""
    if states == model.order:
        return model

    def plant(whole: StateSpaceModel) -> StateSpaceModel:
        parts = whole.A[:states, :states], whole.B[:states], whole.C[:, :states], whole.K[:states]
        A, B, C, K = parts
        return replace(whole, A=A, B=B, C=C, K=K, structure="ss_oe", covariance=None)

    return replace(plant(model), covariance=covariance_of_part(model, plant))


def covariance_of_part(
    model: StateSpaceModel, part: Callable[[StateSpaceModel], StateSpaceModel]
) -> ParameterCovariance | None:
    """The covariance of the entries that a part of a model has of it; None where not known."""
    numbered = model.with_parameters(np.arange(model.parameters.size, dtype=float))
    return model.covariance and model.covariance.part(part(numbered).parameters.astype(np.intp))
