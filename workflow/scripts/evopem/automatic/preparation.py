"""Preparation of recordings, decided: start, gaps, decimation, objective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.breaks import decide_clipping, decide_starts, decide_stuck, standing_still
from evopem.automatic.decimation import MOST_DECIMATED, decide_decimation, decimated
from evopem.automatic.decision import Decision, given_by_configuration
from evopem.automatic.drift import decide_differences, differenced
from evopem.automatic.fit import FitSettings
from evopem.automatic.objective import decide_objective
from evopem.automatic.orders import MOST_SAMPLES
from evopem.automatic.stretches import first_samples
from evopem.automatic.transforms import TransformPlan
from evopem.errors import InputError
from evopem.estimation.criteria import power_of_two_scale
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording, Segment

Array = NDArray[np.float64]

# A stretch shorter than this is of no use.
SHORTEST_STRETCH = 20


@dataclass(frozen=True)
class GivenPreparation:
    """What a configuration decides of the preparation; None is left to the recording.

    Attributes
    ----------
    start : int, optional
        First sample kept of each recording.
    factor : int, optional
        Decimation factor.
    differences : int, optional
        Further differences of both channels.
    objective : {"absolute", "quadratic"}, optional
    box_cox : bool
        Whether the configuration says what is done.
    """

    start: int | None = None
    factor: int | None = None
    differences: int | None = None
    objective: str | None = None
    box_cox: bool = False


@dataclass(frozen=True)
class PreparationPlan:
    """What is done to recordings, before anything is estimated.

    Attributes
    ----------
    starts : tuple of int
        First sample kept of each recording.
    factor : int
        Decimation factor.
    clipped : tuple of float
        Limits of the output, whose samples are breaks: lowest and highest, infinite for none.
    objective : {"absolute", "quadratic"}
    input_offset, output_offset : float
        Means of the estimation samples, after differences, taken from all samples.
    input_scale, output_scale : float
        Powers of two by which the samples are divided.
    decisions : tuple of Decision
    stuck : bool
        Whether stretches in which the output stands still are breaks.
    transforms : TransformPlan
        What is done to the recordings before everything else.
    differences : int
        How often both channels are differenced, after decimation.
    """

    starts: tuple[int, ...]
    factor: int
    clipped: tuple[float, float]
    objective: str
    input_offset: float
    output_offset: float
    input_scale: float
    output_scale: float
    decisions: tuple[Decision, ...]
    stuck: bool = False
    transforms: TransformPlan = field(default_factory=TransformPlan)
    differences: int = 0

    def __post_init__(self) -> None:
        # JSON has no infinity: no limit comes back as NaN.
        low, high = self.clipped
        limits = (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)
        object.__setattr__(self, "clipped", limits)


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """Stretches ready for estimation, and how they came about.

    Attributes
    ----------
    stretches : tuple of Segment
    sampling_rate : float
        Hz, after decimation.
    plan : PreparationPlan
    """

    stretches: tuple[Segment, ...]
    sampling_rate: float
    plan: PreparationPlan

    @property
    def settings(self) -> FitSettings:
        """What all fits have in common."""
        return FitSettings(self.plan.objective)

    def in_its_units(self, model: PolynomialModel) -> PolynomialModel:
        """A model of the scaled stretches in the units of the recording, less the offsets."""
        return replace(
            model,
            B=tuple(b * (self.plan.output_scale / self.plan.input_scale) for b in model.B),
            level=model.level * self.plan.output_scale,
            noise_variance=model.noise_variance * self.plan.output_scale**2,
            sampling_rate=self.sampling_rate,
        )


def decide_preparation(
    recordings: Sequence[Recording],
    given: GivenPreparation = GivenPreparation(),
) -> PreparationPlan:
    """Decide how recordings of one system are prepared.

    Parameters
    ----------
    recordings : sequence of Recording
        Samples that are not finite are breaks.
    given : GivenPreparation
        What is not decided here.

    Raises
    ------
    InputError
        When no stretch without breaks is long enough, or the sampling rates differ.
    """
    _check_one_rate(recordings)
    if given.start is None:
        starts, about_start = decide_starts(recordings)
    else:
        starts = (given.start,) * len(recordings)
        about_start = given_by_configuration("start", str(given.start))
    clipped, about_clipping = decide_clipping(recordings, starts)
    stuck, about_stuck = decide_stuck(recordings, starts)
    plan = PreparationPlan(starts, 1, clipped, "quadratic", 0.0, 0.0, 1.0, 1.0, (), stuck)
    _check_varying(_raw_stretches(recordings, plan))
    plan = _centred(recordings, plan)

    def first_prepared(most: int) -> list[Segment]:
        """The first samples, by what is decided before."""
        return list(first_samples(prepare(recordings, plan).stretches, most))

    if given.factor is None:
        factor, about_factor = decide_decimation(first_prepared(MOST_DECIMATED))
    else:
        factor, about_factor = given.factor, given_by_configuration("decimation", str(given.factor))
    plan = replace(plan, factor=factor)
    if given.differences is None:
        differences, about_differences = decide_differences(first_prepared(MOST_DECIMATED))
    else:
        differences = given.differences
        about_differences = given_by_configuration("differences", str(differences))
    if differences:
        plan = _centred(recordings, replace(plan, differences=differences))
    if given.objective is None:
        objective, about_objective = decide_objective(first_prepared(MOST_SAMPLES))
    else:
        objective = given.objective
        about_objective = given_by_configuration("objective", objective)
    decisions = (
        *(about_start, about_clipping, about_factor, about_differences),
        *(about_objective, about_stuck),
    )
    return replace(plan, objective=objective, decisions=decisions)


def _check_one_rate(recordings: Sequence[Recording]) -> None:
    rates = {each.sampling_rate for each in recordings}
    if len(rates) != 1:
        raise InputError(
            "recordings",
            f"their sampling rates differ: {', '.join(f'{rate:g} Hz' for rate in sorted(rates))}",
            "give recordings of one rate",
        )


def _check_varying(stretches: Sequence[Segment]) -> None:
    if not stretches:
        raise InputError(
            "recordings",
            f"no stretch has {SHORTEST_STRETCH} samples without a gap",
            "give a longer recording, or one with fewer missing samples",
        )
    signals = {
        "input": np.concatenate([each.input for each in stretches]),
        "output": np.concatenate([each.output for each in stretches]),
    }
    for name, signal in signals.items():
        if np.ptp(signal) == 0.0:
            raise InputError(
                name,
                f"every sample is {signal[0]:g}, so there is nothing to identify",
                "choose a channel that varies",
            )


def stretches_as_recorded(
    recordings: Sequence[Recording], start: int | None
) -> tuple[list[Segment], list[int]]:
    """The stretches of recordings before any decision on their rate, and where each begins.

    Parameters
    ----------
    recordings : sequence of Recording
    start : int, optional
        First sample kept, where it is given.

    Raises
    ------
    InputError
        When no stretch without breaks is long enough.
    """
    plan = decide_preparation(recordings, GivenPreparation(start, 1, 0, "quadratic"))
    begins = [
        begin
        for recording, first in zip(recordings, plan.starts, strict=True)
        for begin, _ in kept_ranges(recording, first, plan)
    ]
    return _raw_stretches(recordings, plan), begins


def _centred(recordings: Sequence[Recording], plan: PreparationPlan) -> PreparationPlan:
    """A plan with the means and scales of the signals that it prepares."""
    unchanged = replace(
        plan, input_offset=0.0, output_offset=0.0, input_scale=1.0, output_scale=1.0
    )
    stretches = prepare(recordings, unchanged).stretches
    u = np.concatenate([each.input for each in stretches])
    y = np.concatenate([each.output for each in stretches])
    return replace(
        plan,
        input_offset=float(u.mean()),
        output_offset=float(y.mean()),
        input_scale=power_of_two_scale(u - u.mean()),
        output_scale=power_of_two_scale(y - y.mean()),
    )


def prepare(recordings: Sequence[Recording], plan: PreparationPlan) -> PreparedRecord:
    """Apply a plan to the recordings that it was made for.

    Parameters
    ----------
    recordings : sequence of Recording
    plan : PreparationPlan
    """
    return PreparedRecord(
        tuple(_scaled(each, plan) for each in _raw_stretches(recordings, plan)),
        recordings[0].sampling_rate / plan.factor,
        plan,
    )


def prepare_validation(recording: Recording, plan: PreparationPlan) -> tuple[Segment, ...]:
    """Apply a plan to another recording, whose first samples are kept.

    Parameters
    ----------
    recording : Recording
    plan : PreparationPlan
    """
    others = replace(plan, starts=(0,), clipped=(-np.inf, np.inf), stuck=False)
    return prepare((recording,), others).stretches


def undifferenced(plan: PreparationPlan) -> PreparationPlan:
    """The same preparation without its differences, and without means."""
    return replace(plan, differences=0, input_offset=0.0, output_offset=0.0)


def _scaled(stretch: Segment, plan: PreparationPlan) -> Segment:
    lower = Segment(
        decimated(stretch.input, plan.factor),
        decimated(stretch.output, plan.factor),
        stretch.recording,
    )
    lower = differenced(lower, plan.differences)
    return Segment(
        (lower.input - plan.input_offset) / plan.input_scale,
        (lower.output - plan.output_offset) / plan.output_scale,
        stretch.recording,
    )


def _raw_stretches(recordings: Sequence[Recording], plan: PreparationPlan) -> list[Segment]:
    """Samples between breaks, in recorded units and at the recorded rate."""
    found = []
    for number, (recording, start) in enumerate(zip(recordings, plan.starts, strict=True)):
        for begin, end in kept_ranges(recording, start, plan):
            kept = slice(begin, end)
            found.append(Segment(recording.input[kept], recording.output[kept], number))
    return found


def kept_ranges(recording: Recording, start: int, plan: PreparationPlan) -> list[tuple[int, int]]:
    """First sample of each stretch that is long enough and the one after its last.

    At the recorded rate.

    Parameters
    ----------
    recording : Recording
    start : int
        First sample kept.
    plan : PreparationPlan
    """
    u, y = recording.input, recording.output
    low, high = plan.clipped
    good = np.isfinite(u) & np.isfinite(y)
    good[good] &= (y[good] > low) & (y[good] < high)
    good[:start] = False
    if plan.stuck:
        good &= ~standing_still(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    least = SHORTEST_STRETCH * plan.factor
    ranges = [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
    return [(begin, end) for begin, end in ranges if end - begin >= least]
