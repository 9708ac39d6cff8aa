"""Prepared samples of the automatic recipe lead back to the recorded ones."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.automatic.preparation import PreparationPlan, prepare
from evopem.automatic.prepared_data import load_stretches, prepared_data, save_stretches
from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.signals.joining import joined
from evopem.signals.preparation import invert_input, invert_output
from evopem.signals.preparation import prepare as divide
from evopem.signals.recording import Recording

UNCHANGED = TransformSettings("none", 0, 0)
NOTHING = PreparationPlan((0,), 1, (-np.inf, np.inf), "quadratic", 0.0, 0.0, 1.0, 1.0, ())


@pytest.fixture
def recording():
    u, y = np.random.default_rng(3).standard_normal((2, 400))
    return Recording(u + 2.0, 100.0 + 7.0 * y, 50.0)


def prepared(recording, plan, transforms=UNCHANGED):
    settings = PreparationSettings(transforms, SplitSettings(0, 0.8))
    divided = divide(recording, settings)
    plan = replace(plan, input_offset=0.3, output_offset=-1.5, input_scale=2.0, output_scale=8.0)
    record = prepare((divided.estimation,), plan)
    return prepared_data(divided, record, "datasets.a"), record


def test_samples_lead_back_to_the_recording(recording):
    data, record = prepared(recording, NOTHING)
    assert data.contiguous
    assert invert_output(data.transforms, data.estimation.output) == pytest.approx(
        recording.output[:320]
    )
    assert invert_output(data.transforms, data.validation.output, "validation") == pytest.approx(
        recording.output[320:]
    )
    # The stretches are the same samples, scaled.
    assert record.stretches[0].output * 8.0 == pytest.approx(data.estimation.output)


def test_differenced_samples_lead_back_from_a_later_start(recording):
    twice = TransformSettings("none", 2, 2)
    data, _ = prepared(recording, replace(NOTHING, starts=(30,)), twice)
    assert data.contiguous
    assert data.transforms.discard == 30
    back = invert_output(data.transforms, data.estimation.output)
    assert back == pytest.approx(recording.output[30 : 30 + len(back)])


def test_after_decimation_the_validation_samples_follow_after_a_gap(recording):
    data, _ = prepared(recording, replace(NOTHING, factor=4))
    assert data.transforms.validation_source == "gap"
    assert data.transforms.sampling_rate == data.estimation.sampling_rate == 12.5
    assert data.transforms.resampled_from == 50.0
    assert (data.estimation.samples, data.validation.samples) == (80, 20)


def test_decided_differences_lead_back_to_the_recording(recording):
    settings = PreparationSettings(UNCHANGED, SplitSettings(0, 0.8))
    divided = divide(recording, settings)
    plan = replace(NOTHING, starts=(5,), differences=2, output_scale=8.0)
    data = prepared_data(divided, prepare((divided.estimation,), plan), "datasets.a")
    assert data.transforms.difference == data.transforms.difference_input == 2
    assert data.transforms.validation_source == "gap"
    back = invert_output(data.transforms, data.estimation.output)
    assert back == pytest.approx(recording.output[5:320])
    assert invert_input(data.transforms, data.estimation.input) == pytest.approx(
        recording.input[5:320]
    )
    back = invert_output(data.transforms, data.validation.output, "validation")
    assert back == pytest.approx(recording.output[320:])


def test_several_stretches_are_one_record_with_joints(recording):
    recording.output[100:103] = 200.0
    limit = 200.0 - recording.output[:320].mean()  # the means are taken before
    data, record = prepared(recording, replace(NOTHING, clipped=(-np.inf, limit - 1e-9)))
    assert [each.samples for each in record.stretches] == [100, 217]
    assert data.estimation.segment_starts == (0, 100)
    assert data.estimation.segment_recordings == (0, 0)  # one level
    assert [each.first for each in data.transforms.estimation_stretches] == [0, 103]
    assert data.transforms.validation_source == "gap"
    transforms = data.transforms.of_stretches("estimation")[1]
    back = invert_output(transforms, data.estimation.segments[1].output)
    assert back == pytest.approx(recording.output[103:320])


def test_recordings_of_one_system_keep_their_numbers_and_levels(recording):
    others = [
        replace(recording, outputs=recording.output[::-1] + 50.0),
        replace(recording, inputs=recording.input[::-1]),
    ]
    together = joined([recording, *others], ("a", "b", "c"))
    divided = divide(together, PreparationSettings(UNCHANGED, SplitSettings(0, 0.7)))
    parts = divided.estimation.separated
    record = prepare(parts, replace(NOTHING, starts=(0, 10), output_offset=-1.5, output_scale=4.0))
    data = prepared_data(divided, record, "datasets.a")
    assert data.estimation.segment_recordings == (0, 1)
    assert data.validation.segment_recordings == (2,)
    for part, known in (
        ("estimation", (recording.output, others[0].output[10:])),
        ("validation", (others[1].output,)),
    ):
        transforms = data.transforms.of_stretches(part)
        stretches = getattr(data, part).segments
        for own, stretch, output in zip(transforms, stretches, known, strict=True):
            assert invert_output(own, stretch.output, part) == pytest.approx(output)


def test_stretches_are_written_and_read_as_they_are(recording, tmp_path):
    _, record = prepared(recording, NOTHING)
    u = record.stretches[0].input
    parts = (record.stretches[0], replace(record.stretches[0], inputs=u[::-1].copy(), recording=1))
    save_stretches(parts, tmp_path / "s.npz")
    for read, written in zip(load_stretches(tmp_path / "s.npz"), parts, strict=True):
        assert np.array_equal(read.input, written.input)
        assert np.array_equal(read.output, written.output)
        assert read.recording == written.recording
