"""Preparation of recordings, decided: start, gaps, decimation, high-pass filter, objective."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from evopem.arrays import Array
from evopem.automatic.cross_validation.stretches import (
    MOST_SAMPLES,
    SHORTEST_STRETCH,
    first_samples,
)
from evopem.automatic.decision import Decision, given_by_configuration
from evopem.automatic.fit import recording_of
from evopem.automatic.preparation import wrong_samples
from evopem.automatic.preparation.decimation import (
    MOST_DECIMATED,
    decide_decimation,
    decimated_stretch,
)
from evopem.automatic.preparation.disturbance import decide_high_pass, decide_objective, passed
from evopem.config.settings import GivenPreparation, Objective
from evopem.errors import InputError
from evopem.estimation.criteria import power_of_two_scale
from evopem.models.polynomial import Model
from evopem.signals.faulty_samples import runs_of
from evopem.signals.prepared_data import PreparedData, Rows, StretchOrigin
from evopem.signals.recording import Recording, Segment
from evopem.signals.transforms import NO_FILTER, HighPass, difference, invert_difference

Decided = tuple[object, Decision]


@dataclass(frozen=True)
class PreparationPlan:
    """What is done to recordings, before anything is estimated."""

    starts: tuple[int, ...]  # first sample kept of each recording
    factor: int = 1  # of the decimation
    clipped: tuple[float, float] = (-np.inf, np.inf)  # limits of the output: samples are breaks
    objective: Objective = "quadratic"
    decisions: tuple[Decision, ...] = ()
    stuck: bool = False  # whether stretches in which the output stands still are breaks
    high_pass: HighPass = NO_FILTER  # of all channels, after decimation

    def __post_init__(self) -> None:
        # JSON has no infinity: no limit comes back as NaN.
        low, high = self.clipped
        limits = (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)
        object.__setattr__(self, "clipped", limits)


class Stretch(NamedTuple):
    """Samples between breaks, decimated and not yet filtered."""

    place: int  # of its recording
    begin: int  # its first sample in it, before decimation
    segment: Segment


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """Stretches ready for estimation, without means and scaled, and their plan."""

    stretches: tuple[Segment, ...]
    sampling_rate: float  # Hz
    plan: PreparationPlan
    scales: tuple[Array, Array]  # powers of two by which inputs and outputs are divided

    @classmethod
    def of(cls, recording: Recording, plan: PreparationPlan) -> Self:
        """The stretches of a recording over powers of two."""
        scales = [
            np.array([power_of_two_scale(signal) for signal in signals.T])
            for signals in (recording.inputs, recording.outputs)
        ]
        scaled = (
            replace(segment, inputs=segment.inputs / scales[0], outputs=segment.outputs / scales[1])
            for segment in recording.segments
        )
        return cls(tuple(scaled), recording.sampling_rate, plan, (scales[0], scales[1]))

    def in_its_units(self, model: Model) -> Any:
        """A model of the scaled stretches in the units of the recording."""
        return replace(model.scaled(*self.scales), sampling_rate=self.sampling_rate)


def means_of(stretches: Sequence[Segment]) -> tuple[Array, Array]:
    """Means of the inputs, (m,), and of the outputs, (l,), of all stretches."""
    u = np.concatenate([stretch.inputs for stretch in stretches])
    y = np.concatenate([stretch.outputs for stretch in stretches])
    return u.mean(axis=0), y.mean(axis=0)


def centred(stretches: Sequence[Segment]) -> list[Segment]:
    """Stretches less the means of all."""
    u, y = means_of(stretches)
    return [replace(s, inputs=s.inputs - u, outputs=s.outputs - y) for s in stretches]


_NOTHING_GIVEN = GivenPreparation()


def decide_preparation(
    recording: Recording, given: GivenPreparation = _NOTHING_GIVEN, names: Sequence[str] = ()
) -> PreparationPlan:
    """Decide how recordings of one system, the segments of one, are prepared.

    Breaks are decided for one output, as one of several would break all; a filter where there is an
    input: without one a random walk is no disturbance, but the system.

    `recording`: Samples that are not finite are breaks. `given`: What is not decided here.
    """
    records = recording.separated
    plan = PreparationPlan((0,) * len(records))

    def first_prepared(most: int = MOST_DECIMATED) -> list[Segment]:
        """The first samples, by what is decided before."""
        return list(first_samples(prepare(recording, plan).stretches, most))

    def settle(
        subject: str, field: str, decide: Callable[[], Decided], value: object = None
    ) -> None:
        nonlocal plan
        setting, about = (value, given_by_configuration(subject, str(value)))
        if value is None:
            setting, about = decide()
        changes = {field: setting, "decisions": (*plan.decisions, about)}
        plan = replace(plan, **changes)  # type: ignore[arg-type]

    def usable(field: str, decide: Callable[..., Decided]) -> Decided:
        """Breaks, or none where they leave no stretch of a recording."""
        breaks, about = decide(records, plan.starts)
        broken = replace(plan, **{field: breaks})  # type: ignore[arg-type]
        if _recordings(recording, broken) == _recordings(recording, plan):
            return breaks, about
        sentence = f"Breaks would leave no stretch of {SHORTEST_STRETCH} samples: there are none."
        kept = replace(about, choice=about.alternatives[0].name, sentence=sentence)
        return getattr(plan, field), kept

    settle("start", "starts", lambda: wrong_samples.decide_starts(records), given.start)
    if given.start is not None:
        plan = replace(plan, starts=(given.start,) * len(records))
    if recording.outputs.shape[1] == 1:
        settle("clipping", "clipped", lambda: usable("clipped", wrong_samples.decide_clipping))
        settle("stuck samples", "stuck", lambda: usable("stuck", wrong_samples.decide_stuck))
    _check_stretches(recording, plan, names)
    settle("decimation", "factor", lambda: decide_decimation(first_prepared()), given.factor)
    if recording.has_input:
        written = None if given.differences is None else HighPass(given.differences)
        settle("drift", "high_pass", lambda: decide_high_pass(first_prepared()), written)
    recorded = [stretch.segment for stretch in stretches_of(recording, plan)]
    settle(
        *("objective", "objective"),
        *(lambda: decide_objective(first_prepared(MOST_SAMPLES), recorded), given.objective),
    )
    return plan


def _recordings(recording: Recording, plan: PreparationPlan) -> set[int]:
    """The recordings that have a stretch."""
    return {stretch.segment.recording for stretch in stretches_of(recording, plan)}


def _check_stretches(recording: Recording, plan: PreparationPlan, names: Sequence[str]) -> None:
    """Refuse recordings that are too short without a gap, and channels that never change."""
    stretches = stretches_of(recording, plan)
    for number in dict.fromkeys(recording.segment_recordings):
        if number not in {stretch.segment.recording for stretch in stretches}:
            problem = f"no stretch for estimation has {SHORTEST_STRETCH} samples without a gap"
            remedy = "give a longer recording, or one with fewer missing samples"
            name = names[number] if names else f"recording {number + 1}"
            raise InputError(name, problem, remedy)
    kept = recording.with_segments([stretch.segment for stretch in stretches])
    for name, signal in kept.signals.items():
        if np.ptp(signal) == 0.0:
            problem = f"every sample is {signal[0]:g}, so there is nothing to identify"
            raise InputError(name, problem, "choose a channel that varies")


def prepare(recording: Recording, plan: PreparationPlan) -> PreparedRecord:
    """Apply a plan to the recordings that it was made for."""
    stretches = [passed(s.segment, plan.high_pass) for s in stretches_of(recording, plan)]
    rate = recording.sampling_rate / plan.factor
    return PreparedRecord.of(replace(recording_of(centred(stretches)), sampling_rate=rate), plan)


def stretches_of(recording: Recording, plan: PreparationPlan) -> list[Stretch]:
    """Samples between breaks that are long enough, decimated by a plan and not filtered."""
    return [
        Stretch(place, begin, decimated_stretch(segment.between(begin, end), plan.factor))
        for place, (segment, start) in enumerate(zip(recording.segments, plan.starts, strict=True))
        for begin, end in _kept_ranges(segment, start, plan)
    ]


def _kept_ranges(segment: Segment, start: int, plan: PreparationPlan) -> list[tuple[int, int]]:
    """First sample of each stretch from ``start`` on that is long enough, and the one after it. At
    the recorded rate."""
    signals = np.column_stack([segment.inputs, segment.outputs])
    good = np.isfinite(np.sum(signals, axis=1))
    y, (low, high) = segment.outputs[good], plan.clipped
    good[good] &= ((y > low) & (y < high)).all(axis=1)
    good[:start] = False
    if plan.stuck:
        good &= ~wrong_samples.standing_still(segment.output)
    least = SHORTEST_STRETCH * plan.factor
    return [(begin, end) for begin, end in runs_of(good) if end - begin >= least]


def prepared_data(divided: PreparedData, plan: PreparationPlan, place: str) -> PreparedData:
    """The stretches of both parts as a plan prepares them, and the way back.

    `divided`: Both parts before the decisions; means are taken from them already.
    """
    before, pole = divided.transforms, divided.transforms.difference_pole
    kept = stretches_of(divided.estimation, plan)
    offsets = means_of([passed(stretch.segment, plan.high_pass) for stretch in kept])
    estimation, origins = _part(divided.estimation, before.estimation, plan, offsets, pole)
    # Other recordings keep their first samples, and have no breaks.
    starts = (0,) * len(divided.validation.segment_starts)
    others = replace(plan, starts=starts, clipped=(-np.inf, np.inf), stuck=False)
    validation, held_out = _part(divided.validation, before.validation, others, offsets, pole)
    for origin, whole in zip(before.validation, divided.validation.segments, strict=True):
        if origin.recording not in {origin.recording for origin in held_out}:
            least = f"has the {SHORTEST_STRETCH * plan.factor} without a gap that are needed"
            problem = f"no stretch of {whole.samples} validation samples {least}"
            remedy = "leave more samples to validation, or record longer"
            raise InputError(f"{place}.split", problem, remedy)
    ends = [origin.first + origin.samples for origin in before.estimation]
    continued = (
        plan.factor == 1
        and plan.high_pass.times == 0
        and [origin.first + origin.samples for origin in origins] == ends
    )
    slower = before.sampling_rate if plan.factor > 1 else None
    source = before.validation_source
    transforms = replace(
        before,
        sampling_rate=estimation.sampling_rate,
        resampled_from=before.resampled_from or slower,
        estimation=origins,
        validation=held_out,
        validation_source="gap" if source == "cut" and not continued else source,
        difference=before.difference + plan.high_pass.times,
        difference_input=before.difference_input + plan.high_pass.times,
        difference_pole=plan.high_pass.pole or pole,
    )
    return PreparedData(estimation, validation, transforms)


def _part(
    recording: Recording,
    before: Sequence[StretchOrigin],
    plan: PreparationPlan,
    offsets: tuple[Array, Array],
    pole: float,
) -> tuple[Recording, tuple[StretchOrigin, ...]]:
    """The stretches of a part in recorded units, less their means, and where they come from."""
    rate, times = recording.sampling_rate / plan.factor, plan.high_pass.times
    segments, origins = [], []
    for place, begin, whole in stretches_of(recording, plan):
        origin, segment = before[place], recording.segments[place]
        stretch = passed(whole, plan.high_pass)
        first = (origin.first + begin) // plan.factor + times
        start = origin.start + begin / recording.sampling_rate + times / rate
        signals = stretch.inputs - offsets[0], stretch.outputs - offsets[1]
        segments.append(Segment(*signals, origin.recording, first))
        means = np.array(origin.input_means), np.array(origin.output_means)
        if times:  # no mean of the signals is left in them
            initial = [
                difference(signals + mean, times, plan.high_pass.pole)[1]
                for signals, mean in zip((whole.inputs, whole.outputs), means, strict=True)
            ]
            means = np.zeros_like(means[0]), np.zeros_like(means[1])
        else:
            initial = [
                _later(segment.inputs + means[0], origin.input_initial, begin, pole),
                _later(segment.outputs + means[1], origin.output_initial, begin, pole),
            ]
        origins.append(
            StretchOrigin(
                recording=origin.recording,
                first=first,
                start=start,
                samples=stretch.samples,
                input_means=tuple((means[0] + offsets[0]).tolist()),
                output_means=tuple((means[1] + offsets[1]).tolist()),
                input_initial=initial[0],
                output_initial=initial[1],
            )
        )
    if not segments:
        return recording, ()
    return replace(recording.with_segments(segments), sampling_rate=rate), tuple(origins)


def _later(signals: Array, initial: Rows, begin: int, pole: float) -> Rows:
    """What differences start from, when their first ``begin`` samples are left out."""
    if begin == 0 or not initial:
        return initial
    if pole > 0.0:
        return (tuple((initial[0] + (1.0 - pole) * signals[:begin].sum(axis=0)).tolist()),)
    return difference(invert_difference(signals, initial)[begin:], len(initial))[1]
