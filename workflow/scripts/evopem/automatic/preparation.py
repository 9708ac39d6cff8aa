"""Preparation of recordings, decided: start, gaps, decimation, differences, objective."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.breaks import decide_clipping, decide_starts, decide_stuck, standing_still
from evopem.automatic.decimation import MOST_DECIMATED, decide_decimation, decimated_stretch
from evopem.automatic.decision import Decision, given_by_configuration
from evopem.automatic.drift import decide_differences, differenced
from evopem.automatic.fit import FitSettings
from evopem.automatic.objective import decide_objective
from evopem.automatic.stretches import MOST_SAMPLES, SHORTEST_STRETCH, first_samples
from evopem.errors import InputError
from evopem.estimation.criteria import power_of_two_scale
from evopem.models.polynomial import PolynomialModel
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Recording, Segment

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class GivenPreparation:
    """What a configuration decides of the preparation; None is left to the recording."""

    start: int | None = None  # first sample kept of each recording
    factor: int | None = None  # of the decimation
    differences: int | None = None  # further ones of all channels
    objective: str | None = None
    box_cox: bool = False  # whether the configuration says what is done
    rate_alone: bool = False  # whether only start and rate are decided, as for state-space models


@dataclass(frozen=True)
class PreparationPlan:
    """What is done to recordings, before anything is estimated."""

    starts: tuple[int, ...]  # first sample kept of each recording
    factor: int  # of the decimation
    clipped: tuple[float, float]  # limits of the output whose samples are breaks; or infinite
    objective: str
    input_offsets: tuple[float, ...]  # means of the estimation samples, after differences
    output_offsets: tuple[float, ...]
    input_scales: tuple[float, ...]  # powers of two by which the samples are divided
    output_scales: tuple[float, ...]
    decisions: tuple[Decision, ...]
    stuck: bool = False  # whether stretches in which the output stands still are breaks
    differences: int = 0  # how often all channels are differenced, after decimation

    def __post_init__(self) -> None:
        # JSON has no infinity: no limit comes back as NaN.
        low, high = self.clipped
        limits = (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)
        object.__setattr__(self, "clipped", limits)

    @classmethod
    def unchanged(cls, recording: Recording, **changes: Any) -> PreparationPlan:
        """The plan that changes nothing of a recording, but for some of its fields."""
        inputs, outputs = recording.inputs.shape[1], recording.outputs.shape[1]
        plan = cls(
            *((0,) * len(recording.segment_starts), 1, (-np.inf, np.inf), "quadratic"),
            *((0.0,) * inputs, (0.0,) * outputs, (1.0,) * inputs, (1.0,) * outputs, ()),
        )
        return replace(plan, **changes)

    def for_others(self, recording: Recording) -> PreparationPlan:
        """The same for other recordings, whose first samples are kept, and without breaks."""
        starts = (0,) * len(recording.segment_starts)
        return replace(self, starts=starts, clipped=(-np.inf, np.inf), stuck=False)

    @property
    def uncentred(self) -> PreparationPlan:
        """The same preparation that takes no means."""
        offsets = (0.0,) * len(self.input_offsets), (0.0,) * len(self.output_offsets)
        return replace(self, input_offsets=offsets[0], output_offsets=offsets[1])

    def without_offsets(self, stretch: Segment) -> Segment:
        """A stretch less the means."""
        return replace(
            stretch,
            inputs=stretch.inputs - np.array(self.input_offsets),
            outputs=stretch.outputs - np.array(self.output_offsets),
        )

    def scaled(self, stretch: Segment) -> Segment:
        """A stretch as the estimation takes it."""
        return replace(
            stretch,
            inputs=stretch.inputs / np.array(self.input_scales),
            outputs=stretch.outputs / np.array(self.output_scales),
        )


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """Scaled stretches ready for estimation, their rate (Hz), and how they came about."""

    stretches: tuple[Segment, ...]
    sampling_rate: float
    plan: PreparationPlan

    @classmethod
    def of(cls, prepared: PreparedData, plan: PreparationPlan) -> PreparedRecord:
        """The estimation samples of prepared data."""
        stretches = tuple(plan.scaled(each) for each in prepared.estimation.segments)
        return cls(stretches, prepared.estimation.sampling_rate, plan)

    @property
    def settings(self) -> FitSettings:
        """What all fits have in common."""
        return FitSettings(self.plan.objective)

    def in_its_units(self, model: PolynomialModel) -> PolynomialModel:
        """A model of the scaled stretches in the units of the recording, less the offsets."""
        (scale,) = self.plan.output_scales
        ratios = [scale / each for each in self.plan.input_scales]
        return replace(
            model,
            B=tuple(b * ratio for b, ratio in zip(model.B, ratios, strict=True)),
            level=model.level * scale,
            noise_variance=model.noise_variance * scale**2,
            sampling_rate=self.sampling_rate,
        )


def decide_preparation(
    recording: Recording, given: GivenPreparation = GivenPreparation(), names: Sequence[str] = ()
) -> PreparationPlan:
    """Decide how recordings of one system, the segments of one, are prepared.

    Breaks, differences and the objective are decided for polynomial models of one output that
    responds to one input: a break of one channel would be one of all.

    `recording`: Samples that are not finite are breaks. `given`: What is not decided here.
    """
    records = recording.separated
    if given.start is None:
        starts, about_start = decide_starts(records)
    else:
        starts = (given.start,) * len(records)
        about_start = given_by_configuration("start", str(given.start))
    decisions = [about_start]
    plan = PreparationPlan.unchanged(recording, starts=starts)
    has_one_of_each = recording.inputs.shape[1] == recording.outputs.shape[1] == 1
    has_one_of_each = has_one_of_each and not given.rate_alone
    if has_one_of_each:
        clipped, about_clipping = decide_clipping(records, starts)
        stuck, about_stuck = decide_stuck(records, starts)
        decisions += [about_clipping, about_stuck]
        plan = replace(plan, clipped=clipped, stuck=stuck)
    _check_stretches(recording, plan, names)
    plan = _centred(recording, plan)

    def first_prepared(most: int) -> list[Segment]:
        """The first samples, by what is decided before."""
        return list(first_samples(prepare(recording, plan).stretches, most))

    factor, about_factor = _given_or(
        "decimation", given.factor, lambda: decide_decimation(first_prepared(MOST_DECIMATED))
    )
    decisions.append(about_factor)
    plan = replace(plan, factor=factor)
    if has_one_of_each:
        differences, about_differences = _given_or(
            *("differences", given.differences),
            lambda: decide_differences(first_prepared(MOST_DECIMATED)),
        )
        if differences:
            plan = _centred(recording, replace(plan, differences=differences))
        objective, about_objective = _given_or(
            *("objective", given.objective),
            lambda: decide_objective(first_prepared(MOST_SAMPLES)),
        )
        decisions += [about_differences, about_objective]
        plan = replace(plan, objective=objective)
    elif given.objective is not None:
        plan = replace(plan, objective=given.objective)
    return replace(plan, decisions=tuple(decisions))


def stretches_as_recorded(
    recording: Recording, start: int | None
) -> tuple[list[Segment], list[int]]:
    """The stretches of recordings before any decision on their rate, and where each begins.

    ``start`` is the first sample kept, where it is given.
    """
    plan = decide_preparation(recording, GivenPreparation(start, 1, 0, "quadratic"))
    begins = [
        begin
        for segment, first in zip(recording.segments, plan.starts, strict=True)
        for begin, _ in kept_ranges(segment, first, plan)
    ]
    return _raw_stretches(recording, plan), begins


def _given_or(
    subject: str, value: T | None, decide: Callable[[], tuple[T, Decision]]
) -> tuple[T, Decision]:
    return decide() if value is None else (value, given_by_configuration(subject, str(value)))


def _check_stretches(recording: Recording, plan: PreparationPlan, names: Sequence[str]) -> None:
    """Refuse recordings that are too short without a gap, and channels that never change."""
    stretches = _raw_stretches(recording, plan)
    kept = {each.recording for each in stretches}
    for place, number in enumerate(recording.segment_recordings):
        if number not in kept:
            raise InputError(
                names[place] if names else f"recording {number + 1}",
                f"no stretch for estimation has {SHORTEST_STRETCH} samples without a gap",
                "give a longer recording, or one with fewer missing samples",
            )
    inputs = np.concatenate([each.inputs for each in stretches])
    outputs = np.concatenate([each.outputs for each in stretches])
    for name, signal in replace(recording, inputs=inputs, outputs=outputs).signals.items():
        if np.ptp(signal) == 0.0:
            raise InputError(
                name,
                f"every sample is {signal[0]:g}, so there is nothing to identify",
                "choose a channel that varies",
            )


def _centred(recording: Recording, plan: PreparationPlan) -> PreparationPlan:
    """A plan with the means and scales of the signals that it prepares."""
    inputs, outputs = recording.inputs.shape[1], recording.outputs.shape[1]
    unchanged = replace(
        plan.uncentred, input_scales=(1.0,) * inputs, output_scales=(1.0,) * outputs
    )
    stretches = prepare(recording, unchanged).stretches
    u = np.concatenate([each.inputs for each in stretches])
    y = np.concatenate([each.outputs for each in stretches])
    means = u.mean(axis=0), y.mean(axis=0)
    return replace(
        plan,
        input_offsets=tuple(means[0].tolist()),
        output_offsets=tuple(means[1].tolist()),
        input_scales=tuple(map(power_of_two_scale, (u - means[0]).T)),
        output_scales=tuple(map(power_of_two_scale, (y - means[1]).T)),
    )


def prepare(recording: Recording, plan: PreparationPlan) -> PreparedRecord:
    """Apply a plan to the recordings that it was made for."""
    stretches = []
    for each in _raw_stretches(recording, plan):
        stretch = differenced(decimated_stretch(each, plan.factor), plan.differences)
        stretches.append(plan.scaled(plan.without_offsets(stretch)))
    return PreparedRecord(tuple(stretches), recording.sampling_rate / plan.factor, plan)


def _raw_stretches(recording: Recording, plan: PreparationPlan) -> list[Segment]:
    """Samples between breaks, in recorded units and at the recorded rate."""
    return [
        segment.between(*kept)
        for segment, start in zip(recording.segments, plan.starts, strict=True)
        for kept in kept_ranges(segment, start, plan)
    ]


def kept_ranges(segment: Segment, start: int, plan: PreparationPlan) -> list[tuple[int, int]]:
    """First sample of each stretch from ``start`` on that is long enough, and the one after it.

    At the recorded rate.
    """
    signals = np.column_stack([segment.inputs, segment.outputs])
    good = np.isfinite(np.sum(signals, axis=1))
    y, (low, high) = segment.outputs[good], plan.clipped
    good[good] &= ((y > low) & (y < high)).all(axis=1)
    good[:start] = False
    if plan.stuck:
        good &= ~standing_still(segment.output)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    least = SHORTEST_STRETCH * plan.factor
    ranges = [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
    return [(begin, end) for begin, end in ranges if end - begin >= least]
