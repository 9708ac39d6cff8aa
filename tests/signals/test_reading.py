"""Recordings of several channels: the same samples from every format, or one sentence."""

import numpy as np
import pandas as pd
import pytest
from recorded_files import uff_text
from scipy.io import savemat

from evopem.config.channels import ChannelPlace, ChannelSettings, Geometry
from evopem.errors import InputError
from evopem.signals.reading import read_measured
from evopem.signals.recording import load_recording, save_recording
from evopem.signals.recording_info import check_measured_places, describe_recording

N, RATE = 200, 50.0
GENERATOR = np.random.default_rng(5)
SIGNALS = {name: GENERATOR.standard_normal(N) for name in ("u1", "u2", "acc_1", "acc_2", "acc_3")}
WANTED = ChannelSettings(("u1", "u2"), ("acc_*",), sampling_rate=RATE)


def write_csv(path):
    pd.DataFrame(SIGNALS).to_csv(path, index=False)


def write_mat(path):
    savemat(path, {name: values[:, None] for name, values in SIGNALS.items()})


def write_npz(path):
    np.savez(path, **SIGNALS)


def write_parquet(path):
    pytest.importorskip("pyarrow")
    pd.DataFrame(SIGNALS).to_parquet(path)


def write_hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in SIGNALS.items():
            file[name] = values


def write_tdms(path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("group", name, values) for name, values in SIGNALS.items()]
        )


def write_uff(path):
    path.write_text("".join(uff_text(values, name) for name, values in SIGNALS.items()))


FORMATS = {
    "a.csv": write_csv,
    "a.mat": write_mat,
    "a.npz": write_npz,
    "a.parquet": write_parquet,
    "a.h5": write_hdf5,
}


def refusal(path, channels):
    with pytest.raises(InputError) as caught:
        read_measured(path, channels)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_samples(name, tmp_path):
    FORMATS[name](tmp_path / name)
    found = read_measured(tmp_path / name, WANTED)[0]
    np.testing.assert_array_equal(found.inputs, np.column_stack([SIGNALS["u1"], SIGNALS["u2"]]))
    np.testing.assert_array_equal(found.outputs[:, 2], SIGNALS["acc_3"])
    assert found.output_names == ("acc_1", "acc_2", "acc_3")
    assert found.sampling_rate == RATE


@pytest.mark.parametrize(("name", "write"), [("a.tdms", write_tdms), ("a.uff", write_uff)])
def test_formats_with_names_of_their_own_are_read_by_numbers(name, write, tmp_path):
    write(tmp_path / name)
    found = read_measured(tmp_path / name, ChannelSettings((1, 2), (3, 4, 5), RATE))[0]
    np.testing.assert_allclose(found.outputs[:, 2], SIGNALS["acc_3"], rtol=1e-6, atol=1e-6)
    assert len(set(found.input_names + found.output_names)) == 5


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.csv"
    table = pd.DataFrame(SIGNALS)
    table.insert(0, "time", np.arange(N) / RATE)
    table.to_csv(path, index=False)
    return path


def test_a_pattern_leaves_out_what_is_named(file):
    channels = ChannelSettings(("u1", "u2"), ("*",), time="time")
    assert read_measured(file, channels)[0].output_names == ("acc_1", "acc_2", "acc_3")


def test_units_by_order_by_name_and_for_all(file):
    for units, expected in (
        ("g", ("g", "g", "g")),
        (("a", "b", "c"), ("a", "b", "c")),
        ({"acc_2": "b"}, ("", "b", "")),
    ):
        channels = ChannelSettings(("u1",), ("acc_*",), time="time", output_unit=units)
        assert read_measured(file, channels)[0].output_units == expected


def test_samples_and_facts_are_kept(file, tmp_path):
    found = read_measured(file, ChannelSettings((), ("acc_*",), time="time"))[0]
    save_recording(found, tmp_path / "recording.npz")
    again = load_recording(tmp_path / "recording.npz")
    assert again.inputs.shape == (N, 0)
    assert again.output_names == found.output_names
    np.testing.assert_array_equal(again.outputs, found.outputs)
    info = describe_recording(found)
    assert [each.name for each in info.outputs] == ["acc_1", "acc_2", "acc_3"]
    assert info.inputs == ()


@pytest.mark.parametrize(
    ("channels", "says"),
    [
        (ChannelSettings(("u1",), ("vel_*",), 1.0), 'no channel matches "vel_*"'),
        (ChannelSettings(("u*",), ("*1",), 1.0), 'matches "*1" and "u*" of input'),
        (ChannelSettings(("u1",), ("acc_1", 4), 1.0), "hold the same values"),
        (ChannelSettings(("u1",), ("acc_1", "acc_9"), 1.0), 'there is no column "acc_9"'),
        (ChannelSettings(("u1",), ("acc_1, acc_2",), 1.0), "give several as a list"),
        (ChannelSettings(("u1",), ("acc_1", "time"), 50.0), "as a time does"),
        (
            ChannelSettings(("u1",), ("acc_*",), 1.0, output_unit=("m",)),
            "1 values and 3 outputs",
        ),
        (
            ChannelSettings(("u1",), ("acc_*",), 1.0, output_unit={"x": "m"}),
            "there is no output x",
        ),
        (ChannelSettings(("u1",), ("acc_*",), decimal_mark="."), "the sampling rate is not known"),
    ],
)
def test_misuse_is_refused_in_one_sentence(file, channels, says):
    assert says in refusal(file, channels)


def test_a_channel_that_cannot_be_identified_is_named(tmp_path):
    table = pd.DataFrame(SIGNALS)
    table["acc_2"] = 1.0
    table.to_csv(tmp_path / "a.csv", index=False)
    message = refusal(tmp_path / "a.csv", WANTED)
    assert 'output "acc_2"' in message
    assert "every sample is 1" in message


def test_places_of_channels_that_do_not_exist_are_refused():
    geometry = Geometry({"p": (0.0, 0.0, 0.0)}, {"acc_9": ChannelPlace("p", (1.0, 0.0, 0.0))})
    with pytest.raises(InputError, match='there is no output "acc_9"'):
        check_measured_places(geometry, ["acc_1"], "datasets.a.geometry")


def test_a_pattern_finds_channels_of_a_group_by_their_own_names(tmp_path):
    h5py = pytest.importorskip("h5py")
    signals = np.random.default_rng(8).standard_normal((4, 60))
    path = tmp_path / "bench.h5"
    with h5py.File(path, "w") as file:
        for name, values in zip(
            ("run/force", "run/acc_1", "run/acc_2", "acc"), signals, strict=True
        ):
            file[name] = values
    for pattern, names in (("acc_*", ("run/acc_1", "run/acc_2")), ("acc*", ("acc",))):
        lists = ChannelSettings(("run/force",), (pattern,), sampling_rate=100.0)
        assert read_measured(path, lists)[0].output_names == names


def test_a_channel_whose_name_holds_a_star_is_no_pattern(tmp_path):
    table = pd.DataFrame(SIGNALS).rename(columns={"acc_2": "acc_*"})
    table.to_csv(tmp_path / "a.csv", index=False)
    lists = ChannelSettings(("u1",), ("acc_*",), sampling_rate=RATE)
    assert read_measured(tmp_path / "a.csv", lists)[0].output_names == ("acc_*",)


def test_a_stuck_channel_may_be_left_out(tmp_path):
    table = pd.DataFrame(SIGNALS)
    table.loc[: int(0.95 * N), "acc_2"] = 1.0
    table.to_csv(tmp_path / "a.csv", index=False)
    message = refusal(tmp_path / "a.csv", WANTED)
    assert 'output "acc_2": 9' in message
    assert "leave it out" in message
