"""Stage one: an ARX model by linear least squares (chapter eq. 14-17)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.least_squares import chunks, triangle_of
from evopem.models.structures import Orders

Array = NDArray[np.float64]


def regression_rows(
    input: Array,  # noqa: A002
    output: Array,
    orders: Orders,
    start: int,
    stop: int,
) -> Array:
    """Rows ``[-y_(t-1).., u_(t-nk).., y_t]`` for start <= t < stop, (stop - start, na + nb + 1)."""
    past_outputs = [-output[start - i : stop - i] for i in range(1, orders.na + 1)]
    past_inputs = [
        input[start - orders.single.nk - j : stop - orders.single.nk - j]
        for j in range(orders.single.nb)
    ]
    return np.column_stack([*past_outputs, *past_inputs, output[start:stop]])


def fit_arx(input: Array, output: Array, orders: Orders, start: int) -> Array:  # noqa: A002
    """Least-squares ``[a_1..a_na, b_0..b_(nb-1)]`` of the equation error from ``start`` on.

    Solved by singular values, so that collinear regressors give the shortest solution instead of
    noise.  The result may be unstable; it is a start for the search, not a model.
    """
    samples = len(output)
    triangle = triangle_of(
        regression_rows(input, output, orders, *chunk) for chunk in chunks(start, samples)
    )
    phi, target = triangle[:, :-1], triangle[:, -1]
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0.0] = 1.0
    cutoff = np.finfo(float).eps * (samples - start)  # as for the matrix before its reduction
    solution = np.linalg.lstsq(phi / scale, target, rcond=cutoff)[0]
    coefficients: Array = solution / scale
    return coefficients
