"""The same mode in several models: paired with a reference, or grouped over all orders.

Poles of different orders belong to one mode where they agree within their standard errors or the
usual tolerances of modal analysis; a mode has at most one pole of an order.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from statistics import median
from typing import Literal, Self

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.models.modes import Mode, assurance
from evopem.models.polynomial import Model

# Modes whose natural frequencies differ by more than this share are not the same mode.
SAME_MODE = 0.15
# Poles are the same mode within these differences, relative for frequency and damping, or within
# three standard errors of their difference.
SAME_FREQUENCY = 0.02
SAME_DAMPING = 0.3
STANDARD_ERRORS = 3.0
# Smallest modal assurance criterion of two shapes of one mode, where both are known well enough.
SAME_SHAPE = 0.8
# Distance up to which a mode of a model that could have been chosen as well is another estimate of
# a mode: their difference is what its standard errors are to contain.
OF_RIVAL = 2.0
# In a stabilization diagram a pole is stable when its natural frequency changes by less than 1 %
# and its damping ratio by less than 10 %, the usual thresholds of modal analysis (Ewins 2000).
FREQUENCY_TOLERANCE = 0.01
DAMPING_TOLERANCE = 0.10
# Stable poles whose frequencies differ by less than this share belong to one mode.
SAME_POLES = 0.02
PERSISTENT_ORDERS = 3  # a mode persists when its pole appears at this many successive orders


@dataclass(frozen=True, eq=False)
class OrderModel:
    """The model of one order."""

    order: int  # that was searched: with a noise model beside the plant there are more states
    bic: float
    model: Model  # without its covariance: large, and behind the errors of the modes
    modes: tuple[Mode, ...]

    @classmethod
    def of(
        cls, order: int, bic: float, model: Model, modes: tuple[Mode, ...] | None = None
    ) -> Self:
        """The entry of a model with its covariance; ``modes`` where they are known."""
        known = tuple(model.modes()) if modes is None else modes
        return cls(order, bic, replace(model, covariance=None), known)


@dataclass(frozen=True, eq=False)
class OrderModels:
    """The models of all orders that a search of one form went through, by order."""

    models: tuple[OrderModel, ...]


def match_modes(estimates: Sequence[Mode], references: Sequence[Mode]) -> dict[int, int]:
    """Pair modes by natural frequency, each at most once: indices of references by estimate.

    As many as possible, none further apart than :data:`SAME_MODE`, with the least sum of squared
    distances in the logarithm of frequency.
    """
    if not estimates or not references:
        return {}
    first, second = ([math.log(m.frequency_hz) for m in modes] for modes in (estimates, references))
    distance = np.abs(np.subtract.outer(first, second))
    return paired(np.where(distance <= math.log(1 + SAME_MODE), distance**2, np.inf))


def paired(costs: Array) -> dict[int, int]:
    """The columns of rows, (n, m), each taken once, at the least cost; none of infinite cost."""
    # One large cost for all of these, so that none displaces a good pair.
    rows, columns = scipy.optimize.linear_sum_assignment(np.where(np.isfinite(costs), costs, 1e3))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {row: column for row, column in pairs if np.isfinite(costs[row, column])}


def matched_modes(models: Sequence[Sequence[Mode]]) -> list[tuple[Mode | None, ...]]:
    """The modes of several models, a row for each mode by frequency; None where a model has none.

    The modes of each further model are paired with those of the models before it.
    """
    rows: list[list[Mode | None]] = []
    for place, modes in enumerate(models):
        pairs = match_modes(modes, [next(filter(None, row)) for row in rows])
        for index, mode in enumerate(modes):
            if index not in pairs:
                rows.append([None] * len(models))
            rows[pairs.get(index, -1)][place] = mode
    return sorted(map(tuple, rows), key=lambda row: next(filter(None, row)).frequency_hz)


def deviations(estimate: Mode, truth: Mode) -> tuple[float, float]:
    """Estimate minus truth of frequency and damping, in standard errors; NaN without any."""
    differences = (
        (estimate.frequency_hz - truth.frequency_hz, estimate.frequency_se_hz),
        (estimate.damping_ratio - truth.damping_ratio, estimate.damping_se),
    )
    of_frequency, of_damping = (
        difference / error if math.isfinite(error) and error > 0.0 else math.nan
        for difference, error in differences
    )
    return of_frequency, of_damping


def mode_distance(first: Mode, second: Mode) -> float:
    """Distance of two estimates of what may be one mode; above 1 they are not.

    The largest of the differences of frequency, damping and shape, relative to what is allowed.
    """
    frequency = 0.5 * (first.frequency_hz + second.frequency_hz)
    damping = 0.5 * (abs(first.damping_ratio) + abs(second.damping_ratio))
    return max(
        abs(first.frequency_hz - second.frequency_hz)
        / _allowed(SAME_FREQUENCY * frequency, first.frequency_se_hz, second.frequency_se_hz),
        abs(first.damping_ratio - second.damping_ratio)
        / _allowed(SAME_DAMPING * damping, first.damping_se, second.damping_se),
        (1.0 - assurance(first.shape, second.shape))
        / max(1.0 - SAME_SHAPE, _loss_by_noise(first) + _loss_by_noise(second)),
    )


def with_spread(modes: Sequence[Mode], rivals: Sequence[Sequence[Mode]]) -> tuple[Mode, ...]:
    """Modes whose standard errors contain the mean squared difference to those of other models.

    That of their shapes as well, scaled alike; the assurance that a shape is expected to have is
    less by what those of the others lack.

    ``rivals``: of models that could have been chosen as well, where they have the mode.
    """

    def widened(mode: Mode) -> Mode:
        nearest = [min(known, key=partial(mode_distance, mode)) for known in rivals if known]
        same = [near for near in nearest if mode_distance(mode, near) <= OF_RIVAL] or [mode]
        frequency = np.mean([(near.frequency_hz - mode.frequency_hz) ** 2 for near in same])
        damping = np.mean([(near.damping_ratio - mode.damping_ratio) ** 2 for near in same])
        largest = int(np.argmax(np.abs(mode.shape)))
        apart = np.array([near.shape / near.shape[largest] - mode.shape for near in same])
        loss = np.mean([1.0 - assurance(near.shape, mode.shape) for near in same])
        return replace(
            mode,
            frequency_se_hz=math.hypot(mode.frequency_se_hz, math.sqrt(frequency)),
            damping_se=math.hypot(mode.damping_se, math.sqrt(damping)),
            shape_se_real=np.hypot(mode.shape_se_real, np.sqrt(np.mean(apart.real**2, axis=0))),
            shape_se_imag=np.hypot(mode.shape_se_imag, np.sqrt(np.mean(apart.imag**2, axis=0))),
            shape_assurance=float(np.maximum(mode.shape_assurance - loss, 0.0)),
        )

    return tuple(map(widened, modes))


def cluster_modes(
    modes: Mapping[int, Sequence[Mode]],
    distance_of: Callable[[int, Mode, int, Mode], float] = lambda _, a, __, b: mode_distance(a, b),
) -> list[dict[int, int]]:
    """Group the modes of models of several orders, or set-ups, the nearest pairs first.

    Returns the index of the mode by order for each group, by increasing median frequency.
    """
    nodes = [(order, index) for order in sorted(modes) for index in range(len(modes[order]))]
    pairs = []
    for (a, (order, index)), (b, (second, place)) in combinations(enumerate(nodes), 2):
        if second != order:
            distance = distance_of(order, modes[order][index], second, modes[second][place])
            if distance <= 1.0:
                pairs.append((distance, a, b))
    group_of = list(range(len(nodes)))
    groups = {k: {order: index} for k, (order, index) in enumerate(nodes)}
    for _, a, b in sorted(pairs):
        into, from_ = group_of[a], group_of[b]
        if into == from_ or groups[into].keys() & groups[from_].keys():
            continue
        groups[into] |= groups.pop(from_)
        group_of = [into if group == from_ else group for group in group_of]

    return sorted(
        groups.values(),
        key=lambda group: np.median([modes[order][k].frequency_hz for order, k in group.items()]),
    )


def _allowed(relative: float, *standard_errors: float) -> float:
    """The larger of a tolerance and some standard errors of the difference, as far as known."""
    known = (standard_error for standard_error in standard_errors if math.isfinite(standard_error))
    return max(relative, STANDARD_ERRORS * math.hypot(*known), 1e-300)


def _loss_by_noise(mode: Mode) -> float:
    """Expected ``1 - MAC`` of an estimated shape with the true one; 0 where it is not known."""
    return 1.0 - mode.shape_assurance if math.isfinite(mode.shape_assurance) else 0.0


def may_be(mode: Mode, modes: Sequence[Mode]) -> bool:
    """Whether a mode may be one of others, by its frequency."""
    width = max(SAME_FREQUENCY, mode.damping_ratio) * mode.frequency_hz
    width = max(width, STANDARD_ERRORS * np.nan_to_num(mode.frequency_se_hz, posinf=0.0))
    return any(abs(known.frequency_hz - mode.frequency_hz) <= width for known in modes)


Status = Literal["new", "frequency", "stable"]


@dataclass(frozen=True)
class PoleOfOrder:
    """An oscillating pole at one order of a stabilization diagram.

    Its status compares it with the poles of the next lower order: none at this frequency, one at
    this frequency, or one at this frequency and damping ratio.
    """

    order: int
    frequency_hz: float
    damping_ratio: float
    status: Status
    frequency_se_hz: float = math.nan
    damping_se: float = math.nan
    phase_collinearity: float = math.nan
    mode: int | None = None  # row of the table of modes that it belongs to


def stabilization(
    modes: Mapping[int, Sequence[Mode]], row_of: Mapping[tuple[int, int], int] | None = None
) -> list[PoleOfOrder]:
    """Modes by the order of their model, each compared with those of the next lower order.

    ``row_of``: rows of the table of modes by order and index.  By order, then as they are given.
    """
    poles: list[PoleOfOrder] = []
    below: Sequence[Mode] = []
    for order in sorted(modes):
        poles += [
            PoleOfOrder(
                order=order,
                frequency_hz=mode.frequency_hz,
                damping_ratio=mode.damping_ratio,
                status=_status(mode, below),
                frequency_se_hz=mode.frequency_se_hz,
                damping_se=mode.damping_se,
                phase_collinearity=mode.phase_collinearity,
                mode=(row_of or {}).get((order, index)),
            )
            for index, mode in enumerate(modes[order])
        ]
        below = modes[order]
    return poles


def persistent_frequencies(poles: Sequence[PoleOfOrder]) -> list[float]:
    """Median natural frequencies in Hz of the modes that persist over the orders.

    Stable poles are grouped by frequency; one that is stable at n - 1 orders was present at n.
    """
    stable = sorted((pole.frequency_hz, pole.order) for pole in poles if pole.status == "stable")
    apart = [k for k, (a, b) in enumerate(pairwise(stable), 1) if b[0] - a[0] > SAME_POLES * b[0]]
    groups = [stable[begin:end] for begin, end in pairwise([0, *apart, len(stable)])]
    return [
        median(frequency for frequency, _ in group)
        for group in groups
        if len({order for _, order in group}) >= PERSISTENT_ORDERS - 1
    ]


def _status(mode: Mode, below: Sequence[Mode]) -> Status:
    width = FREQUENCY_TOLERANCE * mode.frequency_hz
    near = [lower for lower in below if abs(lower.frequency_hz - mode.frequency_hz) <= width]
    if not near:
        return "new"
    tolerance = DAMPING_TOLERANCE * abs(mode.damping_ratio)
    alike = any(abs(lower.damping_ratio - mode.damping_ratio) <= tolerance for lower in near)
    return "stable" if alike else "frequency"
