"""The sampling rate of a file whose time stamps nobody named."""

import numpy as np
import pytest

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.results.layout import DatasetFiles
from evopem.signals.inspection import time_from_file
from evopem.signals.reading import read_measured
from evopem.signals.recording_info import RecordingInfo

RATE = 200.0


def written(tmp_path, header, stamps):
    """A text table with stamps and three noisy channels."""
    channels = np.random.default_rng(1).standard_normal((stamps.size, 3))
    file = tmp_path / "data.csv"
    table = np.column_stack([stamps, channels])
    np.savetxt(file, table, delimiter=",", header=header, comments="", fmt="%.6f")
    return file


STAMPS = np.arange(60) / RATE


@pytest.mark.parametrize("name", ["time", "t", "Time [s]", "Zeit", "timestamp_s"])
def test_a_channel_named_as_a_time_gives_the_rate(name, tmp_path):
    file = written(tmp_path, f"{name},u,acc_1,acc_2", STAMPS)
    assert time_from_file(file, ["u", "acc_1"]) == name
    made = DatasetFiles(str(tmp_path / "x"))
    read_recording(made, (str(file),), ChannelSettings(("u",), ("acc_1",)))
    info = load(RecordingInfo, made.recording_info)
    assert (info.sampling_rate, info.files[0].time_from_file) == (RATE, name)
    several = ChannelSettings(("u",), ("acc_*",))
    assert read_measured(file, several)[0].sampling_rate == RATE


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("load", STAMPS),  # even steps, but no word for time
        ("time", np.arange(60.0)),  # whole numbers of no unit
        ("time", STAMPS + 0.4 / RATE * (np.arange(60) % 2)),  # uneven
    ],
)
def test_what_is_not_sure_is_refused_as_before(name, stamps, tmp_path):
    file = written(tmp_path, f"{name},u,y,w", stamps)
    assert time_from_file(file, ["u", "y"]) is None
    with pytest.raises(InputError, match="give sampling_rate in Hz"):
        read_recording(
            DatasetFiles(str(tmp_path / "x")), (str(file),), ChannelSettings(("u",), ("y",))
        )


def test_a_stated_rate_is_not_questioned(tmp_path):
    channels = ChannelSettings(("u",), ("y",), sampling_rate=50.0)
    recording, origin = read_measured(written(tmp_path, "time,u,y,w", STAMPS), channels)
    assert (recording.sampling_rate, origin.time_from_file) == (50.0, None)
