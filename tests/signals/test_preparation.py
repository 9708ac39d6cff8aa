"""Samples made stationary and divided, and every transform undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured import measured_inputs

from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.errors import InputError
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import (
    load_prepared,
    measured_outputs,
    save_prepared,
)
from evopem.signals.recording import Recording


def invert_output(transforms, output, part="estimation"):
    origin = getattr(transforms, part)[0]
    return measured_outputs(transforms, origin, output[:, None])[:, 0]


def invert_input(transforms, values, part="estimation"):
    origin = getattr(transforms, part)[0]
    return measured_inputs(transforms, origin, values[:, None])[:, 0]


PLAIN = {"box_cox": "none", "difference": 0}


def preparation(transforms=PLAIN, split=None, resample=None) -> PreparationSettings:
    """Settings without a Box-Cox transform, differences and discarded samples where not given."""
    return PreparationSettings(
        TransformSettings(**PLAIN | transforms),
        SplitSettings(**{"discard": 0} | (split or {})),
        resample,
    )


def record(samples: int = 400, seed: int = 0, rate: float = 100.0) -> Recording:
    generator = np.random.default_rng(seed)
    return Recording(
        generator.standard_normal(samples) + 0.5,
        np.cumsum(generator.standard_normal(samples)) - 3.0,
        rate,
        input_names=("torque",),
        output_units=("m/s2",),
    )


@settings(max_examples=60, deadline=None)
@given(
    box=st.sampled_from(["none", "auto", 1.1, 0.0, 0.7]),
    d=st.integers(0, 3),
    du=st.integers(0, 3),
    discard=st.one_of(st.integers(0, 100), st.floats(0.01, 0.3)),
    estimation=st.one_of(st.integers(100, 250), st.floats(0.4, 0.8)),
    offset=st.sampled_from([-3.0, 8.0]),
)
def test_every_transform_is_undone(box, d, du, discard, estimation, offset):
    noise = np.random.default_rng(0).standard_normal(400)
    recording = replace(record(), outputs=offset + noise)
    transforms = {"box_cox": box, "difference": d, "difference_input": du}
    split = {"discard": discard, "estimation": estimation}
    prepared = prepare(recording, preparation(transforms, split))
    estimated, validated = prepared.estimation.samples, prepared.validation.samples
    first = recording.samples - estimated - validated
    assert first == max(d, du) + prepared.transforms.discard
    everything = np.concatenate([prepared.estimation.output, prepared.validation.output])
    tolerance = {"rtol": 0, "atol": 1e-7}
    np.testing.assert_allclose(
        invert_output(prepared.transforms, everything), recording.output[first - d :], **tolerance
    )
    np.testing.assert_allclose(
        invert_output(prepared.transforms, prepared.estimation.output),
        recording.output[first - d : first + estimated],
        **tolerance,
    )
    np.testing.assert_allclose(
        invert_output(prepared.transforms, prepared.validation.output, "validation"),
        recording.output[first + estimated - d :],
        **tolerance,
    )
    np.testing.assert_allclose(
        invert_input(prepared.transforms, prepared.validation.input, "validation"),
        recording.input[first + estimated - du :],
        **tolerance,
    )
    np.testing.assert_allclose(
        invert_input(prepared.transforms, prepared.estimation.input),
        recording.input[first - du : first + estimated],
        **tolerance,
    )


def test_order_of_the_steps_against_plain_numpy():
    recording = record()
    transforms = {"box_cox": "none", "difference": 2, "difference_input": 1}
    prepared = prepare(recording, preparation(transforms, {"discard": 50, "estimation": 200}))
    y, u = np.diff(recording.output, 2)[50:], np.diff(recording.input)[1:][50:]
    np.testing.assert_allclose(prepared.estimation.output, y[:200] - y[:200].mean(), atol=1e-13)
    np.testing.assert_allclose(prepared.validation.output, y[200:] - y[:200].mean(), atol=1e-13)
    np.testing.assert_allclose(prepared.estimation.input, u[:200] - u[:200].mean(), atol=1e-13)
    np.testing.assert_allclose(prepared.validation.input, u[200:] - u[:200].mean(), atol=1e-13)
    assert prepared.before_validation is prepared.estimation
    assert prepared.estimation.input_names[0] == "torque"


def test_input_and_output_stay_aligned():
    """An output that is the input three samples later still is, whatever is differenced."""
    u = np.random.default_rng(3).standard_normal(300)
    recording = Recording(u, np.roll(u, 3), 1.0)
    split = {"discard": 5, "estimation": 200}
    for d in (0, 1, 2):
        transforms = {"difference": d, "difference_input": d}
        part = prepare(recording, preparation(transforms, split)).estimation
        assert np.corrcoef(part.input[:-3], part.output[3:])[0, 1] == pytest.approx(1.0)
    uneven = prepare(recording, preparation({"difference": 2}, split))
    (origin,) = uneven.transforms.estimation
    direct = np.diff(recording.output, 2)[5:205]
    np.testing.assert_allclose(
        uneven.estimation.output + origin.output_means[0],
        direct,
        atol=1e-13,
    )
    np.testing.assert_allclose(
        uneven.estimation.input + origin.input_means[0],
        u[7:207],
        atol=1e-13,
    )


def test_four_fifths_are_for_estimation_and_the_recording_stays_as_it_is():
    recording = record()
    kept = recording.output.copy()
    prepared = prepare(recording, preparation())
    assert (prepared.estimation.samples, prepared.validation.samples) == (320, 80)
    np.testing.assert_array_equal(recording.output, kept)


def stepped(*changes: int) -> Recording:
    """A recording whose input rises at some samples and rests between them."""
    levels = np.searchsorted(changes, np.arange(400), side="right").astype(float)
    return replace(record(), inputs=levels)


@pytest.mark.parametrize(
    ("changes", "split", "samples"),
    [
        ((50, 150, 250), {}, 209),  # the last step is held out, with 40 samples before it
        ((50, 150, 280), {"discard": 40}, 203),
        ((50, 150, 330), {}, 320),  # the last fifth has a step
        ((50, 150), {}, 320),  # too little would be left
        ((260,), {}, 320),  # one step cannot be fitted and held out
        ((250, 260), {}, 320),  # nor one pulse
        ((50, 150, 250), {"estimation": 0.7}, 280),  # as it was asked for
        ((50, 150, 250), {"estimation": 320}, 320),
    ],
)
def test_the_last_change_of_an_input_that_rests_is_held_out(changes, split, samples):
    recording = stepped(*changes)
    prepared = prepare(recording, preparation(split=split))
    assert prepared.before_validation is prepared.estimation
    assert prepared.estimation.samples == samples
    begin = samples + prepared.transforms.discard
    validation = prepared.validation.input + prepared.transforms.estimation[0].input_means[0]
    np.testing.assert_allclose(validation, recording.input[begin:], atol=1e-12)


def test_an_input_that_rests_throughout_and_an_output_that_rests_are_refused():
    with pytest.raises(InputError, match=r"estimation .* so there is nothing to identify"):
        prepare(stepped(350), preparation())
    recording = replace(stepped(50), outputs=np.append(record().output[:320], np.ones(80)))
    with pytest.raises(InputError, match=r"validation .* so there is nothing to identify"):
        prepare(recording, preparation())


def test_box_cox_parameter_does_not_see_the_validation_samples():
    recording = record()
    changed = replace(recording, outputs=recording.output.copy())
    changed.output[350:] = changed.output[350:][::-1]
    settings = preparation({"box_cox": "auto"}, {"discard": 20, "estimation": 300})
    first, second = (prepare(one, settings) for one in (recording, changed))
    assert first.transforms.box_cox == second.transforms.box_cox
    np.testing.assert_array_equal(first.estimation.output, second.estimation.output)


def test_validation_recording_passes_through_the_same_transforms():
    estimation, validation = record(), record(300, seed=1)
    transforms = {"box_cox": "auto", "difference": 1}
    split = {"discard": 30, "estimation": 1.0}
    prepared = prepare(estimation, preparation(transforms, split), validation)
    assert prepared.before_validation is None
    assert prepared.estimation.samples == 400 - 1 - 30
    assert prepared.validation.samples == 300 - 1 - 30
    np.testing.assert_allclose(
        invert_output(prepared.transforms, prepared.validation.output, "validation"),
        validation.output[30:],
        atol=1e-8,
    )
    np.testing.assert_allclose(
        invert_output(prepared.transforms, prepared.estimation.output),
        estimation.output[30:],
        atol=1e-8,
    )
    alone = prepare(estimation, preparation(transforms, {"estimation": 1.0}), validation)
    assert alone.estimation.samples == 399
    part = prepare(estimation, preparation(split={"estimation": 0.5}), validation)
    assert (part.estimation.samples, part.validation.samples) == (200, 300)


def test_resampling_comes_first_and_is_recorded():
    settings = preparation(split={"estimation": 0.5}, resample=100.0)
    prepared = prepare(record(rate=125.0), settings)
    assert prepared.transforms.sampling_rate == prepared.estimation.sampling_rate == 100.0
    assert prepared.transforms.resampled_from == 125.0
    assert prepared.estimation.samples + prepared.validation.samples == 320
    same = prepare(record(), settings)
    assert same.transforms.resampled_from is None


@pytest.mark.parametrize("validation", [None, record(seed=2)])
def test_prepared_data_survive_their_files(tmp_path, validation):
    transforms = {"box_cox": "auto", "difference": 2, "difference_input": 1}
    prepared = prepare(record(), preparation(transforms, {"discard": 10}), validation)
    names = tmp_path / "prepared.npz", tmp_path / "transforms.json"
    save_prepared(prepared, *names)
    loaded = load_prepared(*names)
    assert loaded.transforms == prepared.transforms
    assert (loaded.before_validation is None) == (prepared.before_validation is None)
    for part in ("estimation", "validation"):
        before, after = getattr(prepared, part), getattr(loaded, part)
        assert after.output.tobytes() == before.output.tobytes()
        assert after.input.tobytes() == before.input.tobytes()
        assert (after.sampling_rate, after.output_units[0]) == (before.sampling_rate, "m/s2")
    names[1].write_text("{}")
    with pytest.raises(InputError, match=r"transforms\.json.*the key sampling_rate is missing"):
        load_prepared(*names)


@pytest.mark.parametrize(
    ("split", "key", "problem"),
    [
        ({"estimation": 400}, "estimation", "none remain to validate on"),
        ({"estimation": 401}, "estimation", "401 samples are asked for and 400 remain"),
        ({"estimation": 1.0}, "estimation", "none remain to validate on"),
        ({"discard": 400}, "discard", "there are only 400"),
        ({"discard": 1.0}, "discard", "there are only 400"),
        ({"discard": 395, "estimation": 10}, "estimation", "10 samples are asked for and 5 remain"),
    ],
)
def test_splits_that_do_not_fit_name_their_key(split, key, problem):
    with pytest.raises(InputError, match=problem) as caught:
        prepare(record(), preparation(split=split), place="datasets.arm")
    assert caught.value.source == f"datasets.arm.split.{key}"


@pytest.mark.parametrize(("pole", "source"), [(0.0, "cut"), (0.9, "gap")])
def test_validation_samples_behind_a_high_pass_filter_continue_no_others(pole, source):
    """Their level is that of their first samples, not the one that the filter had before."""
    u, y = np.random.default_rng(3).standard_normal((2, 100)).cumsum(axis=1)
    settings = PreparationSettings(TransformSettings("none", 1, 1, pole), SplitSettings(0, 0.8))
    prepared = prepare(Recording(u, y, 1.0), settings)
    assert prepared.transforms.validation_source == source


def test_differences_that_leave_nothing_name_their_key():
    with pytest.raises(InputError, match="leave no sample") as caught:
        prepare(record(), preparation({"difference": 400}), place="datasets.arm")
    assert caught.value.source == "datasets.arm.split"


def test_differences_that_leave_nothing_and_rates_that_differ():
    line = replace(record(), outputs=np.arange(400.0))
    with pytest.raises(InputError, match="nothing to identify"):
        prepare(line, preparation({"difference": 1}))
    with pytest.raises(
        InputError, match="its sampling rate is 50 Hz and that of the estimation recording 100 Hz"
    ):
        prepare(record(), preparation(), record(rate=50.0))


def test_samples_that_are_too_few_are_named_with_their_file():
    split = {"estimation": 0.99}
    files = ["data/r012.csv"]
    with pytest.raises(InputError, match=r"validation \(the samples of data/r012\.csv as prep"):
        prepare(record(), preparation(split=split), None, "datasets.r012", files)
