"""Input, output and time told from a file alone, or refused in a sentence."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.channels import ChannelSettings
from evopem.config.defaults import complete, yaml_text
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals.inspection import causality_test, roles_of
from evopem.signals.recording import load_recording
from evopem.signals.recording_info import RecordingInfo
from evopem.terminal.new_configuration import certain_channels


def driven(seed, samples=500, noise=1.0, feedback=0.0):
    """An input and the response to it, by a resonance with noise."""
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    if not feedback:
        return u, lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u) + noise * e
    y = np.zeros(samples)
    for t in range(2, samples):
        u[t] -= feedback * y[t - 1]
        y[t] = 0.9 * y[t - 1] - 0.2 * y[t - 2] + u[t - 1] + noise * e[t]
    return u, y


def write(path, heading, *columns):
    rows = [",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns), strict=True)]
    Path(path).write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    return path


def times(samples=500):
    return np.arange(samples) / 50.0


def test_the_test_finds_the_direction_and_seldom_errs():
    directions = [causality_test(*driven(seed)).direction for seed in range(40)]
    assert directions.count(1) >= 38
    assert -1 not in directions
    unrelated = np.random.default_rng(5).standard_normal((40, 2, 300))
    assert sum(causality_test(*each).direction != 0 for each in unrelated) <= 1


def test_feedback_has_no_direction():
    assert causality_test(*driven(1, feedback=0.4)).direction == 0


@pytest.mark.parametrize("heading", ["t,u,y", "time,force (N),acceleration", "time,input,Output"])
def test_names_tell_the_channels(tmp_path, heading):
    u, y = driven(1)
    roles = roles_of(write(tmp_path / "a.csv", heading, times(), u, y))
    assert (roles.time, roles.input, roles.output) == tuple(heading.split(","))
    assert "by their names" in roles.sentence


def test_causality_tells_them_in_either_order(tmp_path):
    u, y = driven(2)
    for heading, columns in (("time,a,b", (u, y)), ("time,b,a", (y, u))):
        roles = roles_of(write(tmp_path / "a.csv", heading, times(), *columns))
        assert (roles.input, roles.output) == ("a", "b")
        assert roles.test.forward < 1e-4 < roles.test.backward
        assert "second (p < 0.0001, " in roles.sentence
        assert f"and not the reverse (p = {roles.test.backward:.2g})" in roles.sentence


def test_what_cannot_be_told_is_refused_in_a_sentence(tmp_path):
    u, y = driven(1, feedback=0.4)
    path = write(tmp_path / "a.csv", "time,a,b", times(), u, y)
    with pytest.raises(InputError) as caught:
        roles_of(path)
    assert str(caught.value) == (
        f"{path}: 'a' and 'b' cannot be distinguished as input and output: their names do not say"
        " it, and the past of each improves predictions of the other at 0.1 %; name input and"
        " output."
    )
    path = write(tmp_path / "b.csv", "time,a,b,c", times(), u, y, y + u)
    with pytest.raises(InputError, match="beside the time there are 3 channels"):
        roles_of(path)


def test_a_stated_rate_stands_for_a_time(tmp_path):
    u, y = driven(2)
    np.savez(tmp_path / "a.npz", b=y, a=u, fs=100.0)
    roles = roles_of(tmp_path / "a.npz")
    assert (roles.input, roles.output, roles.time) == ("a", "b", None)


def test_a_file_without_a_time_is_read_as_ever(tmp_path):
    path = write(tmp_path / "a.csv", "a,b", *driven(1))
    assert roles_of(path) is None
    # Of a command that is given the rate, the test tells the roles.
    assert roles_of(path, timed=False).input == "a"
    keys, sentence = certain_channels(str(path))
    assert (keys["input"], keys["output"]) == (["a"], ["b"])
    assert "and not the reverse" in sentence


def test_what_is_not_sampled_with_the_times_is_no_channel(tmp_path):
    u, y = driven(2)
    np.savez(tmp_path / "a.npz", b=y, a=u, window=u[:40], t=times(), fs=50.0)
    assert roles_of(tmp_path / "a.npz").input == "a"


def test_the_channels_of_the_first_file_are_those_of_all(tmp_path):
    first, second = driven(1), driven(2)
    files = tuple(
        str(write(tmp_path / name, "time,a,b", times(), *each))
        for name, each in (("1.csv", first), ("2.csv", second))
    )
    made, channels = DatasetFiles(str(tmp_path / "x")), ChannelSettings((1,), (2,))
    validation = str(write(tmp_path / "v.csv", "time,b,a", times(), second[1], second[0]))
    read_recording(made, files, channels, channels_from_file=True, validation=(validation,))
    recording = load_recording(made.recording)
    assert (recording.input_names[0], recording.sampling_rate) == ("a", pytest.approx(50.0))
    assert load_recording(made.validation_recording).input == pytest.approx(second[0])
    infos = made.recording_info, made.validation_recording_info
    assert load(RecordingInfo, infos[0]).roles == load(RecordingInfo, infos[1]).roles


@pytest.mark.parametrize("recipe", ["auto", "chapter"])
def test_the_file_alone_is_a_configuration(recipe):
    def completed(**keys):
        content = {"datasets": {"pump": {"file": "pump.csv", "recipe": recipe, **keys}}}
        return complete(content).datasets["pump"]

    own = completed()
    assert own.source.channels_from_file
    assert "input" not in yaml_text(own).replace("input_unit", "").replace("difference_input", "")
    assert not completed(sampling_rate=10).source.channels_from_file
    assert not completed(input="u").source.channels_from_file
