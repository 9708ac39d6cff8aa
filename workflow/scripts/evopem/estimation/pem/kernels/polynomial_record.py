"""What a pass of the general polynomial model needs: the record, its orders and the buffers.

The model ``A y = (B/F) u q^-nk + (C/D) e + level`` is computed in three steps,

    F x = -B u + g,    v = A y + x - level,    C e = D v + s,

with ``g`` and ``s`` the effects of the unknown past of the plant and of the noise filter on their
first equations.  Parameters are stored signed, ``[a, -b, -c, d, -f, -level, g, s]``, with C and F,
where they have an order, padded by zeros to :data:`.record.MIN_NC` rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.cache import njit
from evopem.estimation.pem.kernels.record import CHUNK, MIN_NC, fill, padded_length
from evopem.estimation.pem.kernels.simd import lanes_table

# Samples before the record that four lags at a time may read.
FRONT = 4
# Filtered signals of the Jacobian: past output, delayed input, x, v, e, an impulse and a constant.
SIGNALS = 7


class PolynomialRecord(NamedTuple):
    """A record, the orders of the models that share a pass over it, and the samples that count.

    ``y`` and ``u`` begin with :data:`FRONT` zeros and are padded behind; sample numbers include
    them.  ``level`` is 1 where a constant is estimated and 0 otherwise.  ``states`` is the length
    of the noise state, ``max(nc, nd)``; the plant state has nf entries.  ``at_...`` are the first
    rows of the signed parameters, ``rows`` is their number, and ``history`` the rows that
    recursions look back on.
    """

    y: NDArray[np.float64]
    u: NDArray[np.float64]
    na: int
    nb: int
    nc: int
    nd: int
    nf: int
    nk: int
    level: int
    states: int
    rows_c: int
    rows_f: int
    at_c: int
    at_d: int
    at_f: int
    at_level: int
    at_g: int
    at_s: int
    rows: int
    history: int
    residual_start: int
    loss_start: int
    loss_stop: int


class PolynomialObjective(NamedTuple):
    """The objective of a sum of losses, and the stability region.

    ``absolute`` or else square loss, times ``factor``; the squares of the plant state and of the
    noise state are added with their weights.  Roots of A and F beyond ``plant_radius`` and roots of
    C and D beyond ``noise_radius`` are infeasible.
    """

    absolute: bool
    factor: float
    plant_state_weight: float
    noise_state_weight: float
    plant_radius: float
    noise_radius: float


# Of residuals and their derivatives, which depend on no objective.
ANY_OBJECTIVE = PolynomialObjective(False, 1.0, 0.0, 0.0, 1.0, 1.0)


class PolynomialWorkspace(NamedTuple):
    """Buffers of a pass, each a table with one column for each of eight models.

    Signed parameters and their gradient; x, v and e of the whole record; stretches of the three
    and of their adjoints; one row each for the smoothing of the absolute value and for sums;
    stretches of filtered signals, of the Jacobian, and the products of its columns.
    """

    parameters: NDArray[np.float64]
    gradient: NDArray[np.float64]
    x: NDArray[np.float64]
    v: NDArray[np.float64]
    e: NDArray[np.float64]
    windows: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    smoothing: NDArray[np.float64]
    total: NDArray[np.float64]
    source: NDArray[np.float64]
    by_c: NDArray[np.float64]
    by_d: NDArray[np.float64]
    by_f: NDArray[np.float64]
    columns: NDArray[np.float64]
    products: NDArray[np.float64]


def polynomial_record(
    output: NDArray[np.float64],
    input: NDArray[np.float64],  # noqa: A002 - the field's word
    orders: tuple[int, int, int, int, int, int],
    level: bool,
    residual_start: int,
    loss_start: int,
) -> PolynomialRecord:
    """A record as the kernels read it.

    Parameters
    ----------
    output, input : (N,) arrays
    orders : (na, nb, nc, nd, nf, nk)
    level : bool
        Whether a constant is estimated.
    residual_start : int
        First residual, at least ``max(na, nk + nb - 1)``.
    loss_start : int
        First residual that counts.
    """
    na, nb, nc, nd, nf, nk = orders
    rows_c = max(nc, MIN_NC) if nc else 0
    rows_f = max(nf, MIN_NC) if nf else 0
    states = max(nc, nd)
    at_c = na + nb
    at_d = at_c + rows_c
    at_f = at_d + nd
    at_level = at_f + rows_f
    at_g = at_level + int(level)
    at_s = at_g + nf
    length = FRONT + padded_length(len(output), residual_start)
    return PolynomialRecord(
        y=_framed(output, length),
        u=_framed(input, length),
        na=na,
        nb=nb,
        nc=nc,
        nd=nd,
        nf=nf,
        nk=nk,
        level=int(level),
        states=states,
        rows_c=rows_c,
        rows_f=rows_f,
        at_c=at_c,
        at_d=at_d,
        at_f=at_f,
        at_level=at_level,
        at_g=at_g,
        at_s=at_s,
        rows=at_s + states,
        history=max(rows_c, rows_f, nd) + FRONT,
        residual_start=FRONT + residual_start,
        loss_start=FRONT + loss_start,
        loss_stop=FRONT + len(output),
    )


def _framed(signal: NDArray[np.float64], length: int) -> NDArray[np.float64]:
    framed = np.zeros(length)
    framed[FRONT : FRONT + len(signal)] = signal
    return framed


def polynomial_workspace(record: PolynomialRecord) -> PolynomialWorkspace:
    """Buffers for passes over a record."""
    stretch = CHUNK + record.history
    whole = len(record.y) - record.residual_start + record.history
    estimated = record.rows
    return PolynomialWorkspace(
        parameters=lanes_table(record.rows),
        gradient=lanes_table(record.rows),
        x=lanes_table(whole if record.nf else 1),
        v=lanes_table(whole if record.nd else 1),
        e=lanes_table(whole),
        windows=(lanes_table(stretch), lanes_table(stretch), lanes_table(stretch)),
        smoothing=lanes_table(1),
        total=lanes_table(1),
        source=lanes_table(CHUNK),
        by_c=lanes_table(SIGNALS * stretch),
        by_d=lanes_table(SIGNALS * stretch),
        by_f=lanes_table(SIGNALS * stretch),
        columns=lanes_table((estimated + 3) * (CHUNK + 1)),
        products=lanes_table((estimated + 4) * (estimated + 4)),
    )


@njit
def point_index(record, row):
    """Entry of a point that a signed row holds, and its sign; the entry is -1 for padding."""
    if row < record.at_c:
        return row, 1.0 if row < record.na else -1.0
    index = record.at_c
    if row < record.at_d:
        k = row - record.at_c
        return (index + k, -1.0) if k < record.nc else (-1, 0.0)
    index += record.nc
    if row < record.at_f:
        return index + row - record.at_d, 1.0
    index += record.nd
    if row < record.at_level:
        k = row - record.at_f
        return (index + k, -1.0) if k < record.nf else (-1, 0.0)
    index += record.nf
    if row < record.at_g:
        return index, -1.0
    return index + record.level + row - record.at_g, 1.0


@njit
def load_polynomials(record, points, rows, parameters):
    """Signed parameters of up to eight rows of a population, one in each lane, others zero."""
    fill(parameters, 0, parameters.shape[0], 0.0)
    for row in range(record.rows):
        index, sign = point_index(record, row)
        if index >= 0:
            for lane, r in enumerate(rows):
                parameters[row, lane] = sign * points[r, index]


@njit
def weighted_states(record, objective, point):
    """Weighted squares of a point's plant state and noise state."""
    plant, noise = 0.0, 0.0
    at_s = point.size - record.states
    for k in range(at_s - record.nf, at_s):
        plant += point[k] * point[k]
    for k in range(at_s, point.size):
        noise += point[k] * point[k]
    return objective.plant_state_weight * plant + objective.noise_state_weight * noise
