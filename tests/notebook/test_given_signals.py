"""Signals that a user hands over, in every form, and the rates that they state."""

import numpy as np
import pandas as pd
import pytest

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.notebook.signals import Wanted
from evopem.notebook.signals import given_recordings as recordings_of
from evopem.notebook.signals import given_signals as signals_of
from evopem.signals.reading import read_measured
from evopem.signals.recording import recording_of

U, Y = np.random.default_rng(1).standard_normal((2, 50))
TIME = np.arange(50) / 20.0


def given_signals(data, output, inputs=None, time=None, sampling_rate=None, **keys):
    return signals_of(data, Wanted(output, inputs, time, sampling_rate, **keys))


def given_recordings(data, output, inputs=None, sampling_rate=None):
    return recordings_of(data, Wanted(output, inputs, None, sampling_rate))


def frame(index=None):
    return pd.DataFrame({"u": U, "y": Y, "t": TIME, "word": ["a"] * 50}, index=index)


@pytest.mark.parametrize(
    ("index", "time"),
    [
        (pd.date_range("2026-01-01", periods=50, freq="50ms"), None),
        (pd.date_range("2026-01-01", periods=50, freq="50ms", tz="Europe/Athens"), None),
        (pd.timedelta_range(0, periods=50, freq="50ms"), None),
        (TIME + 3.0, None),
        (None, "t"),
    ],
    ids=["dates", "dates of a zone", "durations", "seconds", "column"],
)
def test_times_give_the_rate(index, time):
    found = given_signals(frame(index), "y", "u", time)
    assert found.sampling_rate == 20.0
    assert np.array_equal(found.inputs[:, 0], U)
    assert np.array_equal(found.outputs[:, 0], Y)
    assert (found.input_names, found.output_names) == (("u",), ("y",))


def test_series_and_arrays_state_what_they_know():
    table = frame(TIME)
    series = given_signals(table["u"], table["y"])
    assert (series.sampling_rate, series.input_names, series.output_names) == (20.0, ("u",), ("y",))
    arrays = given_signals(list(U), Y[:, None], sampling_rate=5.0)
    assert (arrays.input_names, arrays.output_names) == (("input",), ("output",))
    assert arrays.sampling_rate == 5.0
    alone = given_signals(None, table["y"])
    assert alone.inputs.shape == (50, 0)


def test_the_signals_are_a_copy_in_a_file_that_the_readers_take(tmp_path):
    output = Y.copy()
    found = given_signals(U, output, sampling_rate=20.0)
    output[0] = 99.0
    assert found.outputs[0, 0] == Y[0]
    found.save(tmp_path / "data.npz")
    channels = ChannelSettings(("input",), ("output",), sampling_rate=20.0)
    read = read_measured(tmp_path / "data.npz", channels)[0]
    assert np.array_equal(read.input, U)
    assert np.array_equal(read.output, Y)


def test_missing_values_of_a_table_become_nan():
    table = frame()
    table["y"] = table["y"].astype("Float64")
    table.loc[3, "y"] = pd.NA
    assert np.isnan(given_signals(table, "y", "u", sampling_rate=1.0).outputs[3, 0])


def test_lists_of_tables_and_of_signals_are_several_recordings():
    first, second = given_recordings([frame(TIME), frame(TIME + 9.0)], "y", "u")
    assert np.array_equal(first.inputs, second.inputs)
    arrays = given_recordings([U, U[:30]], [Y, Y[:30]], sampling_rate=2.0)
    assert [len(each.outputs) for each in arrays] == [50, 30]
    assert len(given_recordings(list(U), list(Y), sampling_rate=2.0)) == 1
    assert given_recordings(None, [Y, Y], sampling_rate=2.0)[1].inputs.shape == (50, 0)
    with pytest.raises(InputError, match="data: there are 2 inputs and no outputs"):
        given_recordings([U, U], Y, sampling_rate=2.0)
    with pytest.raises(InputError, match="a sampling rate is 10 Hz, and that of the first"):
        given_recordings([frame(TIME), frame(2.0 * TIME)], "y", "u")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((frame(), "z", "u"), "data, output: there is no column 'z'; choose one of 'u', 'y', 't'"),
        ((frame(), "y", "y"), "output: column 'y' is the input as well"),
        ((frame(), "word", "u"), "data, output: it holds no real numbers"),
        ((frame(), None, "u"), "output: it is missing"),
        ((U, Y, "u"), "input: it names a column, and the data are no table"),
        ((U, np.ones((2, 50))), "data, output: the signals have the shape (2, 50)"),
        ((U, 1j * Y), "data, output: it holds no real numbers"),
        ((pd.concat([frame(), frame()], axis=1), "y", "u"), "2 columns are called 'u'"),
        (
            (frame(pd.date_range("2026-01-01", periods=50, freq="50ms")), "y", "u", None, 10.0),
            "the time stamps give 20 Hz and the stated rate is 10 Hz",
        ),
        ((frame(TIME**2), "y", "u"), 'time "index"'),
    ],
)
def test_what_cannot_be_used_is_said_in_a_sentence(arguments, sentence):
    with pytest.raises(InputError) as refused:
        given_signals(*arguments)
    assert sentence in str(refused.value)


def test_several_channels_are_columns_labels_or_tables():
    table = frame(TIME)
    table["v"] = -table["u"]
    labels = given_signals(table, ["y", "t"], ["u", "v"])
    assert (labels.input_names, labels.output_names) == (("u", "v"), ("y", "t"))
    assert np.array_equal(labels.inputs, np.column_stack([U, -U]))
    tables = given_signals(table[["u", "v"]], table[["y"]])
    assert np.array_equal(tables.inputs, labels.inputs)
    assert tables.sampling_rate == 20.0
    arrays = given_signals(labels.inputs, labels.outputs, sampling_rate=2.0)
    assert arrays.input_names == ("input_1", "input_2")
    assert np.array_equal(arrays.outputs, labels.outputs)


DATES = pd.date_range("2024-01-01", periods=50, freq="10ms")


@pytest.mark.parametrize(
    "index",
    [
        pd.date_range("2030-01-01", periods=50, freq="1h"),
        DATES + pd.Timedelta("2s"),
        pd.date_range("2024-01-01", periods=50, freq="20ms"),
        DATES[::-1],
        pd.RangeIndex(50),
    ],
    ids=["another year", "later", "slower", "reversed", "none"],
)
def test_samples_of_other_times_are_not_paired_by_position(index):
    with pytest.raises(InputError, match="not paired by position"):
        given_signals(pd.Series(U, DATES), pd.Series(Y, index))
    with pytest.raises(InputError, match="not paired by position"):
        given_signals(pd.Series(U, index), pd.Series(Y, DATES))
    assert given_signals(pd.Series(U, DATES), pd.Series(Y, DATES)).sampling_rate == 100.0
    with pytest.raises(InputError, match="input: the indexes of input and output differ"):
        recording_of(pd.Series(U, DATES), pd.Series(Y, index), 100.0)
    assert recording_of(pd.Series(U, DATES), pd.Series(Y, DATES), 100.0).samples == len(Y)


def test_masked_samples_are_missing():
    output = np.ma.masked_array(np.where(np.arange(50) == 7, 9999, 3), np.arange(50) == 7)
    found = given_signals(np.ma.masked_array(U), output, sampling_rate=1.0)
    assert np.flatnonzero(np.isnan(found.outputs[:, 0])).tolist() == [7]
    assert np.array_equal(found.inputs[:, 0], U)


def test_the_unit_of_times_is_the_stated_one():
    table = frame()
    table["t"] = 10 * np.arange(50)
    assert given_signals(table, "y", "u", "t", time_unit="ms").sampling_rate == 100.0


@pytest.mark.parametrize("rate", ["abc", [100], 1j, 10**400, True, 0, -1.0, np.nan])
def test_what_is_no_rate_is_refused(rate):
    with pytest.raises(InputError, match=r"sampling_rate: .* is no rate; give a positive number"):
        given_signals(U, Y, sampling_rate=rate)


@pytest.mark.parametrize("label", [False, {}, ["y", "y2"], np.nan])
def test_what_is_no_label_is_refused(label):
    table = frame()
    table.columns = [0, "y", "t", "word"]
    with pytest.raises(InputError, match="data, output: there is no column"):
        given_signals(table, label, "t", sampling_rate=1.0)
