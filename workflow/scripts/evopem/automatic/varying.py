"""Whether a machine changes in a way that a model with moving coefficients predicts better.

The model of the recipe stays what it is; what moves stands beside it.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from evopem.arrays import Array, Indices
from evopem.config.settings import VaryingSettings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.varying import Scheduled, VaryingEstimate, estimate_varying
from evopem.estimation.varying_choice import DIMENSIONS, choose_varying
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.varying import KINDS, VaryingModel
from evopem.signals.prepared_data import PreparedData
from evopem.validation.model_class import REJECTED, ResidualTest

# Blocks of neighbouring samples, every fifth of which is held out at a time.
BLOCKS, FOLDS = 40, 5
# Standard errors by which the held-out errors must be smaller.
CLEARLY = 2.0
# Plant orders that are tried, above that of the constant model and at all.
ORDERS_ABOVE, FEWEST_ORDERS, MOST_ORDERS = 2, 4, 12
# Moments at which modes are followed, the share of them at which one must oscillate, and its
# largest standard error relative to its frequency.
MOMENTS, SHARE, DOUBTFUL = 41, 0.8, 0.1


@dataclass(frozen=True)
class MovingMode:
    """A mode at the start and the end (Hz), with standard errors, and how far it goes between."""

    first_hz: float
    first_se: float
    last_hz: float
    last_se: float
    lowest_hz: float
    highest_hz: float

    @property
    def moves(self) -> bool:
        """Whether the ends differ by more than their 95 % interval, or it goes further between."""
        width = NORMAL_95 * float(np.hypot(self.first_se, self.last_se))
        return self.highest_hz - self.lowest_hz > width


@dataclass(frozen=True)
class Moves:
    """What a moving model says; errors are of held-out samples one step ahead, in percent."""

    text: str  # the structure, and the basis
    error_percent: float
    constant_error_percent: float  # of the best model of the same kind that does not move
    standard_errors: float  # by how many of them its squares are smaller
    is_better: bool
    is_stable: bool  # at every moment
    modes: tuple[MovingMode, ...]
    schedule: str = "time"  # what the coefficients move with


@dataclass(frozen=True, eq=False)
class Varying:
    """A moving model, or why there is none."""

    reason: str
    moves: Moves | None = None
    model: VaryingModel | None = None


def what_moves(
    prepared: PreparedData, record: ModelRecord, test: ResidualTest, settings: VaryingSettings
) -> Varying:
    """Try a moving model where the response changes with time, or settings beside auto ask for it.

    InputError where they do, and the recordings are none that such a model is made for.
    """
    is_asked = settings != VaryingSettings()
    if not is_asked and not test.p_value < REJECTED:
        return Varying("the response does not change with time")
    unfit = ""
    if prepared.estimation.outputs.shape[1] > 1:
        unfit = "there are several outputs, and a moving model has one"
    elif prepared.transforms.several_recordings and settings.condition is None:
        unfit = "there are several recordings, and coefficients move with the time of one"
    if unfit and is_asked:
        raise InputError("varying", unfit, "leave the key out")
    return Varying(unfit) if unfit else _tried(whole(prepared, settings), record, settings)


def whole(prepared: PreparedData, settings: VaryingSettings) -> Scheduled:
    """All samples, by their time or by the condition of their recording."""
    parts = [*prepared.estimation.segments, *prepared.validation.segments]
    origins = [*prepared.transforms.estimation, *prepared.transforms.validation]
    data = prepared.estimation.with_segments(parts)
    schedule = [
        np.full(part.samples, settings.values[origin.recording])
        if settings.condition
        else origin.start + np.arange(part.samples) / data.sampling_rate
        for origin, part in zip(origins, parts, strict=True)
    ]
    return Scheduled.of(data, np.concatenate(schedule))


def _tried(scheduled: Scheduled, record: ModelRecord, settings: VaryingSettings) -> Varying:
    kinds = KINDS if settings.basis == "auto" else (settings.basis,)
    dimensions: tuple[int, ...] = DIMENSIONS
    if settings.dimension != "auto":
        dimensions = (settings.dimension,)
    elif settings.condition:
        # Those of the other recordings determine them, and one more, where some are held out.
        levels = len(set(settings.values))
        most_functions = levels - 1 + (2 - levels) // FOLDS
        dimensions = tuple(n for n in dimensions if n <= most_functions)
    most = min(max(record.plant.order + ORDERS_ABOVE, FEWEST_ORDERS), MOST_ORDERS)
    nk = delays_of(record)
    moving = choose_varying(scheduled, most, nk, kinds, dimensions)
    constant = choose_varying(scheduled, most, nk, KINDS[:1], (1,))
    if moving is None or constant is None:
        return Varying("the record is too short for coefficients that move")
    if not np.any(moving.free[:, 1:]):
        return Varying("BIC prefers coefficients that stay as they are")
    error, constant_error, standard_errors = compared(scheduled, moving, constant)
    model = replace(moving.model, schedule=settings.condition or "time")
    moves = Moves(
        model.text,
        error,
        constant_error,
        standard_errors,
        standard_errors > CLEARLY,
        bool(model.radii().max() < 1.0),
        tuple(_ends(path) for path in followed(model)[1]),
        model.schedule,
    )
    return Varying("", moves, model)


def compared(
    scheduled: Scheduled, moving: VaryingEstimate, constant: VaryingEstimate
) -> tuple[float, float, float]:
    """Errors on held-out samples of both (percent), and by how many standard errors they differ."""
    errors, constant_errors = (held_out_errors(scheduled, fit) for fit in (moving, constant))
    known = np.isfinite(errors) & np.isfinite(constant_errors)
    squares, constant_squares = errors[known] ** 2, constant_errors[known] ** 2
    gains = [float(np.mean(block)) for block in np.array_split(constant_squares - squares, BLOCKS)]
    spread = float(np.std(gains, ddof=1)) / BLOCKS**0.5
    size = 100.0 / float(np.std(scheduled.data.output[known]))
    sizes = (size * float(np.sqrt(np.mean(part))) for part in (squares, constant_squares))
    return (*sizes, float(np.mean(gains)) / max(spread, 1e-300))


def delays_of(record: ModelRecord) -> tuple[int, ...]:
    """Samples until each input acts, nk."""
    if record.orders is not None:
        return record.orders.nk
    plant = record.plant
    return tuple(d + (not np.any(plant.D[:, k])) for k, d in enumerate(plant.delays))


def blocks(scheduled: Scheduled) -> Indices:
    """The fold of each sample, (N,): of its block; of its recording where each has one condition.

    -1 at the ends of the conditions, which no others lie around.
    """
    samples, parts = scheduled.data.samples, np.split(scheduled.schedule, scheduled.bounds[1:-1])
    if any(np.ptp(part) > 0.0 for part in parts):
        return np.arange(samples) * BLOCKS // samples % FOLDS
    conditions, rank = np.unique(scheduled.schedule, return_inverse=True)
    return np.where((rank > 0) & (rank < len(conditions) - 1), rank % FOLDS, -1)


def held_out_errors(scheduled: Scheduled, estimate: VaryingEstimate) -> Array:
    """Errors one step ahead, each by a model that was estimated without its fold, (N,)."""
    model, free, of_block = estimate.model, estimate.free, blocks(scheduled)
    errors = np.full(scheduled.data.samples, np.nan)
    starts = [estimate.point] if len(estimate.point) else []
    for fold in np.unique(of_block[of_block >= 0]):
        held = of_block == fold
        others = replace(scheduled, weights=np.where(held, 0.0, scheduled.weights))
        fitted = estimate_varying(others, model.orders, model.basis, free, starts=starts)
        errors[held] = fitted.errors[held]
    if np.any(of_block < 0):  # the state before a whole recording is not known: it has to decay
        for first, stop in pairwise(scheduled.bounds):
            errors[first : first + (stop - first) // 3] = np.nan
    return errors


def followed(model: VaryingModel) -> tuple[Array, list[list[Mode | None]]]:
    """Values of the schedule, and the modes that are known and oscillate at most of them."""
    times = np.linspace(model.basis.low, model.basis.high, MOMENTS)

    def is_known(path: list[Mode | None]) -> bool:
        errors = [mode.frequency_se_hz / mode.frequency_hz for mode in path if mode]
        return len(errors) >= SHARE * MOMENTS and float(np.median(errors)) < DOUBTFUL

    return times, [path for path in model.modes(times) if is_known(path)]


def _ends(path: list[Mode | None]) -> MovingMode:
    modes = [mode for mode in path if mode]
    first, last, frequencies = modes[0], modes[-1], [mode.frequency_hz for mode in modes]
    return MovingMode(
        *(first.frequency_hz, first.frequency_se_hz, last.frequency_hz, last.frequency_se_hz),
        *(min(frequencies), max(frequencies)),
    )


def along(model: VaryingModel | None) -> str:
    """The column of a table that holds the schedule."""
    return "time_s" if model is None or model.schedule == "time" else "condition"


def table_of(varying: Varying) -> dict[str, list[float]]:
    """Frozen modes along the schedule with 95 % intervals; empty columns without a model."""
    frequency = ("frequency_hz", "frequency_lower", "frequency_upper")
    names = (
        "mode",
        along(varying.model),
        *frequency,
        "damping_percent",
        "damping_lower",
        "damping_upper",
    )
    rows = []
    times, paths = followed(varying.model) if varying.model else (np.empty(0), [])
    for number, path in enumerate(paths, start=1):
        for time, mode in zip(times, path, strict=True):
            if mode is not None:
                f, z = NORMAL_95 * mode.frequency_se_hz, NORMAL_95 * 100.0 * mode.damping_se
                values = (mode.frequency_hz, f), (100.0 * mode.damping_ratio, z)
                rows.append([number, time, *(x for v, w in values for x in (v, v - w, v + w))])
    columns = np.reshape(rows, (-1, len(names))).T
    return {name: column.tolist() for name, column in zip(names, columns, strict=True)}
