"""Fits of polynomials to several stretches by local descents, and of states, order by order."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array
from evopem.automatic.cross_validation.simulation import Model
from evopem.automatic.cross_validation.stretches import LARGE, LONG, is_large
from evopem.config.settings import Objective, OutputWeighting, SearchSettings
from evopem.config.structures import OF_ABSOLUTE_ERRORS, REGULARISED, STATE_SPACE_FORMS
from evopem.errors import NoModelError
from evopem.estimation import criteria
from evopem.estimation.impulse_response import posterior
from evopem.estimation.pem.covariance import innovation_variance
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import Log
from evopem.estimation.search.staged_descent import DescentStage, descents_on_parts, staged_descent
from evopem.estimation.state_space.estimate import RISES, estimates_of_orders
from evopem.estimation.state_space.local_estimates import (
    StateSpaceEstimate,
    StateSpaceTask,
    refitted,
)
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH, NO_MODELS, WIDTH, likeliest_order
from evopem.estimation.state_space.starting_models import USUAL_ORDER
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel, model_of
from evopem.models.state_space import StateSpaceModel
from evopem.signals.least_squares import chunks, triangle_of
from evopem.signals.recording import Recording, Segment

# Poles as slow as this act as integrators in any record; closer to the circle nothing changes.  In
# state space the radius is smaller: slow modes of two outputs were off by 122 % at this one, by 7 %
# at 0.9999.
PLANT_RADIUS = 1.0 - 1e-7
NOISE_RADIUS = 0.9999
HUGE = 1e100  # errors beyond this are all the same
# One stage is enough for the quadratic objective, whose corner needs no smoothing.  Scores of folds
# need no more digits than the second one gives.
SWEEP_STAGES = (DescentStage(0.1, 1e-7, 1e-7),)
FOLD_STAGES = (DescentStage(0.1, 1e-7, 1e-4),)


@dataclass(frozen=True)
class CommonSettings(SearchSettings):
    """What all fits of one record have in common."""

    objective: Objective = "quadratic"
    weighting: OutputWeighting | None = None  # of the outputs; by structure where it is None


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to stretches."""

    model: Model  # its level is that of the first recording
    parameters: int  # coefficients and levels
    residuals: tuple[Array, ...] = field(repr=False)  # (M, l) of each stretch
    first: int  # sample of the first residual of each stretch

    def residuals_from(self, first: int = 0) -> Array:
        """The residuals from sample ``first`` of each stretch on, (M, l)."""
        return np.concatenate([r[max(first - self.first, 0) :] for r in self.residuals])


def log_loss(errors: Array, objective: str) -> float:
    """Twice the smallest negative log-likelihood of errors, (N, l), for each sample, finite.

    Over the scale of its distribution: the normal one, correlated between the outputs, for the
    quadratic objective, Laplace's for the absolute one.
    """
    bounded = np.clip(np.nan_to_num(errors, nan=HUGE), -HUGE, HUGE)
    constant = 2.0 * np.log(2.0) + 2.0 if objective == "absolute" else np.log(2.0 * np.pi) + 1.0
    loss = criteria.log_loss(bounded, objective)
    return max(loss, float(np.log(np.finfo(float).tiny))) + errors.shape[1] * float(constant)


def fit(
    stretches: Sequence[Segment],
    orders: Orders,
    objective: str = "quadratic",
    models: Sequence[PolynomialModel] = (),
    own_starts: bool = True,
    structure: str | None = None,
    stages: tuple[DescentStage, ...] = SWEEP_STAGES,
    level: bool = True,
) -> Fit:
    """Fit a model of one output by descents from estimates and models.

    ``models``: of any orders; descents start from them, with further poles where these orders have
    more, and with ``own_starts`` from estimates by linear algebra as well.  ``structure``: name of
    the model, by default the smallest structure with these orders.  ``stages``: how descents end.
    ``level``: whether a constant is estimated for each recording.

    A regularised response needs no start.

    Raises NoModelError when no stretch is long enough, or no start has finite prediction errors.
    """
    errors = PolynomialErrors(stretches, orders, objective, PLANT_RADIUS, NOISE_RADIUS, level)
    if structure in REGULARISED:
        response = posterior(errors)
        point, parameters, variance = response.point, response.parameters, response.noise_variance
        residuals = errors.residuals_of_stretches(point)
    else:
        starts = PolynomialProblem(errors, models, own_starts).starts()
        if len(starts) == 0:
            raise NoModelError(f"no start of {orders} has finite prediction errors")
        descents = staged_descent(errors, starts, stages)
        point = descents.points[int(np.argmin(descents.values))].copy()
        parameters = errors.parameters
        residuals = errors.residuals_of_stretches(point)
        variance = innovation_variance(np.concatenate(residuals), len(point))
    model = _model_at(errors, point, variance, structure or orders.structure)
    return Fit(model, parameters, tuple(e[:, None] for e in residuals), orders.first_residual)


def fits_of_parts(
    parts: Sequence[Sequence[Segment]], model: PolynomialModel, structure: str, objective: str
) -> list[Model]:
    """The optima of parts of a record that descents from the optimum of the whole end at.

    All at once, with the noise variance of the whole; those that cannot be relied on one after the
    other by :func:`fit`, whose errors it raises.  Priors of responses are next to the first one.
    """
    orders = replace(model.orders, structure=structure)
    given = orders, objective, PLANT_RADIUS, NOISE_RADIUS, True
    problems = [PolynomialErrors(part, *given) for part in parts]
    if structure in REGULARISED:
        first = [posterior(errors) for errors in problems[:1]]
        others = [posterior(errors, first[0].prior) for errors in problems[1:]]
        pairs = zip(problems, first + others, strict=True)
        return [_model_at(e, r.point, r.noise_variance, structure) for e, r in pairs]
    ends = descents_on_parts(problems, model.parameters, *FOLD_STAGES)
    return [
        fit(part, orders, objective, [model], False, structure, FOLD_STAGES).model
        if end is None
        else _model_at(errors, end, model.noise_variance, structure)
        for part, errors, end in zip(parts, problems, ends, strict=True)
    ]


def _model_at(
    errors: PolynomialErrors, point: Array, noise_variance: float, structure: str
) -> PolynomialModel:
    orders = replace(errors.orders, structure=structure)
    level = float(point[orders.parameters]) if errors.levels else 0.0
    return model_of(orders, point, level=level, noise_variance=noise_variance)


class ArxFit(NamedTuple):
    """An ARX model of one output by least squares, with na = n and nb = n + 1 of each input."""

    bic: float  # not divided by the samples
    model: PolynomialModel  # without the levels of the recordings
    residuals: Array


def likeliest_arx(
    stretches: Sequence[Segment], orders: Sequence[int], first: int, levels: bool = True
) -> ArxFit | None:
    """The ARX model of the lowest BIC of residuals from sample ``first`` on, with enough of them.

    With a level for each recording, or without.
    """
    long = [stretch for stretch in stretches if stretch.samples > first]
    recordings = sorted({stretch.recording for stretch in stretches}) if levels else []
    count = sum(stretch.samples - first for stretch in long)
    parts = [(s, *part) for s in long for part in chunks(first, s.samples)]
    # The first columns are those of lower orders: one triangle serves all.
    m, constants = stretches[0].inputs.shape[1], len(recordings)
    triangle = triangle_of(_arx_rows(*part, max(orders, default=0), recordings) for part in parts)
    fits = []
    for order in orders:
        size = constants + m + order * (1 + m)
        if long and count > 2 * size:
            columns, target = triangle[:, :size], triangle[:, -1]
            point = np.linalg.lstsq(columns, target, rcond=count * np.finfo(float).eps)[0]
            left = target - columns @ point
            mean_square = max(float(left @ left) / count, np.finfo(float).tiny)
            fits.append((count * np.log(mean_square) + size * np.log(count), order, point))
    if not fits:
        return None
    bic, order, point = min(fits, key=lambda fit: fit[0])
    every = (_arx_rows(*part, order, recordings) for part in parts)
    residuals = np.concatenate([rows[:, -1] - rows[:, :-1] @ point for rows in every])
    lagged, unit = point[constants + m :].reshape(order, 1 + m), np.ones(1)
    b = np.ascontiguousarray(np.vstack([point[constants : constants + m], lagged[:, 1:]]).T)
    a = np.concatenate([[1.0], lagged[:, 0]])
    model = PolynomialModel(a, tuple(b), unit, unit, (unit,) * m, (0,) * m)
    return ArxFit(float(bic), model, residuals)


def _arx_rows(
    stretch: Segment, first: int, stop: int, order: int, recordings: Sequence[int]
) -> Array:
    """Levels, inputs and earlier samples by lag, and output of some samples, (N, columns)."""
    u, y = stretch.inputs, stretch.output
    columns = [np.full(stop - first, float(stretch.recording == r)) for r in recordings]
    columns.append(u[first:stop])
    for i in range(1, order + 1):
        columns += [-y[first - i : stop - i], u[first - i : stop - i]]
    return np.column_stack([*columns, y[first:stop]])


# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12
# Number of states from which on a search without an input is shortened, and states below those of
# the likeliest estimate by linear algebra at which it begins then.
MANY_ALONE, BELOW = 14, 8


def from_likeliest(
    stretches: Sequence[Segment], orders: Sequence[int], settings: CommonSettings
) -> tuple[int, ...]:
    """The orders of a search without an input, less small ones where it has many states."""
    task = task_of(recording_of(stretches), "ss", (), settings)
    likeliest = likeliest_order(task.errors(recording_of(stretches), orders[-1]), orders)
    first = likeliest - BELOW if likeliest >= MANY_ALONE else orders[0]
    return tuple(order for order in orders if order >= first)


def weighting_of(structure: str, settings: CommonSettings) -> OutputWeighting:
    """The weighting of the outputs of a structure in state space."""
    built_in = STATE_SPACE_FORMS[structure]
    if settings.objective == "absolute":
        built_in = OF_ABSOLUTE_ERRORS
    return settings.weighting or built_in  # type: ignore[return-value]


def recording_of(stretches: Sequence[Segment]) -> Recording:
    """Stretches as a recording at 1 Hz."""
    return Recording(stretches[0].inputs, stretches[0].outputs, 1.0).with_segments(stretches)


def fits_in_state_space(
    stretches: Sequence[Segment],
    structure: str,
    orders: Sequence[int],
    delays: tuple[int, ...],
    settings: CommonSettings,
    starts: Mapping[int, StateSpaceModel] = NO_MODELS,
    log: Log | None = None,
) -> Iterator[tuple[int, Fit]]:
    """Fits of ascending numbers of states until their BIC rises.

    ``starts``: models of another form by their order, which are descended from as well.
    None of ``ss_bj`` of large records, where a descent takes too long.  Normal equations take time
    in proportion to the samples and the square of the channels.
    """
    estimation = recording_of(stretches)
    channels = estimation.inputs.shape[1] + estimation.outputs.shape[1]
    large = is_large(stretches, 2 * LARGE // max(channels, 2))
    if structure == "ss_bj" and large:
        return
    driven = estimation.has_input
    many = orders[0] >= MANY_ALONE - BELOW and orders[-1] >= MANY_ALONE
    quick = large or (many and not driven)
    # Polynomials of equal orders are searched beside the states of one input and one output.
    is_one = stretches[0].inputs.shape[1] == 1 == stretches[0].outputs.shape[1]
    estimates = estimates_of_orders(
        estimation,
        orders,
        structure=structure,  # type: ignore[arg-type]
        delays=delays,
        weighting=weighting_of(structure, settings),
        settings=settings,
        forgets=True,
        width=LARGE_WIDTH if quick else WIDTH if is_one else FINAL_WIDTH,
        steps=LARGE_STEPS if quick else STEPS,
        starts=starts,
        covariances=False,
        log=log,
    )
    first = max(delays, default=0)
    for fitted in until_bic_rises(estimates, driven):
        residuals = tuple(e[np.isfinite(e).all(axis=1)] for e in fitted.residuals)
        yield fitted.order, Fit(fitted.model, fitted.parameters, residuals, first)


def until_bic_rises(
    estimates: Iterable[StateSpaceEstimate], driven: bool = True
) -> Iterator[StateSpaceEstimate]:
    """The estimates by ascending order, up to where the BIC has risen so often that a search ends.

    From the usual largest order on it ends with the first rise, also of the BIC with the colour of
    the errors: states that only describe coloured errors would be added without end.  Where no
    input drives the model, its states describe nothing else, and the BIC alone decides.
    """
    lowest = lowest_coloured = np.inf
    rises = 0
    for estimate in estimates:
        yield estimate
        rises = 0 if estimate.bic < lowest else rises + 1
        falls = rises == 0 and estimate.coloured_bic < lowest_coloured
        if rises >= RISES or (driven and estimate.order >= USUAL_ORDER and not falls):
            return
        lowest = min(lowest, estimate.bic)
        lowest_coloured = min(lowest_coloured, estimate.coloured_bic)


def refit(
    model: StateSpaceModel,
    structure: str,
    stretches: Sequence[Segment],
    delays: tuple[int, ...],
    settings: CommonSettings,
    whole: Sequence[Segment],
) -> StateSpaceModel:
    """The optimum of stretches, parts of whole ones, that a descent from a model ends at.

    Raises ValueError when they are too short, or the descent finds no stable model.
    """
    estimation = recording_of(stretches)
    many = not estimation.has_input and model.order > USUAL_ORDER
    steps = LARGE_STEPS if many or is_large(whole, LONG) else STEPS
    task = task_of(recording_of(whole), structure, delays, settings)
    return refitted(replace(model, covariance=None), estimation, task, steps)


def task_of(
    whole: Recording, structure: str, delays: tuple[int, ...], settings: CommonSettings
) -> StateSpaceTask:
    """What is estimated of a structure in state space."""
    return StateSpaceTask.of(
        whole,
        structure,  # type: ignore[arg-type]
        delays,
        forgets=True,
        weighting=weighting_of(structure, settings),
        settings=settings,
    )
