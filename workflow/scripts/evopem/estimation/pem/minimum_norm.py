"""The shortest B among those that the data do not tell apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.covariance import pseudo_inverse_factor
from evopem.models.structures import Orders

Array = NDArray[np.float64]


def minimum_norm_point(point: Array, triangle: Array, orders: Orders) -> Array:
    """The point with the smallest ||b|| among those of equal residuals with the same A and C.

    The residuals are linear in B and the noise state, given A and C.  Along the null space of
    that part of the Jacobian they do not change, so an input that excites fewer directions than
    B has coefficients leaves B undetermined; the search may end anywhere there.

    Parameters
    ----------
    point : (n + nc,) array
        Parameters and noise state.
    triangle : (m, n + nc) array
        Of :func:`.covariance.jacobian_triangle` at the point.
    orders : Orders

    Returns
    -------
    (n + nc,) array
        A new array; equal to the point where the data determine B.
    """
    of_b = slice(orders.na, orders.na + orders.single.nb)
    linear = np.r_[of_b, orders.parameters : len(point)]
    _, null_space = pseudo_inverse_factor(triangle[:, linear])
    shortest = point.copy()
    if not np.any(null_space[: orders.single.nb]):
        return shortest
    weights = np.linalg.lstsq(null_space[: orders.single.nb], -point[of_b], rcond=None)[0]
    shortest[linear] += null_space @ weights
    return shortest
