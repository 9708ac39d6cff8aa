"""Estimates of several orders of state-space models, and the evidence for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.estimation.state_space.estimate import StateSpaceEstimate, described
from evopem.estimation.state_space.held_out import simulation_errors
from evopem.estimation.state_space.point_model import model_of
from evopem.estimation.state_space.prepared import (
    PreparedRecords,
    halves_of,
    prepared_records,
    problem_of,
)
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH, swept
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.state_space import Form

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OrderScores:
    """Evidence for the order of a state-space model.

    Attributes
    ----------
    orders : tuple of int
    bic : (orders,) array
        Of models of the whole record.
    simulation_error : (orders,) array
        Percent: ``100 ||y - yhat|| / ||y - mean(y)||``, mean over outputs, of simulations of each
        half by the model of the other half, from the initial state that fits.  Infinite where no
        model was found.
    estimates : tuple of StateSpaceEstimate
        Models of the whole record, one for each order.
    """

    orders: tuple[int, ...]
    bic: Array
    simulation_error: Array
    estimates: tuple[StateSpaceEstimate, ...] = field(repr=False)

    def best(self, by: Literal["bic", "simulation"]) -> StateSpaceEstimate:
        """The estimate whose order has the lowest score."""
        scores = self.bic if by == "bic" else self.simulation_error
        return self.estimates[int(np.argmin(scores))]


def sweep_state_space_orders(
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    orders: Sequence[int],
    sampling_rate: float = 1.0,
    *,
    form: Form = "innovations",
    delays: int | Sequence[int] = 1,
    level: bool = True,
    settings: StateSpaceSettings | None = None,
    input_names: Sequence[str] = (),
    output_names: Sequence[str] = (),
    folds: bool = True,
    width: int = FINAL_WIDTH,
    log: Callable[[str], None] | None = None,
) -> OrderScores:
    """Estimate several orders cheaply, each from estimates and from its smaller neighbours.

    Two-fold simulation: models of each half of the samples (of the records, where there are
    several) simulate the other half.  Parameters as in :func:`.estimate_state_space`.

    Parameters
    ----------
    orders : sequence of int
        Ascending, one after the other or every other one.
    folds : bool
        Whether the two-fold simulation errors are computed; else they are NaN.
    width : int
        Estimates of each order that are descended from.
    """
    settings = settings or StateSpaceSettings()
    span = _span(orders)
    with one_blas_thread():
        prepared = prepared_records(inputs, outputs, delays, level, settings.drift_period)
        errors = problem_of(prepared, span[-1], form, settings)
        names = tuple(input_names), tuple(output_names)
        estimates = []
        for problem, found in swept(errors, prepared, span, settings, width, log):
            estimates.append(described(problem, found, prepared, sampling_rate, *names))
        scores = np.full(len(span), np.nan)
        if folds:
            scores = _two_fold_errors(prepared, span, form, settings, width, sampling_rate)
    return OrderScores(
        orders=tuple(span),
        bic=np.array([estimate.bic for estimate in estimates]),
        simulation_error=scores,
        estimates=tuple(estimates),
    )


def estimates_of_orders(
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    orders: Sequence[int],
    *,
    form: Form = "innovations",
    delays: int | Sequence[int] = 1,
    settings: StateSpaceSettings | None = None,
    width: int = FINAL_WIDTH,
    steps: int = STEPS,
    log: Callable[[str], None] | None = None,
) -> Iterator[StateSpaceEstimate]:
    """The estimates of :func:`sweep_state_space_orders`, one after the other as they are needed.

    Parameters
    ----------
    inputs, outputs, orders, form, delays, settings, width, log
        As there; a level is estimated, and the sampling rate is 1 Hz.
    steps : int
        Of each descent at most: too small orders, which do not describe the record, converge
        slowly, and nothing depends on their last digits.
    """
    settings = settings or StateSpaceSettings()
    with one_blas_thread():
        prepared = prepared_records(inputs, outputs, delays, True, settings.drift_period)
        span = _span(orders)
        errors = problem_of(prepared, span[-1], form, settings)
        for problem, found in swept(errors, prepared, span, settings, width, log, steps=steps):
            yield described(problem, found, prepared, 1.0, (), ())


def _span(orders: Sequence[int]) -> range:
    """Orders as a range."""
    steps = {int(step) for step in np.diff(orders)} or {1}
    if len(steps) > 1 or not steps <= {1, 2}:
        raise ValueError(f"orders must ascend in steps of one or of two, not {tuple(orders)}")
    return range(min(orders), max(orders) + 1, steps.pop())


def _two_fold_errors(
    prepared: PreparedRecords,
    orders: range,
    form: str,
    settings: StateSpaceSettings,
    width: int,
    sampling_rate: float,
) -> Array:
    """Simulation error of each order over both halves, percent."""
    halves = halves_of(prepared)
    squares = np.zeros((len(orders), prepared.record.outputs.shape[1]))
    reference = np.zeros(prepared.record.outputs.shape[1])
    seen = np.zeros(len(orders), dtype=int)
    for fold, (train, test) in enumerate((halves, halves[::-1])):
        shared = prepared.delays, prepared.level, settings.drift_period
        half = prepared_records(list(train[0]), list(train[1]), *shared)
        errors = problem_of(half, orders[-1], form, settings)
        power = np.array([[np.sum((y - y.mean(axis=0)) ** 2, axis=0)] for y in test[1]])[:, 0]
        reference += power.sum(axis=0)
        for problem, found in swept(errors, half, orders, settings, width, None, 1 + fold):
            own = problem.projection(found.point)
            model = model_of(problem.errors, own, sampling_rate, half.shifts, (), ())
            at = orders.index(problem.errors.order)
            seen[at] += 1
            for u, y, each in zip(*test, power, strict=True):
                squares[at] += (simulation_errors(model, u, y) / 100.0) ** 2 * each
    relative = 100.0 * np.sqrt(squares / reference).mean(axis=1)
    return np.where(seen == 2, relative, np.inf)
