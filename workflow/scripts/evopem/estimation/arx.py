"""Stage one: an ARX model by linear least squares (chapter eq. 14-17)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.armax import Orders

Array = NDArray[np.float64]


def regressors(input: Array, output: Array, orders: Orders, start: int) -> Array:  # noqa: A002
    """Rows ``[-y_(t-1).., u_(t-nk)..]`` of the regression for t >= start, (N - start, na + nb)."""
    samples = len(output)
    past_outputs = [-output[start - i : samples - i] for i in range(1, orders.na + 1)]
    past_inputs = [input[start - orders.nk - j : samples - orders.nk - j] for j in range(orders.nb)]
    return np.column_stack(past_outputs + past_inputs)


def fit_arx(input: Array, output: Array, orders: Orders, start: int) -> Array:  # noqa: A002
    """Least-squares ``[a_1..a_na, b_0..b_(nb-1)]`` of the equation error from ``start`` on.

    Solved by singular values, so that collinear regressors give the shortest solution instead of
    noise.  The result may be unstable; it is a start for the search, not a model.
    """
    phi = regressors(input, output, orders, start)
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0.0] = 1.0
    solution = np.linalg.lstsq(phi / scale, output[start:], rcond=None)[0]
    coefficients: Array = solution / scale
    return coefficients
