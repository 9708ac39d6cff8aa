"""The model of a point: its matrices in the units of the record, and its initial states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.sections import state_matrix
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# Condition of the states' responses at the outputs, scaled to one, above which another basis of the
# states is taken, and doublings of the number of samples that they are seen over.
ILL_CONDITIONED, DOUBLINGS = 1e4, 20


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
    degrees = degrees_of_freedom(errors)
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
    drives = basis_of(errors, found) @ errors.drive_matrix(found)[:, errors.driving :]
    offset = (levels - record.output_offsets) / record.output_scales
    P = model.predictor
    steady = np.linalg.lstsq(
        np.eye(len(P)) - P, model.K @ (offset * record.output_scales).T, rcond=None
    )[0]
    return drives.T - steady.T, levels


def degrees_of_freedom(errors: StateSpaceErrors) -> float:
    """Samples less the estimates for each output."""
    ny = errors.record.outputs.shape[1]
    estimated = (errors.parameters + errors.order * errors.record.records) / ny
    return float(max(errors.record.samples - estimated, 1.0))


def _matrices(errors: StateSpaceErrors, found: Projection) -> tuple[Array, ...]:
    """A, B, C, D, K and level in the units of the record."""
    record, n = errors.record, errors.order
    nu, ny = record.inputs.shape[1], record.outputs.shape[1]
    direct = int(record.feedthrough.sum())
    linear = found.linear
    C, D = linear[:n].T, np.zeros((ny, nu))
    D[:, record.feedthrough] = linear[n : n + direct].T
    basis = basis_of(errors, found)
    inverse = np.linalg.inv(basis)
    C, K = C @ inverse, basis @ errors.gain(found)
    A = basis @ predictor_of(errors, found) @ inverse + K @ C
    B = basis @ errors.drive_matrix(found)[:, :nu] + K @ D
    level = level_of(errors, found, constant_of(errors, found))
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
    levels = np.array([level_of(errors, found, constant) for constant in _constants(errors, found)])
    return np.asarray(record.output_offsets + record.output_scales * levels)


def level_of(errors: StateSpaceErrors, found: Projection, constant: Array) -> Array:
    """Mean of scaled outputs at rest from the constant of the predictor."""
    if not errors.innovations:
        return constant
    return np.asarray(
        np.linalg.lstsq(np.eye(len(constant)) - _feedback(errors, found), constant, rcond=None)[0]
    )


def _feedback(errors: StateSpaceErrors, found: Projection) -> Array:
    """What the predictor adds to its prediction for constant outputs, (ny, ny)."""
    A = predictor_of(errors, found)
    C = found.linear[: errors.order].T
    return np.asarray(C @ np.linalg.solve(np.eye(len(A)) - A, errors.gain(found)))


def predictor_of(errors: StateSpaceErrors, found: Projection) -> Array:
    """A - K C in the states of the sections, (n, n)."""
    return state_matrix(found.sections, errors.layout)


def basis_of(errors: StateSpaceErrors, found: Projection) -> Array:
    """The states of the model from those of the sections, (n, n).

    The same ones, unless sections with nearly equal poles cancel each other: entries of A and C
    would be so large that rounding spoils simulations.  The model then has states whose responses
    at the outputs are orthonormal (output-normal form).
    """
    P, C = predictor_of(errors, found), found.linear[: errors.order].T
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


def constant_of(errors: StateSpaceErrors, found: Projection) -> Array:
    """Mean constant of the predictor over all samples, (ny,)."""
    record = errors.record
    if not record.levels:
        return np.zeros(record.outputs.shape[1])
    return np.asarray(_constants(errors, found).T @ np.diff(record.bounds) / record.samples)


def _constants(errors: StateSpaceErrors, found: Projection) -> Array:
    """Constant of the predictor of each record, (records, ny)."""
    first = errors.order + int(errors.record.feedthrough.sum())
    return np.asarray(found.linear[first : first + errors.record.records])
