"""Records of several channels, checked and scaled, and the problem of an order and a form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.estimation.state_space.errors import WEIGHTINGS, StateSpaceErrors
from evopem.estimation.state_space.scaled_record import StateSpaceRecord, state_space_record
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.state_space import Form

Array = NDArray[np.float64]
Half = tuple[tuple[Array, ...], tuple[Array, ...]]

FORMS: tuple[Form, ...] = ("innovations", "output_error")
OBJECTIVES = ("quadratic", "absolute")


@dataclass(frozen=True, eq=False)
class PreparedRecords:
    """Records as arrays, with the choices that they were prepared by."""

    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    delays: tuple[int, ...]
    level: bool
    record: StateSpaceRecord

    @property
    def shifts(self) -> tuple[int, ...]:
        """Samples by which each input is shifted."""
        return tuple(max(delay - 1, 0) for delay in self.delays)


def prepared_records(
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    delays: int | Sequence[int],
    level: bool,
    drift_period: float | None = None,
) -> PreparedRecords:
    """Check records, delays and level, and scale the signals.

    Raises
    ------
    ValueError
    """
    us, ys = paired_records(inputs, outputs)
    if len({u.shape[1] for u in us}) > 1 or len({y.shape[1] for y in ys}) > 1:
        raise ValueError("all records must have the same channels")
    nu = us[0].shape[1]
    each = (delays,) * nu if isinstance(delays, int) else tuple(delays)
    if len(each) != nu or any(delay < 0 for delay in each):
        raise ValueError(f"{nu} inputs need {nu} delays of at least 0, not {each}")
    shortest = min(len(y) for y in ys)
    if shortest <= max(each, default=0) + 10:
        raise ValueError(f"a record of {shortest} samples is too short")
    if any(not np.any(y) for y in np.concatenate(ys).T):
        raise ValueError("an output is zero throughout")
    record = state_space_record(us, ys, each, level, drift_period)
    return PreparedRecords(tuple(us), tuple(ys), each, level, record)


def paired_records(
    inputs: ArrayLike | Sequence[ArrayLike] | None, outputs: ArrayLike | Sequence[ArrayLike]
) -> tuple[list[Array], list[Array]]:
    """Inputs, (N, nu), and outputs, (N, ny), of each record; nu = 0 for no inputs.

    Raises
    ------
    ValueError
    """
    ys = records_of(outputs, "outputs")
    us = [np.empty((len(y), 0)) for y in ys] if inputs is None else records_of(inputs, "inputs")
    if len(us) != len(ys) or any(len(u) != len(y) for u, y in zip(us, ys, strict=True)):
        raise ValueError("inputs and outputs must have the same records, of the same lengths")
    return us, ys


def records_of(signals: ArrayLike | Sequence[ArrayLike], what: str) -> list[Array]:
    """One (N, channels) array for each record."""
    if isinstance(signals, np.ndarray) or not isinstance(signals, list | tuple):
        arrays = [np.asarray(signals, dtype=float)]
    else:
        arrays = [np.asarray(signal, dtype=float) for signal in signals]
        if all(array.ndim < 2 for array in arrays):
            arrays = [np.asarray(signals, dtype=float)]
    arrays = [array[:, None] if array.ndim == 1 else array for array in arrays]
    for array in arrays:
        if array.ndim != 2:
            raise ValueError(f"{what} must be (N, channels), not {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{what} must be finite")
    return arrays


def problem_of(
    prepared: PreparedRecords, order: int, form: str, settings: StateSpaceSettings
) -> StateSpaceErrors:
    """The prediction-error problem of an order and a form.

    Raises
    ------
    ValueError
        When the record is too short for the order, or a setting is outside its range.
    """
    record = prepared.record
    if form not in FORMS:
        raise ValueError(f"form must be one of {FORMS}, not {form!r}")
    if settings.weighting not in WEIGHTINGS:
        raise ValueError(f"weighting must be one of {WEIGHTINGS}, not {settings.weighting!r}")
    if settings.objective not in OBJECTIVES:
        raise ValueError(f"objective must be one of {OBJECTIVES}, not {settings.objective!r}")
    if not 0.0 < settings.max_root_radius < 1.0:
        raise ValueError(
            f"max_root_radius must lie between 0 and 1, not {settings.max_root_radius}"
        )
    if order < 1:
        raise ValueError(f"order must be at least 1, not {order}")
    if form == "output_error" and record.inputs.shape[1] == 0:
        raise ValueError("an output-error model needs an input; without one, use innovations form")
    errors = StateSpaceErrors(record, order, form, settings.weighting, settings.max_root_radius)
    needed = errors.parameters + order * record.records
    available = record.samples * record.outputs.shape[1]
    if available <= needed or record.samples <= 2 * (order + record.inputs.shape[1]) + 2:
        raise ValueError(
            f"order {order} needs more than {needed} output values for its parameters and initial "
            f"states; the record has {available}"
        )
    return errors


def halves_of(prepared: PreparedRecords) -> tuple[Half, Half]:
    """Two parts of the samples: half of the records, or both halves of a single one."""
    us, ys = prepared.inputs, prepared.outputs
    if len(ys) > 1:
        middle = len(ys) // 2
        return (us[:middle], ys[:middle]), (us[middle:], ys[middle:])
    middle = len(ys[0]) // 2
    return (
        ((us[0][:middle],), (ys[0][:middle],)),
        ((us[0][middle:],), (ys[0][middle:],)),
    )
