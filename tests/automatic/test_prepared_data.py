"""Prepared samples of the automatic recipe lead back to the recorded ones."""

from dataclasses import replace

import numpy as np
import pytest
from measured import measured_inputs

from evopem.automatic.preparation.decimation import decimated
from evopem.automatic.preparation.plan import (
    PreparationPlan,
    PreparedRecord,
    prepare,
    prepared_data,
)
from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.errors import InputError
from evopem.signals.preparation import prepare as divide
from evopem.signals.prepared_data import measured_outputs
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import joined
from evopem.signals.transforms import HighPass

UNCHANGED = TransformSettings("none", 0, 0)


def invert_output(transforms, output, part="estimation", place=0):
    origin = getattr(transforms, part)[place]
    return measured_outputs(transforms, origin, output[:, None])[:, 0]


def invert_input(transforms, values, part="estimation"):
    return measured_inputs(transforms, getattr(transforms, part)[0], values[:, None])[:, 0]


@pytest.fixture
def recording():
    u, y = np.random.default_rng(3).standard_normal((2, 400))
    return Recording(u + 2.0, 100.0 + 7.0 * y, 50.0)


def prepared(recording, transforms=UNCHANGED, **changes):
    divided = divide(recording, PreparationSettings(transforms, SplitSettings(0, 0.8)))
    plan = PreparationPlan(**{"starts": (0,)} | changes)
    data = prepared_data(divided, plan, "datasets.a")
    record = PreparedRecord.of(data.estimation, plan)
    known = prepare(divided.estimation, plan)
    assert record.sampling_rate == known.sampling_rate
    for one, other in zip(record.stretches, known.stretches, strict=True):
        np.testing.assert_allclose(one.outputs, other.outputs, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(one.inputs, other.inputs, rtol=1e-12, atol=1e-12)
        assert (one.recording, one.first) == (other.recording, other.first)
    return data, record


@pytest.mark.parametrize(("changes", "firsts"), [({}, (0, 161)), ({"factor": 2}, (0, 80))])
def test_stretches_keep_their_places_in_the_recording(recording, changes, firsts):
    recording.outputs[160] = 1e4
    _, record = prepared(recording, clipped=(-1e3, 1e3), **changes)
    assert tuple(stretch.first for stretch in record.stretches) == firsts


def test_samples_lead_back_to_the_recording(recording):
    data, record = prepared(recording)
    assert data.before_validation is data.estimation
    assert invert_output(data.transforms, data.estimation.output) == pytest.approx(
        recording.output[:320]
    )
    assert invert_output(data.transforms, data.validation.output, "validation") == pytest.approx(
        recording.output[320:]
    )
    # The stretches are the same samples, scaled.
    assert record.stretches[0].output * record.scales[1][0] == pytest.approx(data.estimation.output)


def test_differenced_samples_lead_back_from_a_later_start(recording):
    twice = TransformSettings("none", 2, 2)
    data, _ = prepared(recording, twice, starts=(30,))
    assert data.before_validation is data.estimation
    assert data.transforms.discard == 30
    back = invert_output(data.transforms, data.estimation.output)
    assert back == pytest.approx(recording.output[30 : 30 + len(back)])


def test_after_decimation_the_validation_samples_follow_after_a_gap(recording):
    data, _ = prepared(recording, factor=4)
    assert data.transforms.validation_source == "gap"
    assert data.transforms.sampling_rate == data.estimation.sampling_rate == 12.5
    assert data.transforms.resampled_from == 50.0
    assert (data.estimation.samples, data.validation.samples) == (80, 20)


def test_a_written_high_pass_filter_leads_back_from_a_later_start(recording):
    data, _ = prepared(recording, TransformSettings("none", 1, 1, 0.95), starts=(30,))
    assert data.transforms.discard == 30
    back = invert_output(data.transforms, data.estimation.output)
    assert back[1:] == pytest.approx(recording.output[31 : 30 + len(back)])


@pytest.mark.parametrize("high_pass", [HighPass(1), HighPass(2), HighPass(1, 0.95)])
def test_a_decided_filter_leads_back_to_the_recording(recording, high_pass):
    settings = PreparationSettings(UNCHANGED, SplitSettings(0, 0.8))
    divided = divide(recording, settings)
    data = prepared_data(divided, PreparationPlan((5,), high_pass=high_pass), "datasets.a")
    transforms, lost = data.transforms, high_pass.times if high_pass.pole else 0
    assert transforms.difference == transforms.difference_input == high_pass.times
    assert transforms.validation_source == "gap"
    back = invert_output(transforms, data.estimation.output)
    assert back[lost:] == pytest.approx(recording.output[5 + lost : 320])
    back = invert_input(transforms, data.estimation.input)
    assert back[lost:] == pytest.approx(recording.input[5 + lost : 320])
    back = invert_output(transforms, data.validation.output, "validation")
    assert back[lost:] == pytest.approx(recording.output[320 + lost :])


def test_several_stretches_are_one_record_with_joints(recording):
    recording.output[100:103] = 200.0
    limit = 200.0 - recording.output[:320].mean()  # the means are taken before
    data, record = prepared(recording, clipped=(-np.inf, limit - 1e-9))
    assert [each.samples for each in record.stretches] == [100, 217]
    assert data.estimation.segment_starts == (0, 100)
    assert data.estimation.segment_recordings == (0, 0)  # one level
    assert [each.first for each in data.transforms.estimation] == [0, 103]
    assert data.transforms.validation_source == "gap"
    back = invert_output(data.transforms, data.estimation.segments[1].output, place=1)
    assert back == pytest.approx(recording.output[103:320])


def test_recordings_of_one_system_keep_their_numbers_and_levels(recording):
    others = [
        replace(recording, outputs=recording.output[::-1] + 50.0),
        replace(recording, inputs=recording.input[::-1]),
    ]
    together = joined([recording, *others], ("a", "b", "c"))
    divided = divide(together, PreparationSettings(UNCHANGED, SplitSettings(0, 0.7)))
    plan = PreparationPlan((0, 10))
    data = prepared_data(divided, plan, "datasets.a")
    assert data.estimation.segment_recordings == (0, 1)
    assert data.validation.segment_recordings == (2,)
    for part, known in (
        ("estimation", (recording.output, others[0].output[10:])),
        ("validation", (others[1].output,)),
    ):
        for place, output in enumerate(known):
            stretch = getattr(data, part).segments[place]
            back = invert_output(data.transforms, stretch.output, part, place)
            assert back == pytest.approx(output)


def test_several_channels_lead_back_at_a_lower_rate():
    generator = np.random.default_rng(4)
    u, y = generator.standard_normal((600, 2)), generator.standard_normal((600, 3)) + 5.0
    settings = PreparationSettings(UNCHANGED, SplitSettings(discard=100, estimation=0.5))
    divided = divide(Recording(u, y, 100.0), settings)
    assert divided.before_validation is divided.estimation
    means = y[100:350].mean(axis=0)
    np.testing.assert_allclose(divided.validation.outputs, y[350:] - means)
    plan = PreparationPlan((50,), factor=5)
    data = prepared_data(divided, plan, "datasets.a")
    assert data.before_validation is None
    assert (data.estimation.outputs.shape, data.validation.inputs.shape) == ((40, 3), (50, 2))
    transforms = data.transforms
    assert (transforms.sampling_rate, transforms.resampled_from) == (20.0, 100.0)
    assert (transforms.estimation[0].first, transforms.estimation[0].start) == (30, 1.5)
    back = measured_outputs(transforms, transforms.estimation[0], data.estimation.outputs)
    whole = divided.estimation.segments[0].between(50, 250)
    np.testing.assert_allclose(back, decimated(whole.outputs, 5) + means)
    assert transforms.validation[0].output_means == transforms.estimation[0].output_means


@pytest.mark.parametrize("single", [True, False])
def test_validation_recordings_that_serve_nothing_are_refused(recording, single):
    if not single:
        both = np.column_stack([recording.inputs, recording.inputs[::-1]])
        recording = Recording(both, recording.outputs, 50.0)
    settings = PreparationSettings(UNCHANGED, SplitSettings(0, 1.0))
    with pytest.raises(InputError, match="its samples are those of the estimation recording"):
        divide(recording, settings, recording)
    few = replace(recording, outputs=recording.outputs[::-1]).between(0, 4)
    with pytest.raises(InputError, match="there are only 4 samples"):
        divide(recording, settings, few)
    other = Recording(np.ones((400, 3)), recording.outputs, 50.0)
    with pytest.raises(InputError, match="it has 3 inputs and the estimation recording"):
        divide(recording, settings, other)
