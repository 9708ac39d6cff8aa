"""From a point to the model, its initial states, and the covariance of all its entries."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.noise_colour import coloured_autocovariances
from evopem.estimation.state_space.sections import state_matrix
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: they are raised to it, and standard errors are then lower bounds.
UNDETERMINED = 1e-15
# Condition of the states' responses at the outputs, scaled to one, above which another basis of the
# states is taken, and doublings of the number of samples that they are seen over.
ILL_CONDITIONED, DOUBLINGS = 1e4, 20

# Lags of errors that cost as much as filtering the signals for one pair of outputs.
FILTERED = 20


def model_of(
    errors: StateSpaceErrors,
    found: Projection,
    sampling_rate: float,
    delays: tuple[int, ...],
    input_names: tuple[str, ...],
    output_names: tuple[str, ...],
) -> StateSpaceModel:
    """The model of a point in the units of the record, without covariance."""
    parts = _matrices(errors, found)
    record = errors.record
    scale = record.output_scales
    degrees = _degrees_of_freedom(errors)
    noise = found.covariance * np.outer(scale, scale) * record.samples / degrees
    return StateSpaceModel(
        A=parts[0],
        B=parts[1],
        C=parts[2],
        D=parts[3],
        K=parts[4],
        level=parts[5],
        sampling_rate=sampling_rate,
        noise_covariance=0.5 * (noise + noise.T),
        input_delays=delays if any(delays) else (),
        form="innovations" if errors.innovations else "output_error",
        input_names=input_names,
        output_names=output_names,
    )


def initial_states(
    errors: StateSpaceErrors, found: Projection, model: StateSpaceModel
) -> tuple[Array, Array]:
    """Initial states and levels of the records, of the model whose level is that of the record.

    A constant of the predictor's states belongs to the level: ``y - level`` drives the model.
    """
    record = errors.record
    levels = record_levels(errors, found)
    drives = _basis(errors, found) @ errors.drive_matrix(found)[:, errors.driving :]
    offset = (levels - record.output_offsets) / record.output_scales
    P = model.predictor
    steady = np.linalg.lstsq(
        np.eye(len(P)) - P, model.K @ (offset * record.output_scales).T, rcond=None
    )[0]
    return drives.T - steady.T, levels


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
    mapping = _entries_jacobian(errors, found) / scale
    # Rounding hides how far along these the data allow to go, but not what they hardly change.
    farthest = vectors[:, kept & ~determined] / np.sqrt(least)
    factor = mapping @ np.hstack([vectors[:, determined] @ root, farthest])
    return ParameterCovariance(factor, mapping[:, unseen])


def _degrees_of_freedom(errors: StateSpaceErrors) -> float:
    """Samples less the estimates for each output."""
    ny = errors.record.outputs.shape[1]
    estimated = (errors.parameters + errors.order * errors.record.records) / ny
    return float(max(errors.record.samples - estimated, 1.0))


def _information(errors: StateSpaceErrors, found: Projection, weights: Array) -> Array:
    """``J' W J`` over coordinates and, output by output, linear coefficients."""
    signals = errors.signals.derivatives(found.sections, found.states)
    return _products(
        errors, found, (signals, found.regressors), (signals, found.regressors), weights
    )


def _score_covariance(errors: StateSpaceErrors, found: Projection, weights: Array) -> Array:
    """Covariance of ``J' W e``, over the same."""
    record = errors.record
    inflation = record.samples / _degrees_of_freedom(errors)
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


def _matrices(errors: StateSpaceErrors, found: Projection) -> tuple[Array, ...]:
    """A, B, C, D, K and level in the units of the record."""
    record, n = errors.record, errors.order
    nu, ny = record.inputs.shape[1], record.outputs.shape[1]
    direct = int(record.feedthrough.sum())
    linear = found.linear
    C, D = linear[:n].T, np.zeros((ny, nu))
    D[:, record.feedthrough] = linear[n : n + direct].T
    basis = _basis(errors, found)
    inverse = np.linalg.inv(basis)
    C, K = C @ inverse, basis @ errors.gain(found)
    A = basis @ _predictor(errors, found) @ inverse + K @ C
    B = basis @ errors.drive_matrix(found)[:, :nu] + K @ D
    level = _level(errors, found, _constant(errors, found))
    u, y = record.input_scales, record.output_scales
    return (
        A,
        B / u,
        C * y[:, None],
        D * y[:, None] / u,
        K / y,
        record.output_offsets + y * level,
    )


def record_levels(errors: StateSpaceErrors, found: Projection) -> Array:
    """Level of each record in the units of the outputs, (records, ny)."""
    record = errors.record
    ny = record.outputs.shape[1]
    if not record.levels:
        return np.zeros((record.records, ny))
    levels = np.array([_level(errors, found, constant) for constant in _constants(errors, found)])
    return np.asarray(record.output_offsets + record.output_scales * levels)


def _level(errors: StateSpaceErrors, found: Projection, constant: Array) -> Array:
    """Mean of scaled outputs at rest from the constant of the predictor."""
    if not errors.innovations:
        return constant
    return np.asarray(
        np.linalg.lstsq(np.eye(len(constant)) - _feedback(errors, found), constant, rcond=None)[0]
    )


def _feedback(errors: StateSpaceErrors, found: Projection) -> Array:
    """What the predictor adds to its prediction for constant outputs, (ny, ny)."""
    A = _predictor(errors, found)
    C = found.linear[: errors.order].T
    return np.asarray(C @ np.linalg.solve(np.eye(len(A)) - A, errors.gain(found)))


def _predictor(errors: StateSpaceErrors, found: Projection) -> Array:
    return state_matrix(found.sections, errors.layout)


def _basis(errors: StateSpaceErrors, found: Projection) -> Array:
    """The states of the model from those of the sections, (n, n).

    The same ones, unless sections with nearly equal poles cancel each other: entries of A and C
    would be so large that rounding spoils simulations.  The model then has states whose responses
    at the outputs are orthonormal (output-normal form).
    """
    P, C = _predictor(errors, found), found.linear[: errors.order].T
    with np.errstate(all="ignore"):
        # Of C, C P, C P^2, ..., twice as many in each step.
        root = np.asarray(np.linalg.qr(np.vstack([C, np.zeros_like(P)]), mode="r"))
        power = P
        for _ in range(DOUBLINGS):
            root = np.asarray(np.linalg.qr(np.vstack([root, root @ power]), mode="r"))
            power = power @ power
        size = np.linalg.norm(root, axis=0)
        ill = np.linalg.cond(root / size) > ILL_CONDITIONED
        usable = np.isfinite(np.linalg.inv(root)).all() if np.all(np.diag(root)) else False
    return root if ill and usable else np.eye(len(P))


def _entries_jacobian(errors: StateSpaceErrors, found: Projection) -> Array:
    """Derivatives of all entries by coordinates and linear coefficients."""
    record, layout, n = errors.record, errors.layout, errors.order
    nu, ny = record.inputs.shape[1], record.outputs.shape[1]
    direct = np.flatnonzero(record.feedthrough)
    q = found.regressors.shape[1]
    basis = _basis(errors, found)
    inverse = np.linalg.inv(basis)
    K, C = basis @ errors.gain(found), found.linear[:n].T @ inverse
    D = np.zeros((ny, nu))
    D[:, direct] = found.linear[n : n + len(direct)].T
    u, y = record.input_scales, record.output_scales
    resolvent = basis @ np.linalg.inv(np.eye(n) - _predictor(errors, found)) @ inverse
    closed = np.eye(ny) - C @ resolvent @ K
    level = _level(errors, found, _constant(errors, found))
    shares = np.diff(record.bounds) / record.samples

    def column(dP: Array, dB: Array, dK: Array, dC: Array, dD: Array, dconstant: Array) -> Array:
        dP, dB, dK, dC = basis @ dP @ inverse, basis @ dB, basis @ dK, dC @ inverse
        dA = dP + dK @ C + K @ dC
        dBu = dB + dK @ D + K @ dD
        dfeedback = dC @ resolvent @ K + C @ resolvent @ (dK + dP @ resolvent @ K)
        dlevel = np.linalg.lstsq(closed, dconstant + dfeedback @ level, rcond=None)[0]
        parts = (dA, dBu / u, dC * y[:, None], dD * y[:, None] / u, dK / y, y * dlevel)
        return np.concatenate([part.ravel() for part in parts])

    zero = {
        "dP": np.zeros((n, n)),
        "dB": np.zeros((n, nu)),
        "dK": np.zeros((n, ny)),
        "dC": np.zeros((ny, n)),
        "dD": np.zeros((ny, nu)),
        "dconstant": np.zeros(ny),
    }
    columns = []
    for at in range(layout.dimension):
        change = {name: value.copy() for name, value in zero.items()}
        section, place = divmod(at, layout.pair_length)
        single = section >= layout.pairs
        if single:
            section, place = layout.pairs, at - layout.pairs * layout.pair_length
        first = 2 * section
        if place == 0:
            change["dP"][first, first] = 1.0
            if not single:
                change["dP"][first + 1, first + 1] = 1.0
        elif place == 1 and not single:
            change["dP"][first + 1, first] = 1.0 / found.sections.coupling[section]
        else:
            row, drive = divmod(place - (1 if single else 2), layout.drives)
            if drive < nu:
                change["dB"][first + row, drive] = 1.0
            elif drive < errors.driving:
                change["dK"][first + row, drive - nu] = 1.0
        columns.append(column(**change))
    for output in range(ny):
        for place in range(q):
            change = {name: value.copy() for name, value in zero.items()}
            if place < n:
                change["dC"][output, place] = 1.0
            elif place < n + len(direct):
                change["dD"][output, direct[place - n]] = 1.0
            elif place < n + len(direct) + int(record.levels) * record.records:
                change["dconstant"][output] = shares[place - n - len(direct)]
            columns.append(column(**change))
    return np.array(columns).T


def _constant(errors: StateSpaceErrors, found: Projection) -> Array:
    record = errors.record
    if not record.levels:
        return np.zeros(record.outputs.shape[1])
    return np.asarray(_constants(errors, found).T @ np.diff(record.bounds) / record.samples)


def _constants(errors: StateSpaceErrors, found: Projection) -> Array:
    """Constant of the predictor of each record, (records, ny)."""
    first = errors.order + int(errors.record.feedthrough.sum())
    return np.asarray(found.linear[first : first + errors.record.records])
