"""Which signals the Gauss-Newton matrices are sums of products of, and the buffers for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    NOISE_STATE,
    OF_A,
    OF_B,
    PLANT_STATE,
    Record,
)
from evopem.estimation.pem.kernels.simd import lanes_table

Array = NDArray[np.float64]

# The response of D/C to an impulse, beside the parts of the parameters.
NOISE_RESPONSE = NOISE_STATE + 1


class LagSums(NamedTuple):
    """Buffers of the products of lagged signals.

    ``parts`` are the kind, the input, the copies and the first row of each part of the sums, the
    coefficients among the copies and their first row in the signed parameters, and the part with
    the response to what enters it from the past, or -1.  Stretches of their signals through 1/C, D
    and 1/F_i, and before the filters; the filtered signals at the two ends of the record; the sums.
    """

    parts: NDArray[np.intp]
    source: Array
    by_c: Array
    by_d: Array
    by_f: Array
    heads: Array
    tails: Array
    sums: Array


def lag_sums_for(record: Record) -> LagSums:
    """Buffers for the products of lags."""
    parts = _parts_of_sums(record)
    rows = int(parts[:, 2].sum())
    history = max(int(parts[:, 2].max(initial=0)), record.history) + BLOCK
    filtered = len(parts) * (history + CHUNK)
    return LagSums(
        parts=parts,
        source=lanes_table(CHUNK),
        by_c=lanes_table(filtered),
        by_d=lanes_table(filtered if record.nd else 1),
        by_f=lanes_table(filtered if record.nf.any() else 1),
        heads=lanes_table(len(parts) * history),
        tails=lanes_table(len(parts) * history),
        sums=lanes_table(rows * rows),
    )


def _parts_of_sums(record: Record) -> NDArray[np.intp]:
    """See :class:`LagSums`."""
    own = [tuple(part) for part in record.parts.tolist()]
    responses: dict[tuple[int, int], tuple[int, int]] = {}
    needed = {(kind, i): count for kind, i, count, _ in own}
    for kind, i, count, _ in own:
        if kind in (OF_A, OF_B) and count > 1:
            response = (NOISE_RESPONSE, 0) if record.nd else (NOISE_STATE, 0)
            if kind == OF_B and record.nf[i]:
                response = (PLANT_STATE, i)
            responses[kind, i] = response
            needed[response] = max(needed.get(response, 0), count - 1)
    signed = {(kind, i): (count, row) for kind, i, count, row in own}
    places = list(needed)
    found, first = [], 0
    for (kind, i), copies in needed.items():
        count, row = signed.get((kind, i), (0, 0))
        from_past = responses.get((kind, i))
        place = -1 if from_past is None else places.index(from_past)
        found.append((kind, i, copies, first, count, row, place))
        first += copies
    return np.array(found, dtype=np.intp).reshape(-1, 7)
