"""Many recordings: one job for each, shards, and the lists of all of them."""

import csv
import re
from pathlib import Path

import numpy as np

from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load

from .conftest import FEW_PHASES, jobs_of_each_rule


def table(folder):
    with (folder.results / "fleet.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_fleet_in_shards_of_batches_with_a_bad_recording_is_listed_and_later_complete(
    folder, recorded
):
    """The bad one takes no neighbour along; shards count for the whole; nothing is done twice."""
    (folder.path / "data").mkdir()
    for number in (1, 3):
        np.savetxt(folder.path / "data" / f"{number}.csv", recorded[number:], delimiter=",")
    (folder.path / "data" / "2.csv").write_text("1.5,2.5\n3.5,oops\n" * 300)
    recordings = folder.path / "recordings.csv"
    rows = "name,file,sampling_rate\n" + "".join(f"r{n},data/{n}.csv,100\n" for n in (1, 2, 3))
    recordings.write_text(rows)
    keys = {"one_job_per": "recording", "recordings_per_job": 2, "report": "none"}
    folder.configure({"datasets": "recordings.csv", "defaults": FEW_PHASES, **keys})

    printed = folder.finish("--cores", "1", "--nolock", "--config", "shard=2/2")
    assert jobs_of_each_rule(printed) == {"identify_batch": 1}
    assert (folder.results / "r3" / "summary.json").exists()
    assert not (folder.results / "index.html").exists()

    run = folder.run("--cores", "2")
    assert jobs_of_each_rule(run.stdout) == {"identify_batch": 1, "list_datasets": 1}
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert "1 of the 2 recordings of this job failed (r2)" in run.stdout
    listed = {row["dataset"]: row for row in table(folder)}
    assert [row["status"] for row in listed.values()] == ["complete", "failed", "complete"]
    assert "2.csv, line 2, column 2" in listed["r2"]["problem"]
    assert not list((folder.results / "r2").glob(".*")), "a part of a recording that failed"
    html = (folder.results / "index.html").read_text(encoding="utf-8")
    assert html.index(">r2<") < min(html.index(f">r{n}<") for n in (1, 3))
    assert re.search(r"<h1>3 data sets", html)
    kept = sorted(path for path in (folder.results / "r1").rglob("*") if path.is_file())
    assert len(kept) == 9
    before = {path: path.stat().st_mtime_ns for path in kept}

    recordings.write_text(rows.replace("data/2.csv", "data/1.csv"))
    printed = folder.finish("--cores", "2")
    assert jobs_of_each_rule(printed) == {"identify_batch": 1, "list_datasets": 1}
    assert {path: path.stat().st_mtime_ns for path in kept} == before
    assert {row["status"] for row in table(folder)} == {"complete"}
    frequencies = [row["frequency_hz"] for row in table(folder) if row["dataset"] == "r2"]
    model = load(ModelRecord, folder.files_of("r2").model)
    assert [float(each) for each in frequencies if each] == [
        mode.frequency_hz for mode in model.modes
    ]
    assert folder.planned() == {}
    Path(folder.files_of("r3").modes).unlink()
    assert folder.planned() == {"identify_batch": 1, "list_datasets": 1}
