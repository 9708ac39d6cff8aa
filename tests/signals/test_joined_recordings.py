"""Several recordings of one system as one data set: joined, refused, prepared, and taken back."""

from dataclasses import replace

import numpy as np
import pytest
from measured import measured_inputs

from evopem.config.channels import ChannelSettings
from evopem.config.settings import PreparationSettings, SplitSettings
from evopem.config.settings import TransformSettings as T
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import (
    load_prepared,
    measured_outputs,
    save_prepared,
)
from evopem.signals.recording import Recording, load_recording
from evopem.signals.recording_checks import joined
from evopem.signals.recording_info import RecordingInfo

NAMES = ("a.csv", "b.csv", "c.csv")


def recordings(lengths=(120, 80, 100)):
    generator = np.random.default_rng(1)
    return [
        Recording(
            generator.standard_normal(n) + number,
            30.0 + 10.0 * number + generator.standard_normal(n).cumsum(),
            50.0,
        )
        for number, n in enumerate(lengths)
    ]


UNCHANGED = T("none", 0, 0)


def settings(transforms=UNCHANGED, **split):
    return PreparationSettings(
        transforms, SplitSettings(**{"discard": 0, "estimation": 0.7} | split)
    )


def write(folder, each, name, heading="u,y"):
    rows = [f"{u!r},{y!r}" for u, y in zip(each.input.tolist(), each.output.tolist(), strict=True)]
    (folder / name).write_text("\n".join([heading, *rows]) + "\n")
    return str(folder / name)


def test_files_are_read_as_one_recording_with_the_origin_of_each(tmp_path):
    own = recordings()
    files = [write(tmp_path, each, name) for each, name in zip(own, NAMES, strict=True)]
    made = DatasetFiles(str(tmp_path / "x"))
    read_recording(made, tuple(files), ChannelSettings(("u",), ("y",), 50.0))
    read, described = load_recording(made.recording), load(RecordingInfo, made.recording_info)
    assert read.segment_starts == (0, 120, 200)
    assert read.segment_recordings == (0, 1, 2)
    for stretch, each in zip(read.segments, own, strict=True):
        assert np.array_equal(stretch.output, each.output)
    assert [origin.path for origin in described.files] == files
    assert [origin.samples for origin in described.files] == [120, 80, 100]
    assert len({origin.sha256 for origin in described.files}) == 3


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            {"sampling_rate": 25.0},
            "b.csv: its sampling rate is 25 Hz and that of a.csv 50 Hz; give recordings of one"
            " rate, or correct sampling_rate or time.",
        ),
        (
            {"output_names": ("force",)},
            'b.csv: the output is "force" here and "output" in a.csv; name under output what all'
            " recordings have, or leave this file out.",
        ),
        (
            {"input_units": ("V",)},
            'b.csv: the unit of its input is "V" here and "" in a.csv; name under input_unit what'
            " all recordings have, or leave this file out.",
        ),
    ],
)
def test_recordings_that_do_not_agree_are_refused(change, sentence):
    first, second, _ = recordings()
    with pytest.raises(InputError) as caught:
        joined([first, replace(second, **change)], NAMES[:2])
    assert str(caught.value) == sentence


def test_a_copy_under_another_name_is_refused(tmp_path):
    first, second, _ = recordings()
    with pytest.raises(InputError, match=r"c\.csv: its samples are those of a\.csv; give every"):
        joined([first, second, first], NAMES)
    part = replace(second, inputs=second.input[10:60], outputs=second.output[10:60])
    with pytest.raises(InputError, match=r"c\.csv: its samples are samples 11 to 60 of b\.csv"):
        joined([first, second, part], NAMES)


def test_the_last_recordings_validate_and_each_has_its_own_level():
    together = joined(recordings(), NAMES)
    data = prepare(together, settings())
    assert data.transforms.validation_source == "recordings"
    assert data.estimation.segment_starts == (0, 120)
    assert (data.estimation.samples, data.validation.samples) == (200, 100)
    assert data.before_validation is None
    for stretch in data.estimation.segments:
        assert stretch.input.mean() == pytest.approx(0.0, abs=1e-12)


def test_each_recording_can_be_cut():
    own = recordings()
    data = prepare(joined(own, NAMES), settings(by="samples", discard=10))
    alone = [prepare(each, settings(discard=10)) for each in own]
    for part in ("estimation", "validation"):
        stretches = getattr(data, part).segments
        for stretch, other in zip(stretches, alone, strict=True):
            assert np.array_equal(stretch.input, getattr(other, part).input)
            assert np.array_equal(stretch.output, getattr(other, part).output)
    assert data.before_validation is data.estimation
    assert data.transforms.several_recordings


@pytest.mark.parametrize("by", ["recordings", "samples"])
def test_every_stretch_leads_back_to_its_recording(by, tmp_path):
    own = recordings()
    data = prepare(joined(own, NAMES), settings(T(1.3, 2, 1), by=by, discard=5))
    save_prepared(data, tmp_path / "p.npz", tmp_path / "t.json")
    data = load_prepared(tmp_path / "p.npz", tmp_path / "t.json")
    for part in ("estimation", "validation"):
        origins = getattr(data.transforms, part)
        for origin, stretch in zip(origins, getattr(data, part).segments, strict=True):
            recorded = own[origin.recording]
            back = measured_outputs(data.transforms, origin, stretch.outputs)
            known = recorded.outputs[origin.first - 2 : origin.first + stretch.samples]
            assert back == pytest.approx(known, rel=1e-9)
            back = measured_inputs(data.transforms, origin, stretch.inputs)
            known = recorded.inputs[origin.first - 1 : origin.first + stretch.samples]
            assert back == pytest.approx(known, abs=1e-9)


def test_several_independent_recordings_validate():
    first, second, third = recordings()
    data = prepare(first, settings(estimation=1.0), joined([second, third], NAMES[1:]))
    assert data.transforms.validation_source == "file"
    assert [each.samples for each in data.validation.segments] == [80, 100]
