"""Many recordings: one job for each, shards, and the lists of all of them."""

import csv
import re
from pathlib import Path

import numpy as np

from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load

from .conftest import TINY, jobs_of_each_rule


def test_one_job_makes_what_the_stages_make(finished, folder):
    folder.configure(TINY | {"one_job_per": "recording", "candidates_per_job": "auto"})
    printed = folder.finish("--cores", "2")
    assert jobs_of_each_rule(printed) == {"identify_synthetic_armax": 1}
    made, staged = (each.files_of("truth") for each in (folder, finished))
    results = [
        *staged.results,
        staged.recording,
        staged.prepared,
        staged.truth,
        *staged.phases("armax"),
    ]
    results += staged.figures
    for path in map(Path, results):
        same = Path(made.folder) / path.relative_to(staged.folder)
        assert same.read_bytes() == path.read_bytes(), path
    assert Path(made.report).stat().st_size > 50_000
    files = {path.relative_to(made.folder) for path in Path(made.folder).rglob("*.*")}
    assert not [path for path in files if path.name.startswith("part-")]
    assert folder.planned() == {}
    Path(made.phase("nc")).unlink()  # no other job of the run needs it
    assert folder.planned() == {"identify_synthetic_armax": 1}


def table(folder):
    with (folder.results / "fleet.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_fleet_in_shards_with_a_bad_recording_is_listed_and_later_complete(folder, recorded):
    """Shards are done for the whole; the bad one is listed, and made again when it is mended."""
    (folder.path / "data").mkdir()
    for number in (1, 2):
        np.savetxt(folder.path / "data" / f"{number}.csv", recorded[number:], delimiter=",")
    (folder.path / "data" / "3.csv").write_text("1.5,2.5\n3.5,oops\n" * 300)
    recordings = folder.path / "recordings.csv"
    rows = "name,file,sampling_rate\n" + "".join(f"r{n},data/{n}.csv,100\n" for n in (1, 2, 3))
    recordings.write_text(rows)
    keys = {"one_job_per": "recording", "report": "none"}
    folder.configure({"datasets": "recordings.csv", "defaults": TINY["defaults"], **keys})

    assert folder.planned("--config", "shard=1/2") == {"identify_recorded_armax": 2}
    printed = folder.finish("--cores", "1", "--nolock", "--config", "shard=2/2")
    assert jobs_of_each_rule(printed) == {"identify_recorded_armax": 1}
    assert (folder.results / "r2" / "summary.json").exists()
    assert not (folder.results / "index.html").exists()

    run = folder.run("--cores", "2")
    assert jobs_of_each_rule(run.stdout) == {"identify_recorded_armax": 2, "collect_fleet": 1}
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    listed = {row["dataset"]: row for row in table(folder)}
    assert [row["status"] for row in listed.values()] == ["complete", "complete", "failed"]
    assert "3.csv, line 2, column 2" in listed["r3"]["problem"]
    html = (folder.results / "index.html").read_text(encoding="utf-8")
    assert html.index(">r3<") < min(html.index(f">r{n}<") for n in (1, 2))
    assert re.search(r"<h1>3 data sets", html)

    recordings.write_text(rows.replace("data/3.csv", "data/1.csv"))
    printed = folder.finish("--cores", "2")
    assert jobs_of_each_rule(printed) == {"identify_recorded_armax": 1, "collect_fleet": 1}
    assert {row["status"] for row in table(folder)} == {"complete"}
    frequencies = [row["frequency_hz"] for row in table(folder) if row["dataset"] == "r3"]
    model = load(ModelRecord, folder.files_of("r3").model)
    assert [float(each) for each in frequencies if each] == [
        mode.frequency_hz for mode in model.modes
    ]
    assert folder.planned() == {}
