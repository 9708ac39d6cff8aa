"""Estimates of one state-space problem: next to a model, of ascending orders, in full."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Self, get_args

import numpy as np

from evopem.arrays import Array, one_blas_thread
from evopem.config.settings import OutputWeighting, SearchSettings
from evopem.errors import LostModelError, NoModelError
from evopem.estimation.criteria import (
    autoregression_of,
    check_returned,
    lies_at_bound,
    limited,
    log_loss,
)
from evopem.estimation.damped_descent import SWEEP_WIDTH, Optimum
from evopem.estimation.polynomial_estimate import ConstraintEffect
from evopem.estimation.prediction_errors import check_search_settings
from evopem.estimation.search.problem import Log, SearchResult
from evopem.estimation.state_space.entry_problem import EntryProblem
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.point_model import ScaledModel
from evopem.estimation.state_space.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    StateSpaceProblem,
)
from evopem.estimation.state_space.scaled_recording import scaled_recording
from evopem.estimation.state_space.search import (
    FINAL_WIDTH,
    NO_MODELS,
    continued,
    likeliest_order,
    problem_for,
    result_of,
    rough_tolerance,
    swept,
)
from evopem.estimation.state_space.starting_points import point_of_model
from evopem.models.state_space import PlainStructure, StateSpaceModel, StateSpaceStructure
from evopem.signals.recording import Recording

STRUCTURES, WEIGHTINGS = get_args(StateSpaceStructure), get_args(OutputWeighting)
QUADRATIC = SearchSettings(objective="quadratic")
# Periods of the drift of structure ss_oe_drift in the longest segment, the shortest one.
DRIFT_PERIODS = 5
# Steps of a round of a race of descents, and how many take them.
ROUNDS = ((10, 4), (15, 2))
MOST_LOST = 2  # orders in a row that are lost in rounding at which a sweep ends


@dataclass(frozen=True)
class StateSpaceTask:
    """Form, delays, level, weighting of the outputs, and settings of a search."""

    structure: PlainStructure = "ss"
    delays: int | tuple[int, ...] = 1
    level: bool = True
    weighting: OutputWeighting = "determinant"
    settings: SearchSettings = QUADRATIC
    drift_period: float | None = None
    forgets: bool = False  # as of StateSpaceErrors
    covariances: bool = True  # of estimates, which comparisons need none of

    def __post_init__(self) -> None:
        check_search_settings(self.settings)
        if self.weighting not in WEIGHTINGS:
            raise ValueError(f"weighting must be one of {WEIGHTINGS}, not {self.weighting!r}")

    @classmethod
    def of(
        cls,
        recording: Recording,
        structure: StateSpaceStructure,
        delays: int | Sequence[int],
        **options: Any,
    ) -> Self:
        """The task of a structure.

        Scores on held-out samples, with a level each, do not count the drift of ``ss_oe_drift``.
        """
        if structure not in STRUCTURES:
            raise ValueError(f"structure must be one of {STRUCTURES}, not {structure!r}")
        return cls(
            "ss" if structure in ("ss", "ss_bj") else "ss_oe",
            delays if isinstance(delays, int) else tuple(delays),
            drift_period=recording.longest.samples / DRIFT_PERIODS
            if structure == "ss_oe_drift"
            else None,
            **options,
        )

    def errors(self, recording: Recording, order: int) -> StateSpaceErrors:
        """The problem of an order; ValueError when the recording is too short or unusable."""
        data = scaled_recording(recording, self.delays, self.level, self.drift_period)
        if order < 1:
            raise ValueError(f"order must be at least 1, not {order}")
        if self.structure == "ss_oe" and not recording.has_input:
            raise ValueError(
                "an output-error model needs an input; without one, use innovations form"
            )
        radius = self.settings.max_root_radius
        errors = StateSpaceErrors(data, order, self.structure, self.weighting, radius, self.forgets)
        needed = errors.estimated
        available = data.outputs.size
        if available <= needed or data.samples <= 2 * (order + data.inputs.shape[1]) + 2:
            raise NoModelError(
                f"order {order} needs more than {needed} output values for its parameters and"
                f" initial states; the recording has {available}"
            )
        return errors


@dataclass(frozen=True, eq=False)
class StateSpaceEstimate:
    """An estimated model, its criteria, and the search that reached it.

    Attributes
    ----------
    model : StateSpaceModel
        With the covariance of its entries.
    order : int
        That was asked for: of structure ``ss_bj`` the states of the plant alone.
    objective : float
        Percent of the power of the outputs, y less its mean where a level is estimated: geometric
        mean over principal directions (``determinant``) or outputs (``noise``), arithmetic mean
        (``power``).  Of the absolute objective percent of the mean absolute outputs: geometric
        mean over outputs, or for ``power`` their sum.
    fit_percent : (l,) array
        ``100 (1 - ||e|| / ||y - mean(y)||)`` of each output.
    bic : float
        ``ln det(cov e) + p ln(N) / N`` with p independent parameters; outputs in their units.  Of
        the absolute objective twice the sum of the logarithms of mean absolute errors takes the
        place of the determinant.
    coloured_bic : float
        The same of the innovations of a vector autoregression of the errors, whose coefficients
        are counted as parameters: it compares models with and without a noise model.
    parameters : int
        Independent ones, with the level.
    residuals : tuple of (N, l) arrays
        One for each segment; NaN at first samples whose delayed inputs are not known.
    initial_states : (segments, n) array
        State of the model at the first residual of each segment.
    segment_levels : (segments, l) array
        Level of each segment; the model has their mean, weighed by samples.
    at_stability_bound : bool
        Whether an eigenvalue of A or of ``A - K C`` lies at the largest radius allowed.
    search : SearchResult
    focus : {"prediction", "simulation"} or int
        Errors that are small: of one step, of simulation, or of so many steps.
    focus_objective : float, optional
        As ``objective``, of the errors in focus, where these are not those of one step.
    constraints : ConstraintEffect, optional
        What the constraints took; None without any.
    """

    model: StateSpaceModel
    order: int
    objective: float
    fit_percent: Array
    bic: float
    coloured_bic: float
    parameters: int
    residuals: tuple[Array, ...] = field(repr=False)
    initial_states: Array = field(repr=False)
    segment_levels: Array = field(repr=False)
    at_stability_bound: bool
    search: SearchResult = field(repr=False)
    focus: str | int = "prediction"
    focus_objective: float | None = None
    constraints: ConstraintEffect | None = None

    @property
    def plant_states(self) -> int:
        """Number of states: a noise model beside the plant is no part of an estimate."""
        return self.model.order


def plain_estimates(
    recording: Recording,
    orders: Sequence[int],
    task: StateSpaceTask,
    width: int = FINAL_WIDTH,
    steps: int = STEPS,
    starts: Mapping[int, StateSpaceModel] = NO_MODELS,
    log: Log | None = None,
    below: int | None = None,
) -> Iterator[StateSpaceEstimate]:
    """Estimates of several orders with K or without; see :func:`.estimates_of_orders`.

    With ``below`` they begin so many states below the likeliest estimate by linear algebra.  They
    end where two orders in a row are lost in rounding: larger ones are as well.
    """
    with one_blas_thread():
        orders = sorted(orders)
        errors, lost = task.errors(recording, orders[-1]), 0
        if below is not None:
            least = likeliest_order(errors, orders) - below
            orders = [order for order in orders if order >= least]
        for problem, result in swept(errors, orders, task.settings, width, log, steps, starts):
            try:
                estimate = described(problem, result, task.covariances)
            except LostModelError:
                lost += 1
                if lost == MOST_LOST:
                    return
                continue
            lost = 0
            yield estimate


def descend_from(
    model: StateSpaceModel, recording: Recording, task: StateSpaceTask
) -> StateSpaceEstimate:
    """The optimum of a model's order and form that a descent from it ends at.

    ValueError when the recording is too short, or the descent ends at no stable model.
    """
    with one_blas_thread():
        reached = _descended_from(model, recording, task, POLISH_STEPS, POLISH_TOLERANCE)
        return described(*reached, task.covariances)


def best_descent(
    models: Sequence[StateSpaceModel], recording: Recording, task: StateSpaceTask, steps: int
) -> StateSpaceEstimate:
    """The optimum that the best of descents from models of any orders ends at, for squares by BIC.

    The next one follows where it ends at no stable model.  ValueError when the recording is too
    short, or that is so of each of them.
    """
    raced, tolerance = [], POLISH_TOLERANCE if steps > STEPS else TOLERANCE
    with one_blas_thread():
        for model in models:
            errors = task.errors(recording, model.order)
            raced.append((errors, Optimum(point_of_model(model, errors), np.inf, False, 0)))
        for some, many in ROUNDS if task.settings.objective == "quadratic" else ():
            raced[:many] = [(of, continued(of, at, some, TOLERANCE)) for of, at in raced[:many]]
            raced.sort(key=_bic)
        for errors, at in raced:
            problem = problem_for(errors, task.settings)
            start = problem.completed(at.point)[None, :]
            reached = problem.descents(start, steps, tolerance, SWEEP_WIDTH)
            if np.isfinite(reached.values[0]):
                with suppress(LostModelError):
                    return described(problem, result_of(reached, at.evaluations), task.covariances)
    raise NoModelError("no descent ended at a stable model")


def _bic(descent: tuple[StateSpaceErrors, Optimum]) -> float:
    """That of squared errors, less what is the same for all orders."""
    (errors, reached), samples = descent, descent[0].data.samples
    size = errors.data.outputs.shape[1] * np.log(errors.percent(reached.value))
    return float(size + errors.parameters * np.log(samples) / samples)


def refitted(
    model: StateSpaceModel, recording: Recording, task: StateSpaceTask, steps: int = STEPS
) -> StateSpaceModel:
    """The optimum of another recording, as far as a choice depends on it, the model alone.

    Raises as :func:`descend_from`.
    """
    with one_blas_thread():
        problem, result = _descended_from(model, recording, task, steps)
        return problem.scaled(result.point).model()


def _descended_from(
    model: StateSpaceModel,
    recording: Recording,
    task: StateSpaceTask,
    steps: int,
    tolerance: float | None = None,
) -> tuple[StateSpaceProblem, SearchResult]:
    errors = replace(task, structure=model.structure).errors(recording, model.order)
    problem = problem_for(errors, task.settings)
    start = problem.completed(point_of_model(model, errors))
    # A descent that began with an unstable A may need its last steps to leave it.
    for limit in (rough_tolerance(errors), TOLERANCE) if tolerance is None else (tolerance,):
        result = result_of(problem.descents(start[None, :], steps, limit, SWEEP_WIDTH))
        if np.isfinite(result.value):
            return problem, result
    raise NoModelError("the descent found no stable model")


def described(
    problem: StateSpaceProblem | EntryProblem, result: SearchResult, covariance: bool = True
) -> StateSpaceEstimate:
    """The model at a search's best point, with criteria, residuals and, if asked, covariance."""
    scaled = problem.scaled(result.point)
    model = scaled.model()
    if covariance:
        model = replace(model, covariance=problem.covariance(result.point))
    radius = float(np.abs(np.concatenate([model.poles(), model.noise_zeros()])).max())
    levels = scaled.levels()
    _check(problem.plain, scaled, replace(model, level=levels[0]))
    return StateSpaceEstimate(
        model=model,
        order=model.order,
        objective=result.value,
        initial_states=scaled.initial_states(),
        segment_levels=levels,
        search=result,
        at_stability_bound=lies_at_bound(radius, problem.plain.radius),
        **criteria_of(problem.plain, scaled.one_step, problem.parameters, problem.objective),
    )


def _check(errors: StateSpaceErrors, scaled: ScaledModel, model: StateSpaceModel) -> None:
    """Compare the errors of a returned model with those of its search, in the first segment."""
    data, drift = errors.data, scaled.matrices.outputs[:, errors.level_columns.stop :]
    segment, count = data.recording.segments[0], data.bounds[1]
    outputs = segment.outputs.copy()
    outputs[len(outputs) - count :] -= (data.drift[:count] @ drift.T) * data.output_scales
    one_step = scaled.one_step[:count] * data.output_scales
    check_returned(model, segment.inputs, outputs, one_step, f"model of {model.order} states")


def criteria_of(
    errors: StateSpaceErrors, one_step: Array, parameters: int, objective: str
) -> dict[str, Any]:
    """Fit, BICs and residuals of an estimate, from the (N, l) errors of the scaled recording."""
    data = errors.data
    y, e = data.outputs * data.output_scales, one_step * data.output_scales
    spread = np.linalg.norm(y - y.mean(axis=0), axis=0)
    fit = 100.0 * (1.0 - np.linalg.norm(e, axis=0) / np.where(spread > 0.0, spread, np.nan))
    penalty = parameters * np.log(data.samples) / data.samples
    whitened = autoregression_of(limited(e) if objective == "absolute" else e, data.bounds)
    unknown = np.full((max(data.shifts, default=0), e.shape[1]), np.nan)
    residuals = (np.vstack([unknown, e[first:stop]]) for first, stop in pairwise(data.bounds))
    return {
        "fit_percent": fit,
        "bic": log_loss(e, objective) + float(penalty),
        "coloured_bic": float(whitened.bic + penalty),
        "parameters": parameters,
        "residuals": tuple(residuals),
    }
