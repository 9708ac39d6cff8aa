"""The table of a fleet: every mode and check of every data set, and those that have no model."""

import pandas as pd
import pytest

from evopem.figures import result_paths
from evopem.results.dataset import read_json
from evopem.results.fleet import fleet_table, read_summaries, summarize
from evopem.files.atomic import write_json, write_parquet, write_table


@pytest.fixture(scope="module")
def fleet(results, tmp_path_factory):
    """Results of two data sets and the logs of three that failed, each in its own way."""
    folder = tmp_path_factory.mktemp("fleet")
    summary = summarize(result_paths(results))
    write_json(folder / "good" / "summary.json", summary)
    write_json(folder / "real poles" / "summary.json", summary | {"modes": []})
    for name, text in {
        "bad": "10:00:00 starts\n10:00:01 x.csv: bad; mend it.\n",
        "killed": "",
    }.items():
        logs = folder / name / "logs"
        logs.mkdir(parents=True)
        (logs / "recording.log").write_text(text)
    names = ["good", "bad", "killed", "never", "real poles"]
    return read_summaries(folder, names)


def test_one_row_for_each_mode_and_one_for_each_data_set_without(fleet, results):
    table = fleet_table(fleet)
    model = read_json(results / "model.json")
    count = table.groupby("dataset", sort=False).size()
    assert count.to_dict() == {
        "good": len(model["modes"]),
        "bad": 1,
        "killed": 1,
        "never": 1,
        "real poles": 1,
    }
    good = table[table["dataset"] == "good"]
    assert good["frequency_hz"].tolist() == [mode["frequency_hz"] for mode in model["modes"]]
    assert good["mode"].tolist() == list(range(1, len(model["modes"]) + 1))
    assert good["na"].unique().tolist() == [model["orders"]["na"]]
    failed = good.filter(like="check_").eq(False).sum(axis=1)
    assert good["failed_checks"].tolist() == failed.tolist()


def test_what_failed_says_why(fleet):
    table = fleet_table(fleet).set_index("dataset")
    assert table.loc["bad", "problem"] == "x.csv: bad; mend it."
    assert table.loc["killed", "problem"] == "recording came to no end"
    assert table.loc["never", "problem"] == "nothing was computed"
    assert table["status"].value_counts().to_dict()["failed"] == 3
    assert pd.isna(table.loc["bad", "na"])


def test_csv_and_parquet_hold_the_same(fleet, tmp_path):
    table = fleet_table(fleet)
    write_parquet(tmp_path / "fleet.parquet", table)
    write_table(tmp_path / "fleet.csv", table.astype(object).where(table.notna(), None))
    from_parquet = pd.read_parquet(tmp_path / "fleet.parquet")
    pd.testing.assert_frame_equal(from_parquet, table)
    from_csv = pd.read_csv(tmp_path / "fleet.csv", dtype=table.dtypes.to_dict())
    pd.testing.assert_frame_equal(from_csv, table)
