"""Several recordings of several channels as one data set: read, refused, divided, prepared."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from evopem.automatic.preparation.plan import (
    PreparationPlan,
    decide_preparation,
    prepared_data,
)
from evopem.config.channels import ChannelSettings
from evopem.config.settings import (
    GivenPreparation,
    PreparationSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals import recording_checks
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import load_prepared, measured_outputs, save_prepared
from evopem.signals.recording import Recording, concatenated, load_recording
from evopem.signals.recording_info import RecordingInfo

LENGTHS = (120, 80, 100)
NAMES = ("a.csv", "b.csv", "c.csv")
CHANNELS = ChannelSettings(("f_*",), ("acc_*",), sampling_rate=50.0)
UNCHANGED = TransformSettings("none", 0, 0)
WHOLE = SplitSettings(discard=0, estimation=0.7)


def divide(recordings, split, resample=None, validation=None, files=()):
    settings = PreparationSettings(UNCHANGED, split, resample)
    return prepare(recordings, settings, validation, "datasets.x", files)


def table(number, samples, outputs=3):
    generator = np.random.default_rng([number, samples])
    columns = {f"f_{k}": generator.standard_normal(samples) for k in (1, 2)}
    for k in range(outputs):
        columns[f"acc_{k}"] = 10.0 * number + generator.standard_normal(samples).cumsum()
    return pd.DataFrame(columns)


def recording(number, samples):
    own = table(number, samples).to_numpy()
    names = ("f_1", "f_2"), ("acc_0", "acc_1", "acc_2")
    return Recording(own[:, :2], own[:, 2:], 50.0, *names, ("",) * 2, ("",) * 3)


def joined(lengths=LENGTHS):
    parts = [recording(number, samples) for number, samples in enumerate(lengths)]
    return concatenated(parts), parts


def read(folder, tables, channels=CHANNELS):
    for name, each in zip(NAMES, tables, strict=False):
        each.to_csv(folder / name, index=False)
    files = [str(folder / name) for name in NAMES[: len(tables)]]
    made = DatasetFiles(str(folder / "x"))
    read_recording(made, tuple(files), channels)
    return load_recording(made.recording), load(RecordingInfo, made.recording_info)


def test_files_are_read_as_one_recording_with_the_origin_of_each(tmp_path):
    tables = [table(number, samples) for number, samples in enumerate(LENGTHS)]
    found, info = read(tmp_path, tables)
    assert found.segment_starts == (0, 120, 200)
    for each, own in zip(found.separated, tables, strict=True):
        np.testing.assert_array_equal(np.column_stack([each.inputs, each.outputs]), own)
    assert [(file.path, file.samples) for file in info.files] == [
        (str(tmp_path / name), samples) for name, samples in zip(NAMES, LENGTHS, strict=True)
    ]


@pytest.mark.parametrize(
    ("second", "says"),
    [
        (
            table(1, 80, outputs=2),
            r'b\.csv: the list of its outputs is "acc_0, acc_1" here and "acc_0, acc_1, acc_2" in'
            r" .*a\.csv; name under output what all",
        ),
        (
            table(1, 80).rename(columns={"f_2": "f_3"}),
            r'b\.csv: the list of its inputs is "f_1, f_3" here and "f_1, f_2" in .*a\.csv',
        ),
        (table(0, 120)[20:90], r"b\.csv: its samples are samples 21 to 90 of .*a\.csv; give every"),
        (table(1, 5), r"b\.csv: there are only 5 samples"),
        (table(1, 80).replace(table(1, 80)["acc_1"][7], "?"), r'b\.csv, line 9, column 4: "\?"'),
        (table(1, 80).assign(acc_1=1.0), r'b\.csv, output "acc_1": every sample is 1'),
    ],
)
def test_a_file_that_is_no_recording_of_the_data_set_is_named(tmp_path, second, says):
    with pytest.raises(InputError, match=says) as caught:
        read(tmp_path, [table(0, 120), second])
    assert "\n" not in str(caught.value)


def test_other_units_and_rates_are_refused(tmp_path):
    tables = [table(0, 120), table(1, 80)]
    first, second = recording(0, 120), replace(recording(1, 80), output_units=("", "g", ""))
    with pytest.raises(InputError, match=r'^b\.csv: the unit of its output acc_1 is "g" here and'):
        recording_checks.joined([first, second], NAMES[:2])
    timed = [
        each.assign(time=np.arange(len(each)) / rate)
        for each, rate in zip(tables, (50, 40), strict=True)
    ]
    channels = replace(CHANNELS, sampling_rate=None, time="time")
    with pytest.raises(
        InputError, match=r"b\.csv: its sampling rate is 40 Hz and that of .*a\.csv"
    ):
        read(tmp_path, timed, channels)


def test_the_last_recordings_validate_each_without_its_own_means():
    whole, parts = joined()
    data = divide(whole, WHOLE, None, None)
    assert (data.estimation.segment_starts, data.validation.segment_starts) == ((0, 120), (0,))
    assert data.transforms.validation_source == "recordings"
    for found, own in zip((*data.estimation.separated, data.validation), parts, strict=True):
        np.testing.assert_allclose(found.outputs, own.outputs - own.outputs.mean(axis=0))
        np.testing.assert_allclose(found.inputs, own.inputs - own.inputs.mean(axis=0))
    origins = (*data.transforms.estimation, *data.transforms.validation)
    assert [(each.recording, each.samples) for each in origins] == [(0, 120), (1, 80), (2, 100)]
    np.testing.assert_allclose(origins[2].output_means, parts[2].outputs.mean(axis=0))


def test_each_recording_may_be_cut_and_loses_the_means_of_its_first_part():
    whole, parts = joined()
    split = SplitSettings(discard=10, estimation=0.5, by="samples")
    data = divide(whole, split, None, None)
    assert data.estimation.segment_starts == data.validation.segment_starts == (0, 55, 90)
    assert data.transforms.validation_source == "cut"
    second = parts[1].outputs
    means = second[10:45].mean(axis=0)
    np.testing.assert_allclose(data.validation.separated[1].outputs, second[45:] - means)
    assert data.transforms.validation[1].first == 45


def test_several_recordings_of_other_files_may_validate(tmp_path):
    whole, _ = joined()
    others = concatenated([recording(7, 60), recording(8, 50)])
    split = SplitSettings(discard=0, estimation=1.0)
    data = divide(whole, split, None, others)
    assert (data.estimation.samples, data.validation.segment_starts) == (300, (0, 60))
    assert [each.recording for each in data.transforms.validation] == [3, 4]
    np.testing.assert_allclose(data.validation.separated[1].outputs.mean(axis=0), 0.0, atol=1e-12)
    save_prepared(data, tmp_path / "data.npz", tmp_path / "transforms.json")
    again = load_prepared(tmp_path / "data.npz", tmp_path / "transforms.json")
    assert again.transforms == data.transforms
    assert again.estimation.segment_starts == data.estimation.segment_starts


def test_recordings_are_resampled_and_decimated_each_by_itself():
    whole, parts = joined((600, 400, 500))
    data = divide(whole, WHOLE, 25.0)
    plan = PreparationPlan((0, 40), factor=2)
    found = prepared_data(data, plan, "datasets.x")
    assert [each.samples for each in found.estimation.separated] == [150, 80]
    # Other samples in the first recording change nothing in the second one.
    other = concatenated([recording(9, 600), *parts[1:]])
    changed = prepared_data(divide(other, WHOLE, 25.0), plan, "datasets.x")
    back = [
        measured_outputs(each.transforms, each.transforms.estimation[1], segment.outputs)
        for each in (found, changed)
        for segment in each.estimation.segments[1:]
    ]
    np.testing.assert_allclose(back[0], back[1], rtol=1e-12)
    assert found.transforms.estimation[1].first == 20
    assert found.transforms.estimation[1].start == 40 / 25.0


def test_each_recording_begins_where_its_channels_do():
    _, parts = joined((200, 200))
    rest = np.repeat(parts[1].outputs[:1], 60, axis=0)
    late = replace(
        parts[1],
        inputs=np.vstack([np.zeros((60, 2)), parts[1].inputs]),
        outputs=np.vstack([rest, parts[1].outputs]),
    )
    both = concatenated([parts[0], late])
    plan = decide_preparation(both, GivenPreparation(factor=1))
    assert plan.starts == (0, 50)
    assert plan.decisions[0].choice == "0, 50"


def test_what_is_left_of_a_recording_is_named_with_its_file():
    whole, _ = joined((120, 19, 100))
    estimation = divide(whole, WHOLE).estimation
    with pytest.raises(InputError, match=r"^b\.csv: no stretch for estimation has 20 samples"):
        decide_preparation(estimation, GivenPreparation(), NAMES)
    whole, _ = joined((120, 40, 100))
    split = SplitSettings(discard=0, estimation=0.95, by="samples")
    with pytest.raises(
        InputError, match=r"validation \(the samples of a\.csv as prepared\): there"
    ):
        divide(whole, split, files=NAMES)
