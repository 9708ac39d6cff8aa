"""Sentences about the recording and its transforms."""

from __future__ import annotations

import math
from collections.abc import Sequence

from evopem.figures.view import View
from evopem.report.numbers import (
    THIN,
    count,
    enumeration,
    hertz,
    number,
    plural,
    superscript,
    times,
)
from evopem.signals.even_grid import Unevenness
from evopem.signals.prepared_data import Transforms
from evopem.signals.recording_info import RecordingInfo

# Channels of a role that are named.
MOST_NAMED = 6


def recording(view: View) -> list[str]:
    """What was recorded and how it was prepared."""
    transforms, info = view.results.model.transforms, view.results.recording_info
    sentences = [_contents(info)]
    if info.roles is not None:
        sentences.append(info.roles.sentence)
    if info.time_told is not None:
        sentences.append(
            f"The sampling rate is that of the time stamps “{info.time_told}”, which were told by"
            " name."
        )
    sentences += uneven_stamps(info.uneven_times)
    if transforms.resampled_from is not None:
        sentences.append(
            f"It was resampled from {hertz(transforms.resampled_from)} to"
            f" {hertz(transforms.sampling_rate)}."
        )
    steps = enumeration(_output_steps(transforms)) or "not transformed"
    outputs = "output was" if len(view.outputs) == 1 else "outputs were"
    sentences.append(f"The {outputs} {steps}.")
    if transforms.difference_input:
        inputs = "input was" if len(view.inputs) == 1 else "inputs were"
        sentences.append(f"The {inputs} differenced {times(transforms.difference_input)}.")
    sentences.append(_division(transforms))
    sentences.append(_means(transforms, info))
    return [" ".join(sentences)]


def uneven_stamps(times: Sequence[Unevenness]) -> list[str]:
    """How far the stamps were from even ones, and what that means for the signals."""
    ticks = [each.tick for each in times if each.tick]
    coarse = [
        f"The clock of the time stamps is coarse: a tick lasts {number(tick, 3)} samples. But for"
        " that the times are even, and the samples are used as they are."
        for tick in sorted(ticks)[-1:]
    ]
    return coarse + _interpolated([each for each in times if not each.tick])


def _interpolated(times: Sequence[Unevenness]) -> list[str]:
    """How far stamps were from the even times that the signals were brought to."""
    if not times:
        return []
    missing = sum(each.in_gaps for each in times)
    longest = max(each.longest_gap for each in times)
    shift = max(each.largest_shift for each in times)
    gaps = f" {plural(missing, 'sample is', 'samples are')} missing, in gaps of up to"
    gaps += f" {number(longest, 3)} steps."
    return [
        "The time stamps are not even: the signals were interpolated linearly at even times, from"
        f" which a stamp is up to {number(shift, 2)} steps away.{gaps if missing else ''}"
    ]


def _means(transforms: Transforms, info: RecordingInfo) -> str:
    inputs = "The mean of each input" if len(info.inputs) > 1 else "The mean of the input"
    outputs = "the level of each output" if len(info.outputs) > 1 else "the level of the output"
    levels = f"{inputs} and {outputs}" if info.inputs else f"T{outputs[1:]}"
    if not transforms.several_recordings:
        return f"{levels} in the estimation samples are subtracted from all samples."
    return (
        f"{levels} in each recording are subtracted from its samples. Each recording has an initial"
        " state of its own, and nothing is predicted from one to the next."
    )


def _contents(info: RecordingInfo) -> str:
    inputs, outputs = ([each.name for each in role] for role in (info.inputs, info.outputs))
    names = [_role(inputs, "input"), _role(outputs, "output")]
    recordings = "The recording has"
    if len(info.files) > 1:
        recordings = f"{len(info.files)} recordings of one system are one data set. They have"
    return (
        f"{recordings} {count(info.samples)} samples of {' and '.join(filter(None, names))} at"
        f" {hertz(info.sampling_rate)},"
        f" {number(info.samples / info.sampling_rate)}{THIN}s in total."
    )


def _role(names: Sequence[str], role: str) -> str:
    """The channels of a role by their names, where these say more than the role."""
    if len(names) > MOST_NAMED:
        return f"{len(names)} {role}s"
    if list(names) == [role]:
        return f"one {role}"
    return f"{enumeration(list(names))} ({role}{'s' * (len(names) > 1)})" if names else ""


def _output_steps(transforms: Transforms) -> list[str]:
    steps = ["freed of a linear trend"] if any(transforms.output_trends) else []
    if transforms.box_cox is not None:
        if transforms.shift:
            steps.append(f"shifted by {number(transforms.shift)} to be positive")
        steps.append(f"Box-Cox transformed with λ = {number(transforms.box_cox)}")
    if transforms.difference:
        steps.append(f"differenced {times(transforms.difference)}")
    return steps


def _division(transforms: Transforms) -> str:
    if transforms.several_recordings:
        return _division_of_recordings(transforms)
    lead = "The first "
    if transforms.discard:
        lead = f"The first {plural(transforms.discard, 'sample')} are discarded. The next "
    where = {
        "file": "those of an independent recording",
        "gap": "later ones of the same recording",
        "cut": "those that follow without a gap",
        "recordings": "the last recordings",
    }[transforms.validation_source]
    return (
        f"{lead}{plural(transforms.estimation_samples, 'sample')} are used for estimation;"
        f" {plural(transforms.validation_samples, 'sample')}, {where}, are used for validation."
    )


def _division_of_recordings(transforms: Transforms) -> str:
    used = {each.recording for each in transforms.estimation}
    others = {each.recording for each in transforms.validation}
    estimation = plural(transforms.estimation_samples, "sample")
    validation = plural(transforms.validation_samples, "sample")
    discarded = ""
    if transforms.discard:
        discarded = f"The first {plural(transforms.discard, 'sample')} of each are discarded. "
    if transforms.validation_source in ("cut", "gap"):
        return (
            f"{discarded}Of each, the first samples are used for estimation, together {estimation},"
            f" and the last for validation, together {validation}."
        )
    where = "last" if transforms.validation_source == "recordings" else "independent"
    held_out = "recording" if len(others) == 1 else plural(len(others), "recording")
    return (
        f"{discarded}{plural(len(used), 'recording')} with {estimation}"
        f" {'is' if len(used) == 1 else 'are'} used for estimation; the {where} {held_out}"
        f" with {validation} {'is' if len(others) == 1 else 'are'} used for validation."
    )


def transform_effects(transforms: Transforms) -> list[str]:
    """What the transforms do to the model; empty where they leave it unchanged."""
    paragraphs = []
    surplus = transforms.difference - transforms.difference_input
    output_times, input_times = times(transforms.difference), times(transforms.difference_input)
    if surplus > 0:
        rate = transforms.sampling_rate
        power = "" if surplus == 1 else superscript(surplus)
        low, gain = hertz(rate / 50), number(difference_gain(transforms, rate / 50), 2)
        paragraphs.append(
            f"The output was differenced {output_times}, the input {input_times}. B therefore"
            f" contains the factor (1 − q⁻¹){power}, which multiplies the gain by"
            f" |2 sin(πf/fs)|{power}: {gain} at {low} and {2**surplus} at {hertz(rate / 2)}. The"
            " high-pass trend of the frequency response is in part an effect of this factor and"
            " not of the system. Modes at low frequencies are attenuated and may be lost in the"
            " noise. With “difference_input” set to the same number, both signals are differenced"
            " and the frequency response is not changed."
        )
    elif surplus < 0:
        integrators = "an integrator" if surplus == -1 else f"{-surplus} integrators"
        paragraphs.append(
            f"The input was differenced {input_times}, the output {output_times}. The frequency"
            " response shown is that from the differenced input to the output; compared with the"
            f" response to the input it has {integrators} more."
        )
    if transforms.box_cox is not None and transforms.box_cox != 1:
        paragraphs.append(
            "The Box-Cox transform is not linear. The model, the errors and the simulation refer"
            " to the transformed output. The modes are those of the system as far as the transform"
            " is close to a straight line over the range of the output."
        )
    return paragraphs


def difference_gain(transforms: Transforms, frequency: float) -> float:
    """Factor |2 sin(πf/fs)|^d on the gain, d the output's differences beyond the input's."""
    surplus = transforms.difference - transforms.difference_input
    return float(abs(2 * math.sin(math.pi * frequency / transforms.sampling_rate)) ** surplus)
