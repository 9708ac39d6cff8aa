"""Estimate state-space models with several inputs and outputs, and choose their order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.config.settings import SearchSettings
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.search.certificate import AGREEING
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.state_space.covariance import (
    initial_states,
    model_of,
    parameter_covariance,
)
from evopem.estimation.state_space.errors import (
    WEIGHTINGS,
    StateSpaceErrors,
    StateSpaceRecord,
    state_space_record,
)
from evopem.estimation.state_space.levenberg_marquardt import Optimum, descend
from evopem.estimation.state_space.noise_colour import autoregression_of
from evopem.estimation.state_space.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    StartingModels,
    StateSpaceProblem,
    converted,
    descended,
    extensions,
    rungs,
)
from evopem.estimation.state_space.sections import largest_radius
from evopem.estimation.state_space.starting_points import from_matrices
from evopem.models.state_space import Form, StateSpaceModel

Array = NDArray[np.float64]
Weighting = Literal["determinant", "noise", "power"]

FORMS: tuple[Form, ...] = ("innovations", "output_error")
# Multiplications of one evaluation from which on a search only descends from estimates, and those
# that a whole search may take.
HEAVY, BUDGET = 1e9, 1e11
LEAST_EVALUATIONS, MOST_EVALUATIONS = 500, 8000
# Estimates of each order that are descended from on the way to a larger order, and for the order
# itself.
WIDTH, FINAL_WIDTH = 3, 8
# Optima of the other form that are descended from.
CROSSED = 2
# Restarts that must agree before the multistart check, which is one more: a certificate needs so
# many where there are many optima, as there are nearly always.
AGREEING_BEFORE_CHECK = AGREEING[-1][1] - 1


@dataclass(frozen=True)
class StateSpaceSettings:
    """Settings of the search for one state-space model.

    Attributes
    ----------
    weighting : {"determinant", "noise", "power"}
        ``determinant`` of the errors' covariance (maximum likelihood for white errors), each
        output by its own ``noise`` (the product of the variances), or by its ``power`` (the sum
        of the relative variances).
    max_root_radius : float
        Largest radius of the eigenvalues of A and of ``A - K C``.
    seed : int
        Seed of every random draw.
    evaluations : int, optional
        Evaluations after which no new generation starts; by default by the size of the problem.
        0 for descents from estimates alone.
    """

    weighting: Weighting = "determinant"
    max_root_radius: float = 0.9999
    seed: int = 1
    evaluations: int | None = None


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
        (``power``).
    fit_percent : (ny,) array
        ``100 (1 - ||e|| / ||y - mean(y)||)`` of each output.
    bic : float
        ``ln det(cov e) + p ln(N) / N`` with p independent parameters; outputs in their units.
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
    with threadpool_limits(limits=1, user_api="blas"):
        prepared = _prepared(inputs, outputs, delays, level)
        errors = _errors(prepared, order, form, settings)
        generator = _generator(settings, order, form, prepared)
        points = [_point_of(each, errors) for each in starts]
        found = _searched(errors, points, generator, settings, log)
        return _described(
            errors, found, prepared, sampling_rate, tuple(input_names), tuple(output_names)
        )


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
    several) simulate the other half.  Parameters as in :func:`estimate_state_space`.

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
    with threadpool_limits(limits=1, user_api="blas"):
        prepared = _prepared(inputs, outputs, delays, level)
        errors = _errors(prepared, span[-1], form, settings)
        names = tuple(input_names), tuple(output_names)
        estimates = []
        for problem, found in _swept(errors, prepared, span, settings, width, log):
            estimates.append(_described(problem, found, prepared, sampling_rate, *names))
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
    with threadpool_limits(limits=1, user_api="blas"):
        prepared = _prepared(inputs, outputs, delays, True)
        span = _span(orders)
        errors = _errors(prepared, span[-1], form, settings)
        for problem, found in _swept(errors, prepared, span, settings, width, log, steps=steps):
            yield _described(problem, found, prepared, 1.0, (), ())


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
    with threadpool_limits(limits=1, user_api="blas"):
        prepared = _prepared(inputs, outputs, delays, True)
        errors, found = _descended_from(model, prepared, settings, POLISH_STEPS, POLISH_TOLERANCE)
        names = tuple(input_names), tuple(output_names)
        return _described(errors, found, prepared, sampling_rate, *names)


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
        As of :func:`estimates_of_orders`.

    Raises
    ------
    ValueError
        As there.
    """
    settings = settings or StateSpaceSettings()
    with threadpool_limits(limits=1, user_api="blas"):
        prepared = _prepared(inputs, outputs, delays, True)
        errors, found = _descended_from(model, prepared, settings, steps, TOLERANCE)
        projection = errors.projection(found.point)
        return model_of(errors, projection, model.sampling_rate, prepared.shifts, (), ())


def _descended_from(
    model: StateSpaceModel,
    prepared: _Prepared,
    settings: StateSpaceSettings,
    steps: int,
    tolerance: float,
) -> tuple[StateSpaceErrors, SearchResult]:
    errors = _errors(prepared, model.order, model.form, settings)
    found = descend(errors, _point_of(model, errors), steps, tolerance)
    if not np.isfinite(found.criterion):
        raise ValueError("the descent found no stable model")
    value = errors.percent(found.criterion)
    diagnostics = _without_generations(value, found.evaluations, 1)
    return errors, SearchResult(found.point, value, diagnostics)


def _point_of(model: StateSpaceModel, errors: StateSpaceErrors) -> Array:
    """The point of a problem that a model of its order, form and delays is."""
    drives = (model.B - model.K @ model.D) * errors.record.input_scales
    if errors.innovations:
        drives = np.column_stack([drives, model.K * errors.record.output_scales])
    return from_matrices(errors, model.predictor, drives)


def _span(orders: Sequence[int]) -> range:
    """Orders as a range."""
    steps = {int(step) for step in np.diff(orders)} or {1}
    if len(steps) > 1 or not steps <= {1, 2}:
        raise ValueError(f"orders must ascend in steps of one or of two, not {tuple(orders)}")
    return range(min(orders), max(orders) + 1, steps.pop())


def simulation_errors(model: StateSpaceModel, inputs: Array, outputs: Array) -> Array:
    """``100 ||y - yhat|| / ||y - mean(y)||`` of each output, (ny,), initial state fitted.

    Infinite where the simulation is not finite.

    Parameters
    ----------
    model : StateSpaceModel
    inputs, outputs : (N, nu) and (N, ny) arrays
    """
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return np.full(model.outputs, np.inf)
        state = model.simulation_state(inputs, outputs)
        errors = outputs - model.simulate(inputs, state)
    return _relative(errors, outputs)


def continued_errors(
    model: StateSpaceModel, inputs: Array, outputs: Array, held_out: slice
) -> tuple[Array, Array]:
    """Errors of a simulation of held-out samples whose outputs determine no state.

    It runs on from the samples before, with the initial state that fits all samples but the
    held-out ones.  A state that were fitted to them would take up the noise that a lightly damped
    or slow mode of the model resembles.

    Parameters
    ----------
    model : StateSpaceModel
    inputs, outputs : (N, nu) and (N, ny) arrays
    held_out : slice
        Not from the first sample on.

    Returns
    -------
    two (ny,) arrays
        As of :func:`simulation_errors`, with the level of the model, and with one that fits the
        held-out samples.
    """
    known = np.ones(len(outputs), dtype=bool)
    known[held_out] = False
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return np.full(model.outputs, np.inf), np.full(model.outputs, np.inf)
        state = model.simulation_state(inputs, outputs, known)
        errors = (outputs - model.simulate(inputs, state))[held_out]
    scored = outputs[held_out]
    return _relative(errors, scored), _relative(errors - errors.mean(axis=0), scored)


def prediction_errors(model: StateSpaceModel, inputs: Array, outputs: Array) -> Array:
    """``100 ||e|| / ||y - mean(y)||`` of one-step predictions, (ny,), initial state fitted."""
    state = model.prediction_state(inputs, outputs)
    return _relative(model.residuals(inputs, outputs, state), outputs)


def _relative(errors: Array, outputs: Array) -> Array:
    spread = np.linalg.norm(outputs - outputs.mean(axis=0), axis=0)
    relative = 100.0 * np.linalg.norm(errors, axis=0) / np.where(spread > 0.0, spread, np.nan)
    return np.where(np.isfinite(relative), relative, np.inf)


_Half = tuple[tuple[Array, ...], tuple[Array, ...]]


@dataclass(frozen=True, eq=False)
class _Prepared:
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


def _prepared(
    inputs: ArrayLike | Sequence[ArrayLike] | None,
    outputs: ArrayLike | Sequence[ArrayLike],
    delays: int | Sequence[int],
    level: bool,
) -> _Prepared:
    ys = records_of(outputs, "outputs")
    us = [np.empty((len(y), 0)) for y in ys] if inputs is None else records_of(inputs, "inputs")
    if len(us) != len(ys) or any(len(u) != len(y) for u, y in zip(us, ys, strict=True)):
        raise ValueError("inputs and outputs must have the same records, of the same lengths")
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
    record = state_space_record(us, ys, each, level)
    return _Prepared(tuple(us), tuple(ys), each, level, record)


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


def _errors(
    prepared: _Prepared, order: int, form: str, settings: StateSpaceSettings
) -> StateSpaceErrors:
    record = prepared.record
    if form not in FORMS:
        raise ValueError(f"form must be one of {FORMS}, not {form!r}")
    if settings.weighting not in WEIGHTINGS:
        raise ValueError(f"weighting must be one of {WEIGHTINGS}, not {settings.weighting!r}")
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


def _generator(
    settings: StateSpaceSettings, order: int, form: str, prepared: _Prepared, fold: int = 0
) -> np.random.Generator:
    key = (order, FORMS.index(form), int(prepared.level), *prepared.delays, fold)
    return np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))


def _cost(errors: StateSpaceErrors) -> float:
    """Multiplications of one set of normal equations."""
    layout = errors.layout
    signals = 2 * layout.sections * layout.drives + 2 * layout.order
    return float(errors.record.samples) * signals**2


def _evaluations(errors: StateSpaceErrors, settings: StateSpaceSettings) -> int:
    if settings.evaluations is not None:
        return settings.evaluations
    if _cost(errors) > HEAVY:
        return 0
    return int(np.clip(BUDGET / _cost(errors), LEAST_EVALUATIONS, MOST_EVALUATIONS))


def _searched(
    errors: StateSpaceErrors,
    starts: list[Array],
    generator: np.random.Generator,
    settings: StateSpaceSettings,
    log: Callable[[str], None] | None,
) -> SearchResult:
    """Descents from estimates and from smaller orders, then the memetic search among them."""
    budget = _evaluations(errors, settings)
    if starts and _cost(errors) > HEAVY and budget == 0:
        return _polished(errors, starts, 0)
    models = StartingModels(errors, errors.order, _cost(errors) <= HEAVY)
    given = descended(errors, starts, len(starts))
    points = [optimum.point for optimum in given]
    spent = sum(optimum.evaluations for optimum in given)
    for problem in (errors, *_other_form(errors)):
        optima = _optima_from_estimates(problem, models, generator)
        if problem is not errors:
            spent += sum(optimum.evaluations for optimum in optima)
            crossing = [converted(errors, problem, optimum.point) for optimum in optima[:CROSSED]]
            optima = descended(errors, crossing, CROSSED)
        points += [optimum.point for optimum in optima]
        spent += sum(optimum.evaluations for optimum in optima)
        if log is not None:
            log(f"starts of {problem.form} form: {len(optima)} optima, {spent} evaluations")
    if budget == 0 and points:
        return _polished(errors, points, spent)
    search = StateSpaceProblem(errors, np.array(points).reshape(-1, errors.dimension))
    sizes = SearchSettings(
        mu=8, lambda_=16, nu=6, refine="random", seed=settings.seed, evaluations=max(budget, 1)
    )
    result = memetic_search(
        search,
        sizes,
        generator,
        log,
        agreeing_restarts=AGREEING_BEFORE_CHECK,
        recombine=search.recombine,
    )
    diagnostics = replace(result.diagnostics, evaluations=result.diagnostics.evaluations + spent)
    return replace(result, diagnostics=diagnostics)


def _optima_from_estimates(
    problem: StateSpaceErrors, models: StartingModels, generator: np.random.Generator
) -> list[Optimum]:
    """Optima from estimates of the order itself, and from the optimum of two states fewer."""
    if _cost(problem) > HEAVY:
        ((_, optima),) = rungs(
            problem, models, generator, 1, range(problem.order, problem.order + 1)
        )
        return optima
    starts = list(models.points(problem))
    smaller = range(1 + (problem.order + 1) % 2, problem.order, 2)
    for below, optima in rungs(problem, models, generator, WIDTH, smaller):
        if optima and below.order == problem.order - 2:
            starts += extensions(problem, below, optima[0].point, generator)
    return descended(problem, starts, FINAL_WIDTH)


def _polished(errors: StateSpaceErrors, points: list[Array], spent: int) -> SearchResult:
    """The lowest of some points, descended from to the last digits."""
    values = np.array([errors.percent(errors.value(point)) for point in points])
    best = descend(errors, points[int(np.argmin(values))], POLISH_STEPS, POLISH_TOLERANCE)
    value = errors.percent(best.criterion)
    spent += best.evaluations
    diagnostics = _without_generations(value, spent, len(points))
    return SearchResult(best.point, value, diagnostics)


def _without_generations(value: float, spent: int, optima: int) -> SearchDiagnostics:
    """Diagnostics of descents from estimates alone: nothing was confirmed."""
    return SearchDiagnostics(
        evaluations=spent,
        generations=0,
        restart_minima=(value,),
        n_confirming=0,
        n_local_optima=optima,
        n_multistart=0,
        undiscovered_probability=1.0,
        convergence=((spent, value),),
    )


def _other_form(errors: StateSpaceErrors) -> tuple[StateSpaceErrors, ...]:
    """The problem of the other form, whose optima are starts, where it is not too large."""
    if errors.record.inputs.shape[1] == 0:
        return ()
    other = errors.of_form("output_error" if errors.innovations else "innovations")
    return () if _cost(other) > HEAVY else (other,)


def _swept(
    errors: StateSpaceErrors,
    prepared: _Prepared,
    orders: range,
    settings: StateSpaceSettings,
    width: int,
    log: Callable[[str], None] | None,
    fold: int = 0,
    steps: int = STEPS,
) -> Iterator[tuple[StateSpaceErrors, SearchResult]]:
    """The best optimum of each order that the rungs of a ladder reach."""
    models = StartingModels(errors, orders[-1], _cost(errors) <= HEAVY)
    generator = _generator(settings, orders[-1], errors.form, prepared, 1 + fold)
    for problem, optima in rungs(errors, models, generator, width, orders, steps):
        if not optima:
            continue
        best = optima[0]
        value = problem.percent(best.criterion)
        spent = sum(optimum.evaluations for optimum in optima)
        if log is not None:
            log(f"order {problem.order}: {value:.9g} %, {spent} evaluations")
        diagnostics = _without_generations(value, spent, len(optima))
        yield problem, SearchResult(best.point, value, diagnostics)


def _two_fold_errors(
    prepared: _Prepared,
    orders: range,
    form: str,
    settings: StateSpaceSettings,
    width: int,
    sampling_rate: float,
) -> Array:
    """Simulation error of each order over both halves, percent."""
    halves = _halves(prepared)
    squares = np.zeros((len(orders), prepared.record.outputs.shape[1]))
    reference = np.zeros(prepared.record.outputs.shape[1])
    seen = np.zeros(len(orders), dtype=int)
    for fold, (train, test) in enumerate((halves, halves[::-1])):
        half = _prepared(list(train[0]), list(train[1]), prepared.delays, prepared.level)
        errors = _errors(half, orders[-1], form, settings)
        power = np.array([[np.sum((y - y.mean(axis=0)) ** 2, axis=0)] for y in test[1]])[:, 0]
        reference += power.sum(axis=0)
        for problem, found in _swept(errors, half, orders, settings, width, None, 1 + fold):
            model = model_of(
                problem, problem.projection(found.point), sampling_rate, half.shifts, (), ()
            )
            at = orders.index(problem.order)
            seen[at] += 1
            for u, y, each in zip(*test, power, strict=True):
                squares[at] += (simulation_errors(model, u, y) / 100.0) ** 2 * each
    relative = 100.0 * np.sqrt(squares / reference).mean(axis=1)
    return np.where(seen == 2, relative, np.inf)


def _halves(prepared: _Prepared) -> tuple[_Half, _Half]:
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


def _described(
    errors: StateSpaceErrors,
    result: SearchResult,
    prepared: _Prepared,
    sampling_rate: float,
    input_names: tuple[str, ...],
    output_names: tuple[str, ...],
) -> StateSpaceEstimate:
    """The model at a search's best point, with criteria, residuals and covariance."""
    found = errors.projection(result.point)
    model = model_of(errors, found, sampling_rate, prepared.shifts, input_names, output_names)
    model = replace(model, covariance=parameter_covariance(errors, found))
    record = errors.record
    y = record.outputs * record.output_scales
    e = found.errors * record.output_scales
    spread = np.linalg.norm(y - y.mean(axis=0), axis=0)
    fit = 100.0 * (1.0 - np.linalg.norm(e, axis=0) / np.where(spread > 0.0, spread, np.nan))
    sign, log_determinant = np.linalg.slogdet(e.T @ e / record.samples)
    penalty = errors.parameters * np.log(record.samples) / record.samples
    whitened = autoregression_of(e, record.bounds)
    lost = max(prepared.shifts, default=0)
    residuals = []
    for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
        unknown = np.full((lost, e.shape[1]), np.nan)
        residuals.append(np.vstack([unknown, e[first:stop]]))
    states, levels = initial_states(errors, found, model)
    radius = max(largest_radius(errors.layout, result.point), float(np.abs(model.poles()).max()))
    return StateSpaceEstimate(
        model=model,
        objective=result.value,
        fit_percent=fit,
        bic=float(log_determinant + penalty if sign > 0 else -np.inf),
        coloured_bic=float(whitened.bic + penalty),
        residuals=tuple(residuals),
        initial_states=states,
        record_levels=levels,
        at_stability_bound=lies_at_bound(radius, errors.radius),
        search=result,
    )
