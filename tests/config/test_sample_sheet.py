"""Many data sets at once: tables of data sets, and names with a `*`."""

import os
from pathlib import Path

import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def completed(text, name="recordings.csv", **more):
    Path(name).write_text(text, encoding="utf-8")
    return complete({"datasets": name, **more}).datasets


def test_a_row_is_an_entry():
    """The same data sets as in YAML: dots lead below, brackets hold lists, no text is no key."""
    table = completed(
        "name,file,input,sampling_rate,time,split.estimation,orders.plant,transforms.box_cox\n"
        '2020-1,data/1.csv,torque,100,,0.5,"[6, 9]",none\n'
        "b,2.csv,3,,t,800,auto,1.1\n"
    )
    written = {
        "2020-1": {
            "file": "data/1.csv",
            "input": "torque",
            "sampling_rate": 100,
            "split": {"estimation": 0.5},
            "orders": {"plant": [6, 9]},
            "transforms": {"box_cox": "none"},
        },
        "b": {
            "file": "2.csv",
            "input": 3,
            "time": "t",
            "split": {"estimation": 800},
            "orders": {"plant": "auto"},
            "transforms": {"box_cox": 1.1},
        },
    }
    assert repr(table) == repr(complete({"datasets": written}).datasets)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_spreadsheets_separators(separator):
    text = separator.join(("name", "file")) + "\r\n" + separator.join(("a", "x, y.csv")) + "\r\n"
    assert completed("\ufeff" + text)["a"].source.files == ("x, y.csv",)


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("", "recordings.csv:", "no data sets"),
        ("name,file\n", "recordings.csv:", "no data sets"),
        ("file\nx.csv\n", "line 1:", "no column name"),
        ("name,file,file\na,x,y\n", "line 1:", "two columns are called 'file'"),
        ("name,file\na,x\n\nb\n", "line 4:", "the row has 1 fields and the header 2"),
        ("name,file\na,x\na,y\n", "line 3, column name:", "a stands here for the second time"),
        ("name,file\n,x\n", "line 2, column name:", "there is no name"),
        ("name,file\na,x\n../b,y\n", "line 3, column name:", "'../b' cannot be the name"),
        ("name,file\na,x\nA,y\n", "line 3, column name:", "a and A are one folder"),
        ("name,file\na,x\nb,\n", "line 3 (b):", "file and synthesis are both missing"),
        ("name,fle\na,x\n", "line 2, column fle:", "did you mean file?"),
        ("name,file,split.estimate\na,x,1\n", "column split.estimate:", "did you mean estimation?"),
        (
            "name,file,sampling_rate\na,x,5\nb,y,-5\n",
            "line 3, column sampling_rate:",
            "-5 is below",
        ),
        ("name,file,sampling_rate\na,x,nan\n", "line 2, column sampling_rate:", "not a finite"),
        ('name,file,orders.nc\na,x,"[9, 6]"\n', "line 2, column orders.nc:", "write [6, 9]"),
        ('name,file,orders.nc\na,x,"[9, x]"\n', "line 2, column orders.nc:", "x cannot be used"),
        ('name,file,orders.nc\na,x,"[9, "\n', "line 2, column orders.nc:", "is no list"),
        ('name,file\na,"x\n', "recordings.csv:", "this is not a table"),
        ("name,file,validation_file\na,x,x\n", "column validation_file:", "is also the estimation"),
    ],
)
def test_an_error_names_the_row_and_the_column(text, place, said):
    with pytest.raises(InputError) as caught:
        completed(text)
    sentence = str(caught.value)
    assert sentence.startswith("recordings.csv")
    assert place in sentence
    assert said in sentence


def test_a_table_of_another_encoding_is_refused():
    Path("t.csv").write_bytes("name,file\nä,x".encode("latin-1"))
    with pytest.raises(InputError, match="not UTF-8"):
        complete({"datasets": "t.csv"})


def recordings(*names):
    Path("data[1]").mkdir()
    for name in names:
        Path("data[1]", name).write_text("")


def test_a_name_with_a_star_is_every_file_of_its_pattern():
    recordings("run_7.csv", "run_10.csv", "other.csv")
    pattern = {"file": "data[1]/run_*.csv", "validation_file": "check/*.csv", "sampling_rate": 9}
    written = {"bench-*": pattern, "one": {"synthesis": "armax"}}
    datasets = complete({"datasets": written}).datasets
    assert list(datasets) == ["bench-10", "bench-7", "one"]
    assert datasets["bench-7"].source.files == ("data[1]/run_7.csv",)
    assert datasets["bench-7"].source.validation_files == ("check/7.csv",)
    assert datasets["bench-10"].source.channels.sampling_rate == 9


@pytest.mark.parametrize(
    ("datasets", "place", "said"),
    [
        ({"b-*": {"file": "data[1]/*.csv", "inptu": 1}}, "datasets.b-*.inptu", "did you mean"),
        ({"b-*": {"file": "data[1]/*"}, "b-a.csv": {"file": "x"}}, "datasets", "b-a.csv is also"),
        ({"*-*": {"file": "data[1]/*.csv"}}, "datasets.*-*", "one * in the name"),
        ({"*": {"file": "data[1]/*.csv"}}, "datasets", "'b c' cannot be the name"),
    ],
)
def test_an_error_names_the_entry_with_the_star(datasets, place, said):
    recordings("a.csv", "b c.csv")
    with pytest.raises(InputError) as caught:
        complete({"datasets": datasets})
    assert str(caught.value).startswith(f"config.yaml, {place}")
    assert said in str(caught.value)


def test_every_data_set_is_in_exactly_one_shard():
    text = "name,file\n" + "".join(f"r{number},{number}.csv\n" for number in range(11))
    shards = [list(completed(text, shard=f"{number}/4")) for number in range(1, 5)]
    assert [len(shard) for shard in shards] == [3, 3, 3, 2]
    assert shards[2] == ["r2", "r6", "r10"]
    together = [name for shard in shards for name in shard]
    assert sorted(together) == sorted(f"r{number}" for number in range(11))


def test_the_time_to_read_a_table_grows_linearly_with_its_rows():
    """Ten times the rows take at most twenty times as long."""

    def seconds(rows):
        text = "name,file,orders.nc\n"
        text += "".join(f'r{row},{row}.csv,"[2, {row % 30 + 3}]"\n' for row in range(rows))
        before = os.times().user
        completed(text)
        return os.times().user - before

    seconds(10)
    assert seconds(4_000) < 20 * max(seconds(400), 0.02)
