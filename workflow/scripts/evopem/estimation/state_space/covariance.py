"""Covariance of all entries of the model of a point."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from evopem.estimation.state_space.entries import entries_jacobian
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.noise_colour import coloured_autocovariances
from evopem.estimation.state_space.point_model import degrees_of_freedom
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: they are raised to it, and standard errors are then lower bounds.
UNDETERMINED = 1e-15
# Lags of errors that cost as much as filtering the signals for one pair of outputs.
FILTERED = 20


def parameter_covariance(
    errors: StateSpaceErrors, found: Projection, weights: Array
) -> ParameterCovariance:
    """Covariance of the entries of ``[A, B, C, D, K, level]``, initial states estimated along.

    ``H^-1 S H^-1``, where H is the Gauss-Newton Hessian and S the covariance of the gradient.  In
    innovations form the errors are white.  Those of an output-error form need not be: S then
    takes their autocovariances, independent of the inputs (Ljung 1999, eq. 9.42).  The free
    choice of the states, n directions of H, is left out.

    Parameters
    ----------
    errors : StateSpaceErrors
    found : Projection
        Its errors are those of the gradient: of another objective than squares its scores.
    weights : (ny, ny) array
        Of the outputs.
    """
    hessian = _information(errors, found, weights)
    score = _score_covariance(errors, found, weights)
    scale = np.sqrt(np.diag(hessian))
    unseen = scale == 0.0
    scale[unseen] = 1.0
    values, vectors = np.linalg.eigh(hessian / np.outer(scale, scale))
    kept = np.arange(len(values)) >= errors.order
    least = UNDETERMINED * values[-1]
    determined = kept & (values > least)
    inverse = vectors[:, determined] / values[determined]
    middle = inverse.T @ (score / np.outer(scale, scale)) @ inverse
    square, turned = np.linalg.eigh(0.5 * (middle + middle.T))
    root = turned * np.sqrt(np.maximum(square, 0.0))
    mapping = entries_jacobian(errors, found) / scale
    # Rounding hides how far along these the data allow to go, but not what they hardly change.
    farthest = vectors[:, kept & ~determined] / np.sqrt(least)
    factor = mapping @ np.hstack([vectors[:, determined] @ root, farthest])
    return ParameterCovariance(factor, mapping[:, unseen])


def _information(errors: StateSpaceErrors, found: Projection, weights: Array) -> Array:
    """``J' W J`` over coordinates and, output by output, linear coefficients."""
    signals = errors.signals.derivatives(found.sections, found.states)
    return _products(
        errors, found, (signals, found.regressors), (signals, found.regressors), weights
    )


def _score_covariance(errors: StateSpaceErrors, found: Projection, weights: Array) -> Array:
    """Covariance of ``J' W e``, over the same."""
    record = errors.record
    inflation = record.samples / degrees_of_freedom(errors)
    if errors.innovations:
        autocovariances = found.covariance[None]
    else:
        autocovariances = coloured_autocovariances(found.errors, record.bounds)
    between = weights @ autocovariances @ weights
    signals = errors.signals.derivatives(found.sections, found.states), found.regressors
    pairs = weights.shape[0] * (weights.shape[0] + 1) // 2
    summed = _summed_by_lags if len(between) < FILTERED * pairs else _summed_by_outputs
    return inflation * summed(errors, found, signals, between)


def _summed_by_lags(
    errors: StateSpaceErrors, found: Projection, signals: tuple[Array, Array], between: Array
) -> Array:
    """``sum J_(t+k)' between_k J_t`` over lags k of either sign, ``between_-k = between_k'``."""
    total = np.zeros(2 * (_coefficients(errors, found),))
    for lag, of_lag in enumerate(between):
        products = np.zeros_like(total)
        for first, stop in pairwise(errors.record.bounds):
            later, earlier = slice(first + lag, stop), slice(first, max(stop - lag, first))
            if first + lag >= stop:
                continue
            products += _products(
                errors,
                found,
                (signals[0][later], signals[1][later]),
                (signals[0][earlier], signals[1][earlier]),
                of_lag,
            )
        total += products if lag == 0 else products + products.T
    return total


def _summed_by_outputs(
    errors: StateSpaceErrors, found: Projection, signals: tuple[Array, Array], between: Array
) -> Array:
    """The same for many lags: signals filtered by all of them, for each pair of outputs."""
    outputs = between.shape[1]
    total = np.zeros(2 * (_coefficients(errors, found),))
    for one in range(outputs):
        for other in range(one + 1):
            of_lags = np.concatenate([between[:0:-1, other, one], between[:, one, other]])
            filtered = [_filtered(each, of_lags, errors.record.bounds) for each in signals]
            unit = np.zeros((outputs, outputs))
            unit[one, other] = 1.0
            products = _products(errors, found, signals, (filtered[0], filtered[1]), unit)
            total += products if one == other else products + products.T
    return total


def _filtered(signals: Array, of_lags: Array, bounds: NDArray[np.int64]) -> Array:
    """``sum_k of_lags_k signals_(t-k)`` over lags of either sign, record by record."""
    before = len(of_lags) // 2
    filtered = np.empty_like(signals)
    for first, stop in pairwise(bounds):
        whole = oaconvolve(signals[first:stop], of_lags[:, None], axes=0)
        filtered[first:stop] = whole[before : before + stop - first]
    return filtered


def _coefficients(errors: StateSpaceErrors, found: Projection) -> int:
    """Coordinates and, output by output, linear coefficients."""
    return errors.dimension + found.linear.size


def _products(
    errors: StateSpaceErrors,
    found: Projection,
    left: tuple[Array, Array],
    right: tuple[Array, Array],
    between: Array,
) -> Array:
    """``J_left' between J_right`` from the (signals, regressors) that both consist of."""
    c = found.linear[: errors.order].T
    top = errors.derivatives.contracted(found.sections, left[0].T @ right[0], c.T @ between @ c)
    upper = errors.derivatives.by_linear(found.sections, left[0].T @ right[1], c.T @ between)
    lower = errors.derivatives.by_linear(found.sections, right[0].T @ left[1], c.T @ between.T)
    bottom = np.kron(between, left[1].T @ right[1])
    return np.block([[top, upper], [lower.T, bottom]])
