"""Whether a machine changes in a way that a model with moving coefficients predicts better.

The model of the recipe stays what it is; what moves stands beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from evopem.arrays import Array, Indices
from evopem.config.settings import VaryingSettings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.varying import Scheduled, VaryingEstimate
from evopem.estimation.varying_choice import DIMENSIONS, choose_again, choose_varying, race
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.varying import KINDS, MovingMode, VaryingModel
from evopem.signals.prepared_data import PreparedData
from evopem.validation.held_out_tests import SIGNIFICANCE
from evopem.validation.model_class import ModelClass

# Blocks of neighbouring samples, every fifth of which is held out at a time.
BLOCKS, FOLDS = 40, 5
CLEARLY = 2.0  # standard errors by which the held-out errors must be smaller
# Plant orders that are tried, above that of the constant model and at all.
ORDERS_ABOVE, FEWEST_ORDERS, MOST_ORDERS = 2, 4, 12
# Moments at which modes are followed, the share of them at which one must oscillate, and its
# largest standard error relative to its frequency.
MOMENTS, SHARE, DOUBTFUL = 41, 0.8, 0.1

Choose = Callable[[Scheduled], VaryingEstimate | None]


@dataclass(frozen=True)
class Moves:
    """What a moving model says; errors are of held-out samples one step ahead, in percent.

    Of models that are chosen without them, among the few that compete for all samples.
    """

    text: str  # the structure, and the basis
    error_percent: float
    constant_error_percent: float  # of models of the same kind that do not move
    standard_errors: float  # by how many of them its squares are smaller
    is_better: bool
    is_stable: bool  # at every moment
    modes: tuple[MovingMode, ...]
    schedule: str = "time"  # what the coefficients move with
    is_nonlinear: bool = False  # whether a constant model shows no change beside nonlinearity

    @property
    def column(self) -> str:
        """The column of a table that holds the schedule."""
        return "time_s" if self.schedule == "time" else "condition"


@dataclass(frozen=True, eq=False)
class Varying:
    """A moving model, or why there is none."""

    reason: str
    moves: Moves | None = None
    model: VaryingModel | None = None
    tests: ModelClass | None = None  # of the constant model


def what_moves(
    prepared: PreparedData, record: ModelRecord, settings: VaryingSettings, tests: ModelClass
) -> Varying:
    """Try a moving model where the response changes with time, or settings beside auto ask for it.

    ``tests``: of the class of the constant model.

    InputError where they do, and the recordings are none that such a model is made for.
    """
    is_asked, unfit = settings != VaryingSettings(), ""
    if len(record.output_names) > 1:
        unfit = "there are several outputs, and a moving model has one"
    elif prepared.transforms.several_recordings and settings.condition is None:
        unfit = "there are several recordings, and coefficients move with the time of one"
    if unfit and is_asked:
        raise InputError("varying", unfit, "leave the key out")
    if unfit:
        return Varying(unfit)
    if not is_asked and not tests.constant.p_value < SIGNIFICANCE:
        return Varying("the response does not change with time")
    if not is_asked and tests.follows in ("constant", "feedback"):
        return Varying("nonlinearity or feedback explains more than a change with time")
    most = min(max(record.plant.order + ORDERS_ABOVE, FEWEST_ORDERS), MOST_ORDERS)
    scheduled, schedule = whole(prepared, settings), settings.condition or "time"
    varying = moving_model(scheduled, most, record.delays, settings, schedule)
    if varying.moves and tests.follows == "constant":
        varying = replace(varying, moves=replace(varying.moves, is_nonlinear=True))
    return varying


def whole(prepared: PreparedData, settings: VaryingSettings) -> Scheduled:
    """All samples by the condition of their recording, or those of the first one by their time."""
    parts = [*prepared.estimation.segments, *prepared.validation.segments]
    origins = [*prepared.transforms.estimation, *prepared.transforms.validation]
    pairs, rate = zip(origins, parts, strict=True), prepared.estimation.sampling_rate
    if settings.condition:
        conditions = [settings.values[origin.recording] for origin in origins]
        return Scheduled.of(prepared.estimation.with_segments(parts), conditions)
    first = [(of, part) for of, part in pairs if of.recording == origins[0].recording]
    data = prepared.estimation.with_segments([part for _, part in first])
    times = [of.start + np.arange(part.samples) / rate for of, part in first]
    return Scheduled.of(data, np.concatenate(times))


def moving_model(
    scheduled: Scheduled,
    orders: Orders | int,
    nk: tuple[int, ...],
    settings: VaryingSettings,
    schedule: str,
) -> Varying:
    """The model that BIC chooses, judged on samples held out.

    ``orders``: known ones, or the highest to be tried with delays ``nk``.  ``schedule``: its name.
    """
    levels = len(np.unique(scheduled.schedule))
    # Between one value of each recording nothing tells other functions from polynomials.
    kinds = KINDS[:1] if levels <= len(scheduled.data.segments) else KINDS
    kinds = kinds if settings.basis == "auto" else (settings.basis,)
    # Where some values are held out, the others determine the functions, and one more.
    dimensions = tuple(n for n in DIMENSIONS if n < levels + (2 - levels) // FOLDS)
    if settings.dimension != "auto":
        dimensions = (settings.dimension,)
    moving = race(scheduled, orders, nk, kinds, dimensions)
    chosen = choose_varying(scheduled, moving)
    if chosen is None:
        return Varying("the record is too short for coefficients that move")
    if not np.any(chosen.free[:, 1:]):
        return Varying("BIC prefers coefficients that stay as they are")
    # The search takes most of the time: both sides of the comparison go without it.
    constant = race(scheduled, orders, nk, KINDS[:1], (1,))
    again = [partial(choose_again, raced=raced) for raced in (moving, constant)]
    error, constant_error, standard_errors = compared(scheduled, *again)
    model = replace(chosen.model, schedule=schedule)
    moves = Moves(
        text=model.text,
        error_percent=error,
        constant_error_percent=constant_error,
        standard_errors=standard_errors,
        is_better=standard_errors > CLEARLY,
        is_stable=bool(model.radii().max() < 1.0),
        modes=followed(model),
        schedule=schedule,
    )
    return Varying("", moves, model)


def compared(scheduled: Scheduled, moving: Choose, constant: Choose) -> tuple[float, float, float]:
    """Errors on held-out samples of both (percent), and by how many standard errors they differ."""
    errors, constant_errors = (held_out_errors(scheduled, choose) for choose in (moving, constant))
    known = np.isfinite(errors) & np.isfinite(constant_errors)
    squares, constant_squares = errors[known] ** 2, constant_errors[known] ** 2
    gains = [float(np.mean(block)) for block in np.array_split(constant_squares - squares, BLOCKS)]
    spread = float(np.std(gains, ddof=1)) / BLOCKS**0.5
    size = 100.0 / float(np.std(scheduled.data.output[known]))
    sizes = (size * float(np.sqrt(np.mean(part))) for part in (squares, constant_squares))
    return (*sizes, float(np.mean(gains)) / max(spread, 1e-300))


def blocks(scheduled: Scheduled) -> Indices:
    """The fold of each sample, (N,): of its block; of its recording where each has one condition.

    -1 at the ends of the conditions, which no others lie around.
    """
    samples, parts = scheduled.data.samples, np.split(scheduled.schedule, scheduled.bounds[1:-1])
    if any(np.ptp(part) > 0.0 for part in parts):
        return np.arange(samples) * BLOCKS // samples % FOLDS
    conditions, rank = np.unique(scheduled.schedule, return_inverse=True)
    return np.where((rank > 0) & (rank < len(conditions) - 1), rank % FOLDS, -1)


def held_out_errors(scheduled: Scheduled, choose: Choose) -> Array:
    """Errors one step ahead, each of a model that was chosen without its fold, (N,)."""
    of_block, errors = blocks(scheduled), np.full(scheduled.data.samples, np.nan)
    for fold in np.unique(of_block[of_block >= 0]):
        held = of_block == fold
        if chosen := choose(replace(scheduled, weights=np.where(held, 0.0, scheduled.weights))):
            errors[held] = chosen.errors[held]
    if np.any(of_block < 0):  # the state before a whole recording is not known: it has to decay
        for first, stop in pairwise(scheduled.bounds):
            errors[first : first + (stop - first) // 3] = np.nan
    return errors


def followed(model: VaryingModel) -> tuple[MovingMode, ...]:
    """The modes that are known and oscillate at most values of the schedule."""

    def is_known(path: MovingMode) -> bool:
        errors = [mode.frequency_se_hz / mode.frequency_hz for mode in path.modes]
        return len(errors) >= SHARE * MOMENTS and float(np.median(errors)) < DOUBTFUL

    values = np.linspace(model.basis.low, model.basis.high, MOMENTS)
    return tuple(filter(is_known, model.modes(values)))


def table_of(varying: Varying) -> dict[str, list[float]]:
    """Frozen modes along the schedule with 95 % intervals; empty columns without a model."""
    moves, rows = varying.moves, []
    for number, path in enumerate(moves.modes if moves else (), start=1):
        for value, mode in zip(path.values, path.modes, strict=True):
            f, z = NORMAL_95 * mode.frequency_se_hz, NORMAL_95 * 100.0 * mode.damping_se
            bounded = (mode.frequency_hz, f), (100.0 * mode.damping_ratio, z)
            rows.append([number, value, *(x for v, w in bounded for x in (v, v - w, v + w))])
    names = [
        *("mode", moves.column if moves else "time_s"),
        *("frequency_hz", "frequency_lower", "frequency_upper"),
        *("damping_percent", "damping_lower", "damping_upper"),
    ]
    columns = np.reshape(rows, (-1, len(names))).T
    return {name: column.tolist() for name, column in zip(names, columns, strict=True)}
