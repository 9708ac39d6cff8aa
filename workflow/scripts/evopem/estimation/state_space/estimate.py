"""Estimate state-space models with several inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.likelihood import log_loss
from evopem.estimation.state_space.noise_colour import autoregression_of
from evopem.estimation.state_space.point_model import initial_states, model_of
from evopem.estimation.state_space.prepared import PreparedRecords, prepared_records, problem_of
from evopem.estimation.state_space.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    StateSpaceProblem,
)
from evopem.estimation.state_space.search import generator_of, problem_for, searched
from evopem.estimation.state_space.sections import largest_radius
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.estimation.state_space.starting_points import from_matrices
from evopem.models.state_space import Form, StateSpaceModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpaceEstimate:
    """An estimated model, its criteria, and the search that found it.

    Attributes
    ----------
    model : StateSpaceModel
        With the covariance of its entries.
    objective : float
        Percent of the power of the outputs, y less its mean where a level is estimated: geometric
        mean over principal directions (``determinant``) or outputs (``noise``), arithmetic mean
        (``power``).  Of the absolute objective percent of the mean absolute outputs: geometric
        mean over outputs, or for ``power`` their sum.
    fit_percent : (ny,) array
        ``100 (1 - ||e|| / ||y - mean(y)||)`` of each output.
    bic : float
        ``ln det(cov e) + p ln(N) / N`` with p independent parameters; outputs in their units.  Of
        the absolute objective twice the sum of the logarithms of mean absolute errors takes the
        place of the determinant.
    coloured_bic : float
        The same of the innovations of a vector autoregression of the errors, whose coefficients
        are counted as parameters: it compares models with and without a noise model.
    residuals : tuple of (N, ny) arrays
        One for each record; NaN at first samples whose delayed inputs are not known.
    initial_states : (records, n) array
        State of the model at the first residual of each record.
    record_levels : (records, ny) array
        Level of each record; the model has their mean, weighed by samples.
    at_stability_bound : bool
        Whether an eigenvalue of A or of ``A - K C`` lies at the largest radius allowed.
    search : SearchResult
    """

    model: StateSpaceModel
    objective: float
    fit_percent: Array
    bic: float
    coloured_bic: float
    residuals: tuple[Array, ...] = field(repr=False)
    initial_states: Array = field(repr=False)
    record_levels: Array = field(repr=False)
    at_stability_bound: bool
    search: SearchResult = field(repr=False)

    @property
    def plant_states(self) -> int:
        """Number of states: a noise model beside the plant is no part of an estimate."""
        return self.model.order


def estimate_state_space(
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    order: int,
    sampling_rate: float = 1.0,
    *,
    form: Form = "innovations",
    delays: int | Sequence[int] = 1,
    level: bool = True,
    settings: StateSpaceSettings | None = None,
    starts: Sequence[StateSpaceModel] = (),
    input_names: Sequence[str] = (),
    output_names: Sequence[str] = (),
    log: Callable[[str], None] | None = None,
) -> StateSpaceEstimate:
    """Find the state-space model of an order with the smallest prediction errors.

    Parameters
    ----------
    inputs : (N, nu) array_like, or a list of them
        One record or several; not modified.  None without inputs: output-only identification.
    outputs : (N, ny) array_like, or a list of them
    order : int
        Number of states n.
    sampling_rate : float
        Hz.
    form : {"innovations", "output_error"}
        With a noise model K, or with K = 0: errors of the simulation.
    delays : int or sequence of int
        nk of all inputs or of each: 0 for an input with a column of D, 1 for one without, k > 1
        for one that acts k samples later.
    level : bool
        Whether a constant output is estimated, for each record.
    settings : StateSpaceSettings, optional
        The draws come from ``SeedSequence(seed, spawn_key=(order, form, level, *delays))``.
    starts : sequence of StateSpaceModel
        Models of this order, form and delays that are among the points to descend from, such as
        those of a search over orders.  A very large problem has no others then.
    input_names, output_names : sequences of str, optional
    log : callable, optional
        Receives one line for each step of the search.

    Raises
    ------
    ValueError
        When the record is too short for the order, or a setting is outside its range.

    Examples
    --------
    >>> generator = np.random.default_rng(1)
    >>> u = generator.standard_normal((500, 1))
    >>> truth = StateSpaceModel(
    ...     A=np.array([[0.9, 0.3], [-0.3, 0.9]]), B=np.array([[1.0], [0.5]]), C=np.eye(2),
    ...     D=np.zeros((2, 1)), K=np.zeros((2, 2)), sampling_rate=10.0, level=np.zeros(2),
    ...     noise_covariance=np.eye(2), form="output_error",
    ... )
    >>> y = truth.simulate(u) + 0.1 * generator.standard_normal((500, 2))
    >>> found = estimate_state_space(u, y, 2, 10.0, form="output_error")
    >>> (mode,) = found.model.modes()
    >>> round(mode.frequency_hz, 2), round(mode.damping_ratio, 2)
    (0.52, 0.16)
    """
    settings = settings or StateSpaceSettings()
    with one_blas_thread():
        prepared = prepared_records(inputs, outputs, delays, level, settings.drift_period)
        errors = problem_of(prepared, order, form, settings)
        generator = generator_of(settings, order, form, prepared)
        points = [_point_of(each, errors) for each in starts]
        problem, found = searched(errors, points, generator, settings, log)
        return described(
            problem, found, prepared, sampling_rate, tuple(input_names), tuple(output_names)
        )


def descend_from(
    model: StateSpaceModel,
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    sampling_rate: float = 1.0,
    *,
    delays: int | Sequence[int] = 1,
    settings: StateSpaceSettings | None = None,
    input_names: Sequence[str] = (),
    output_names: Sequence[str] = (),
) -> StateSpaceEstimate:
    """The optimum of a model's form that a descent from it ends at.

    Parameters
    ----------
    model : StateSpaceModel
        In the units of the records, with the same delays.
    inputs, outputs, delays, settings, input_names, output_names
        As of :func:`estimate_state_space`; a level is estimated.
    sampling_rate : float
        Hz.

    Raises
    ------
    ValueError
        When the records are too short, or the descent finds no stable model.
    """
    settings = settings or StateSpaceSettings()
    with one_blas_thread():
        prepared = prepared_records(inputs, outputs, delays, True, settings.drift_period)
        problem, found = _descended_from(model, prepared, settings, POLISH_STEPS, POLISH_TOLERANCE)
        names = tuple(input_names), tuple(output_names)
        return described(problem, found, prepared, sampling_rate, *names)


def refitted(
    model: StateSpaceModel,
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    *,
    delays: int | Sequence[int] = 1,
    settings: StateSpaceSettings | None = None,
    steps: int = STEPS,
) -> StateSpaceModel:
    """The same optimum of other records: as :func:`descend_from`, the model alone.

    Parameters
    ----------
    model, inputs, outputs, delays, settings
        As there.
    steps : int
        As of :func:`.estimates_of_orders`.

    Raises
    ------
    ValueError
        As there.
    """
    settings = settings or StateSpaceSettings()
    with one_blas_thread():
        prepared = prepared_records(inputs, outputs, delays, True, settings.drift_period)
        problem, found = _descended_from(model, prepared, settings, steps, TOLERANCE)
        projection = problem.projection(found.point)
        return model_of(problem.errors, projection, model.sampling_rate, prepared.shifts, (), ())


def _descended_from(
    model: StateSpaceModel,
    prepared: PreparedRecords,
    settings: StateSpaceSettings,
    steps: int,
    tolerance: float,
) -> tuple[StateSpaceProblem, SearchResult]:
    errors = problem_of(prepared, model.order, model.form, settings)
    problem = problem_for(errors, settings)
    start = problem.completed(_point_of(model, errors))
    found = problem.descents(start[None, :], steps, tolerance)
    value = float(found.values[0])
    if not np.isfinite(value):
        raise ValueError("the descent found no stable model")
    diagnostics = SearchDiagnostics.of_descents(value, found.evaluations, 1)
    return problem, SearchResult(found.points[0], value, diagnostics)


def _point_of(model: StateSpaceModel, errors: StateSpaceErrors) -> Array:
    """The point of a problem that a model of its order, form and delays is."""
    drives = (model.B - model.K @ model.D) * errors.record.input_scales
    if errors.innovations:
        drives = np.column_stack([drives, model.K * errors.record.output_scales])
    return from_matrices(errors, model.predictor, drives)


def described(
    problem: StateSpaceProblem,
    result: SearchResult,
    prepared: PreparedRecords,
    sampling_rate: float,
    input_names: tuple[str, ...],
    output_names: tuple[str, ...],
) -> StateSpaceEstimate:
    """The model at a search's best point, with criteria, residuals and covariance."""
    errors, found = problem.errors, problem.projection(result.point)
    model = model_of(errors, found, sampling_rate, prepared.shifts, input_names, output_names)
    model = replace(model, covariance=problem.covariance(found))
    record = errors.record
    y = record.outputs * record.output_scales
    e = found.errors * record.output_scales
    spread = np.linalg.norm(y - y.mean(axis=0), axis=0)
    fit = 100.0 * (1.0 - np.linalg.norm(e, axis=0) / np.where(spread > 0.0, spread, np.nan))
    penalty = errors.parameters * np.log(record.samples) / record.samples
    whitened = autoregression_of(problem.limited(e), record.bounds)
    lost = max(prepared.shifts, default=0)
    residuals = []
    for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
        unknown = np.full((lost, e.shape[1]), np.nan)
        residuals.append(np.vstack([unknown, e[first:stop]]))
    states, levels = initial_states(errors, found, model)
    coordinates = problem.coordinates(result.point)
    radius = max(largest_radius(errors.layout, coordinates), float(np.abs(model.poles()).max()))
    return StateSpaceEstimate(
        model=model,
        objective=result.value,
        fit_percent=fit,
        bic=log_loss(e, problem.objective) + float(penalty),
        coloured_bic=float(whitened.bic + penalty),
        residuals=tuple(residuals),
        initial_states=states,
        record_levels=levels,
        at_stability_bound=lies_at_bound(radius, errors.radius),
        search=result,
    )
