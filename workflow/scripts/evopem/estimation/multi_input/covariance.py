"""Covariance of the coefficients of a polynomial model with several inputs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.pem.covariance import density_at_zero
from evopem.estimation.vector_autoregression import coloured_autocovariances
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: the data do not determine their directions.
UNDETERMINED = 1e-14


def parameter_covariance(
    errors: MultiInputErrors, point: Array, residuals: Array, tangent: Array | None = None
) -> ParameterCovariance | None:
    """Covariance of ``[a, b_1 ... b_m, c, d, f_1 ... f_m, level]`` in the units of the record.

    ``H^-1 S H^-1`` with ``H = J'J``, states estimated along.  With a noise model the residuals are
    white and ``S = variance H``.  Without one they need not be: S then takes their
    autocovariances, independent of the inputs (Ljung 1999, eq. 9.42).  Of the absolute objective
    the signs of the residuals over twice their density at zero take the place of the residuals
    (Bassett & Koenker 1978).

    Parameters
    ----------
    errors : MultiInputErrors
    point : (n,) array
    residuals : (samples,) array
    tangent : (n, k) array, optional
        Directions of a point that active constraints leave free; by default all.

    Returns
    -------
    ParameterCovariance or None
        None where the density at zero cannot be estimated.
    """
    scores = residuals
    if errors.objective == "absolute":
        density = density_at_zero(residuals, errors.dimension)
        if not density > 0.0:
            return None
        scores = np.sign(residuals) / (2.0 * density)
    columns, mapping = errors.jacobian(point), _mapping(errors)
    if tangent is not None:
        columns, mapping = columns @ tangent, mapping @ tangent
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    columns = columns / size
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > UNDETERMINED * values[-1]
    inverse = vectors[:, kept] / values[kept]
    middle = inverse.T @ _score_covariance(errors, columns, scores) @ inverse
    square, turned = np.linalg.eigh(0.5 * (middle + middle.T))
    mapping = mapping / size
    root = turned * np.sqrt(np.maximum(square, 0.0))
    return ParameterCovariance(mapping @ (vectors[:, kept] @ root), mapping @ vectors[:, ~kept])


def _score_covariance(errors: MultiInputErrors, columns: Array, residuals: Array) -> Array:
    o, record = errors.orders, errors.record
    degrees = max(record.samples - errors.dimension, 1)
    inflation = record.samples / degrees
    if o.na or o.noise_states:
        variance = float(residuals @ residuals) / degrees
        return np.asarray(variance * (columns.T @ columns))
    total = np.zeros((columns.shape[1],) * 2)
    for lag, gamma in enumerate(coloured_autocovariances(residuals[:, None], record.bounds)):
        for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
            if first + lag >= stop:
                continue
            products = columns[first + lag : stop].T @ columns[first : stop - lag]
            total += float(gamma[0, 0]) * (products if lag == 0 else products + products.T)
    return np.asarray(inflation * total)


def _mapping(errors: MultiInputErrors) -> Array:
    """Derivatives of coefficients and level, in their units, by a point; level of all records."""
    o, record = errors.orders, errors.record
    mapping = np.zeros((errors.parameters, errors.dimension))
    coefficients = np.arange(o.parameters)
    mapping[coefficients, coefficients] = errors.units[:-1]
    own = (errors.dimension - o.parameters) // len(record.outputs)
    places = o.parameters + own * np.arange(len(record.outputs))
    mapping[-1, places] = record.output_scale * np.diff(record.bounds) / record.samples
    mapping[-1, o.part("a")] = record.offset
    return mapping
