"""Signals that a user hands over, in every form, and the rates that they state."""

import numpy as np
import pandas as pd
import pytest

from evopem.errors import InputError
from evopem.notebook.signals import given_recordings, given_signals
from evopem.signals.reading import read_recording

U, Y = np.random.default_rng(1).standard_normal((2, 50))
TIME = np.arange(50) / 20.0


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
    assert np.array_equal(found.input, U)
    assert np.array_equal(found.output, Y)
    assert (found.input_name, found.output_name) == ("u", "y")


def test_series_and_arrays_state_what_they_know():
    table = frame(TIME)
    series = given_signals(table["u"], table["y"])
    assert (series.sampling_rate, series.input_name, series.output_name) == (20.0, "u", "y")
    arrays = given_signals(list(U), Y[:, None], sampling_rate=5.0)
    assert (arrays.sampling_rate, arrays.input_name, arrays.output_name) == (5.0, "input", "output")
    alone = given_signals(None, table["y"])
    assert alone.input is None


def test_the_signals_are_a_copy_in_a_file_that_the_readers_take(tmp_path):
    output = Y.copy()
    found = given_signals(U, output, sampling_rate=20.0)
    output[0] = 99.0
    assert found.output[0] == Y[0]
    found.save(tmp_path / "data.npz")
    read = read_recording(tmp_path / "data.npz", "input", "output", sampling_rate=20.0)
    assert np.array_equal(read.input, U)
    assert np.array_equal(read.output, Y)


def test_missing_values_of_a_table_become_nan():
    table = frame()
    table["y"] = table["y"].astype("Float64")
    table.loc[3, "y"] = pd.NA
    assert np.isnan(given_signals(table, "y", "u", sampling_rate=1.0).output[3])


def test_lists_of_tables_and_of_signals_are_several_recordings():
    first, second = given_recordings([frame(TIME), frame(TIME + 9.0)], "y", "u")
    assert np.array_equal(first.input, second.input)
    arrays = given_recordings([U, U[:30]], [Y, Y[:30]], sampling_rate=2.0)
    assert [each.output.size for each in arrays] == [50, 30]
    assert len(given_recordings(list(U), list(Y), sampling_rate=2.0)) == 1
    assert given_recordings(None, [Y, Y], sampling_rate=2.0)[1].input is None
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
        ((U, np.ones((50, 2))), "data, output: the signal has 2 dimensions"),
        ((U, 1j * Y), "data, output: it holds no real numbers"),
        ((pd.concat([frame(), frame()], axis=1), "y", "u"), "2 columns are called 'u'"),
        (
            (frame(pd.date_range("2026-01-01", periods=50, freq="50ms")), "y", "u", None, 10.0),
            "the time stamps give 20 Hz and the stated sampling rate is 10 Hz",
        ),
        ((frame(TIME**2), "y", "u"), 'time "index"'),
    ],
)
def test_what_cannot_be_used_is_said_in_a_sentence(arguments, sentence):
    with pytest.raises(InputError) as refused:
        given_signals(*arguments)
    assert sentence in str(refused.value)
