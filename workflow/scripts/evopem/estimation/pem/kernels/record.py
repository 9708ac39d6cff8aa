"""What a pass over the record needs: record, orders, objective and buffers.  Models are computed by
``F_i x_i = -B_i u_i + g_i``, ``v = A y + sum_i x_i - level``, ``C e = D v + s``; parameters are
stored signed, ``[a, -b_i, -c, d, -f_i, -level, g_i, s]``, C and F_i padded to :data:`MIN_NC`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Indices
from evopem.compilation import njit
from evopem.estimation.pem.kernels.simd import constant, lanes_table, store
from evopem.models.orders import Orders

# Parts of the signed parameters.
OF_A, OF_B, OF_C, OF_D, OF_F, LEVEL, PLANT_STATE, NOISE_STATE = range(8)
# The response of D/C to an impulse, beside them among the products of lagged signals.
NOISE_RESPONSE = NOISE_STATE + 1


# Samples that a recursion works through at a time.
BLOCK = 4
PAIR = 2 * BLOCK
MIN_NC = BLOCK - 1
# Samples of a stretch, a multiple of two blocks: its buffers fit the first-level cache.
CHUNK = 128
# Samples before the record that four lags at a time may read.
FRONT = 4

# Numbers of each input as one array, as are those of all in a layout: each array or number costs
# time at compilation and at a call.
INPUT = np.dtype([(name, np.intp) for name in ("nb", "nf", "nk", "rows_f", "at_b", "at_f", "at_g")])


class Record(NamedTuple):
    """A record, the orders of the models that share a pass over it, and the samples that count.
    ``y`` and, one after the other, the inputs in ``u`` begin with :data:`FRONT` zeros, which sample
    numbers include.  ``of_inputs``: :data:`INPUT` of each; ``layout``: the same of all, with rows
    looked back on, ``history``; ``at_...``: first signed rows.  ``entry``, ``sign``: the entry of a
    point that each holds, or -1, and its sign.  ``parts``: kind, input, coefficients, first row.
    ``monic``: of each monic polynomial first and last entry, and whether it is A or F_i."""

    y: Array
    u: Array
    of_inputs: NDArray[np.void]
    entry: Indices
    sign: Array
    layout: np.void
    parts: Indices
    monic: Indices
    loss_stop: int


class Stretches(NamedTuple):
    """Records of the same orders: their signals one after the other.  ``ends``: of each the first
    sample and the end of y and of u, and of the samples that count.  ``places`` of its point in
    that of all, ``shares`` of the barriers, ``weights`` of the loss and of the squares of its
    states, ``owners``: the only start that it counts for, or -1."""

    y: Array
    u: Array
    ends: Indices
    places: Indices
    shares: Array
    weights: Array
    owners: Indices


class Objective(NamedTuple):
    """The objective of a sum of losses, and the largest radii of A and F_i, of C and D.
    ``absolute`` or else square loss, times ``factor``, plus the weighted squares of the states."""

    absolute: bool
    factor: float
    plant_state_weight: float
    noise_state_weight: float
    plant_radius: float
    noise_radius: float


class Workspace(NamedTuple):
    """Buffers of a pass, each a table with one column for each of eight models.  ``windows`` are
    stretches of the adjoints of e and of all x_i."""

    parameters: Array
    gradient: Array
    x: Array
    v: Array
    e: Array
    windows: tuple[Array, Array]
    smoothing: Array
    total: Array


def record_of(
    output: Array, inputs: Array, orders: Orders, level: bool, residual_start: int, loss_start: int
) -> Record:
    """A record, of output (N,) and inputs (N, m), as the kernels read it."""
    o = orders
    na, nb, nc, nd, nf, nk = o.na, o.nb, o.nc, o.nd, o.nf, o.nk
    rows_c = max(nc, MIN_NC) if nc else 0
    rows_f = [max(order, MIN_NC) if order else 0 for order in nf]
    states = max(nc, nd)
    # Kind, input, rows, those of them that a point has, and sign of each part.
    parts = [
        (OF_A, 0, na, na, 1.0),
        *((OF_B, i, order, order, -1.0) for i, order in enumerate(nb)),
        (OF_C, 0, rows_c, nc, -1.0),
        (OF_D, 0, nd, nd, 1.0),
        *((OF_F, i, rows_f[i], order, -1.0) for i, order in enumerate(nf)),
        (LEVEL, 0, int(level), int(level), -1.0),
        *((PLANT_STATE, i, order, order, 1.0) for i, order in enumerate(nf)),
        (NOISE_STATE, 0, states, states, 1.0),
    ]
    at: list[list[int]] = [[] for _ in range(8)]
    entry: list[int] = []
    monic: list[tuple[int, int, bool]] = []
    sign: list[float] = []
    total = 0
    for kind, _, rows, count, place in parts:
        at[kind].append(len(entry))
        entry += [*range(total, total + count), *([-1] * (rows - count))]
        sign += [place] * rows
        if count and kind in (OF_A, OF_C, OF_D, OF_F):
            monic.append((total, total + count, kind in (OF_A, OF_F)))
        total += count
    first = [kind[0] if kind else 0 for kind in at]
    starts = np.cumsum([0, *(rows for _, _, rows, _, _ in parts)])
    kept = [
        (kind, i, count, row)
        for (kind, i, _, count, _), row in zip(parts, starts, strict=False)
        if count
    ]
    # A whole number of pairs of blocks from the first residual on.
    length = len(output) + -(len(output) - residual_start) % PAIR + FRONT
    history = max([rows_c, nd, *rows_f]) + FRONT
    of_inputs = list(zip(nb, nf, nk, rows_f, at[OF_B], at[OF_F], at[PLANT_STATE], strict=True))
    layout = {
        "inputs": len(nb),
        "na": na,
        "nc": nc,
        "nd": nd,
        "level": int(level),
        "states": states,
        "rows_c": rows_c,
        "at_c": first[OF_C],
        "at_d": first[OF_D],
        "at_level": first[LEVEL],
        "at_s": first[NOISE_STATE],
        "largest_order": max(na, nc, nd, *nf, 0),
        "plant_states": sum(nf),
        "history": history,
        "rows": length - FRONT - residual_start + history,
        "residual_start": FRONT + residual_start,
        "loss_start": FRONT + loss_start,
    }
    return Record(
        y=_framed(output, length),
        u=np.concatenate([np.zeros(0), *(_framed(signal, length) for signal in inputs.T)]),
        of_inputs=np.array(of_inputs, INPUT),
        entry=np.array(entry, dtype=np.intp),
        sign=np.array(sign),
        layout=np.array([tuple(layout.values())], [(name, np.intp) for name in layout])[0],
        parts=np.array(kept, dtype=np.intp).reshape(-1, 4),
        monic=np.array(monic, dtype=np.intp).reshape(-1, 3),
        loss_stop=FRONT + len(output),
    )


def _framed(signal: Array, length: int) -> Array:
    framed = np.zeros(length)
    framed[FRONT : FRONT + len(signal)] = signal
    return framed


def workspace_for(record: Record) -> Workspace:
    """Buffers for passes over a record."""
    layout, rows = record.layout, len(record.entry)
    stretch = CHUNK + layout["history"]
    return Workspace(
        parameters=lanes_table(rows),
        gradient=lanes_table(rows),
        x=lanes_table(layout["inputs"] * layout["rows"] if record.of_inputs["nf"].any() else 1),
        v=lanes_table(layout["rows"] if layout["nd"] else 1),
        e=lanes_table(layout["rows"]),
        windows=(lanes_table(stretch), lanes_table(max(layout["inputs"], 1) * stretch)),
        smoothing=lanes_table(1),
        total=lanes_table(1),
    )


class LagSums(NamedTuple):
    """Buffers of the products of lagged signals.  ``parts``: kind, input, copies and first row of
    each part of the sums, its coefficients and their first signed row, and the part with the
    response to what enters it from the past, or -1."""

    parts: Indices
    source: Array
    by_c: Array
    by_d: Array
    by_f: Array
    heads: Array
    tails: Array
    sums: Array
    width: int
    history: int


def lag_sums_for(record: Record, linear: bool) -> LagSums:
    """Buffers for the products of lags, of all parts of a point or of B, level and states alone."""
    parts = _parts_of_sums(record, linear)
    rows = int(parts[:, 2].sum())
    history = max(int(parts[:, 2].max(initial=0)), record.layout["history"]) + BLOCK
    filtered = len(parts) * (history + CHUNK)
    return LagSums(
        parts=parts,
        source=lanes_table(CHUNK),
        by_c=lanes_table(filtered),
        by_d=lanes_table(filtered if record.layout["nd"] else 1),
        by_f=lanes_table(filtered if record.of_inputs["nf"].any() else 1),
        heads=lanes_table(len(parts) * history),
        tails=lanes_table(len(parts) * history),
        sums=lanes_table(rows * rows),
        width=rows,
        history=history,
    )


def _parts_of_sums(record: Record, linear: bool) -> Indices:
    """See :class:`LagSums`."""
    kinds = (OF_B, LEVEL, PLANT_STATE, NOISE_STATE) if linear else range(NOISE_RESPONSE)
    parts = [tuple(part) for part in record.parts.tolist() if part[0] in kinds]
    responses: dict[tuple[int, int], tuple[int, int]] = {}
    needed = {(kind, i): count for kind, i, count, _ in parts}
    for kind, i, count, _ in parts:
        if kind in (OF_A, OF_B) and count > 1:
            response = (NOISE_RESPONSE, 0) if record.layout["nd"] else (NOISE_STATE, 0)
            if kind == OF_B and record.of_inputs["nf"][i]:
                response = (PLANT_STATE, i)
            responses[kind, i] = response
            needed[response] = max(needed.get(response, 0), count - 1)
    signed = {(kind, i): (count, row) for kind, i, count, row in parts}
    places = list(needed)
    sums, first = [], 0
    for (kind, i), copies in needed.items():
        count, row = signed.get((kind, i), (0, 0))
        from_past = responses.get((kind, i))
        place = -1 if from_past is None else places.index(from_past)
        sums.append((kind, i, copies, first, count, row, place))
        first += copies
    return np.array(sums, dtype=np.intp).reshape(-1, 7)


@njit
def fill(table, begin, end, value):
    """Write one number to all lanes of the rows ``begin ... end - 1`` of a table."""
    lanes = constant(value)
    for row in range(begin, end):
        store(table, row, lanes)


@njit
def load_points(record, points, rows, parameters):
    """Signed parameters of up to eight rows of a population, one in each lane, others zero."""
    fill(parameters, 0, parameters.shape[0], 0.0)
    for row in range(record.entry.size):
        index, sign = record.entry[row], record.sign[row]
        if index >= 0:
            for lane, r in enumerate(rows):
                parameters[row, lane] = sign * points[r, index]


@njit
def load_smoothing(smoothing, rows, workspace):
    """The smoothing widths of the loaded models' absolute values, 1 in the lanes left over."""
    store(workspace.smoothing, 0, constant(1.0))
    for lane, r in enumerate(rows):
        workspace.smoothing[0, lane] = smoothing[r]


@njit
def state_weight(record, objective, size, k):
    """Weight of the square of an entry of a point of some size: 0 but of states."""
    at_s = size - record.layout.states
    if k >= at_s:
        return objective.noise_state_weight
    return objective.plant_state_weight if k >= at_s - record.layout.plant_states else 0.0
