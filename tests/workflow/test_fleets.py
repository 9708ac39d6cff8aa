"""Many recordings: one job for each, shares, and the lists of all of them."""

import csv
import json
import re

import numpy as np
import pytest

from .conftest import TINY

SAME = (
    *("model.json", "model.mat", "candidates.csv", "modes.csv", "frequency_response.csv"),
    *("validation.json", "simulation.csv", "spectrum.csv", "summary.json", "phases/b.json"),
)


@pytest.fixture(scope="session")
def recordings(finished, tmp_path_factory):
    """Three recordings of one system and one that is none, and a table of them."""
    folder = tmp_path_factory.mktemp("recordings")
    with np.load(finished.results / "truth" / "recording.npz") as stored:
        record = np.column_stack([stored["input"], stored["output"]])
    (folder / "data").mkdir()
    for number in range(1, 4):
        np.savetxt(folder / "data" / f"{number}.csv", record[number:], delimiter=",")
    (folder / "data" / "4.csv").write_text("1,2\n3,oops\n" * 300)
    rows = ["name,file,sampling_rate", *(f"r{n},data/{n}.csv,100" for n in range(1, 5))]
    (folder / "recordings.csv").write_text("\n".join(rows) + "\n")
    return folder


@pytest.fixture
def fleet(folder, recordings):
    """A folder with the table's first three recordings."""
    (folder.path / "data").symlink_to(recordings / "data")
    lines = (recordings / "recordings.csv").read_text().splitlines()
    (folder.path / "recordings.csv").write_text("\n".join(lines[:4]) + "\n")
    folder.configure(
        {
            "datasets": "recordings.csv",
            "defaults": TINY["defaults"],
            "one_job_per": "recording",
            "report": "none",
        }
    )
    return folder


def table(folder):
    with (folder.results / "fleet.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_one_job_makes_what_the_stages_make(finished, folder):
    folder.configure(TINY | {"one_job_per": "recording", "candidates_per_job": "auto"})
    assert folder.planned() == {"identify_synthetic_recording": 1}
    folder.finish("--cores", "2")
    for name in SAME:
        here, there = (each.results / "truth" / name for each in (folder, finished))
        assert here.read_bytes() == there.read_bytes(), name
    made = {path.relative_to(folder.results) for path in folder.results.rglob("*.*")}
    staged = {path.relative_to(finished.results) for path in finished.results.rglob("*.*")}
    left_out = {path for path in staged if path.parts[1] in ("logs", "benchmarks")}
    left_out |= {path for path in staged if path.name.startswith("part-")}
    assert staged - left_out <= made
    assert folder.planned() == {}


def test_a_fleet_with_a_bad_recording_is_listed_and_later_complete(fleet, recordings):
    """The bad one is listed with its error; mended, it and the lists are made and nothing else."""
    text = (recordings / "recordings.csv").read_text()
    (fleet.path / "recordings.csv").write_text(text)
    run = fleet.run("--cores", "2")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    rows = {row["dataset"]: row for row in table(fleet)}
    assert [row["status"] for row in rows.values()] == ["complete"] * 3 + ["failed"]
    assert "4.csv, line 2, column 2" in rows["r4"]["problem"]
    html = (fleet.results / "index.html").read_text()
    assert html.index(">r4<") < min(html.index(f">r{n}<") for n in (1, 2, 3))
    assert re.search(r"<h1>4 data sets", html)

    (fleet.path / "recordings.csv").write_text(text.replace("data/4.csv", "data/1.csv"))
    assert fleet.planned() == {"identify_recording": 1, "collect_fleet": 1}
    fleet.finish("--cores", "2")
    rows = {row["dataset"]: row for row in table(fleet)}
    assert {row["status"] for row in rows.values()} == {"complete"}
    model = json.loads((fleet.results / "r4" / "model.json").read_text())
    last = [row for row in table(fleet) if row["dataset"] == "r4"]
    assert [float(row["frequency_hz"] or 0) for row in last] == [
        mode["frequency_hz"] for mode in model["modes"]
    ]
    assert fleet.planned() == {}


def test_shares_are_parts_of_the_whole(fleet):
    """What a share makes is done for the whole, and no share makes the lists of all."""
    for share, count in (("1/2", 2), ("2/2", 1)):
        assert fleet.planned("--config", f"share={share}") == {"identify_recording": count}
    fleet.finish("--cores", "1", "--nolock", "--config", "share=2/2")
    assert not (fleet.results / "index.html").exists()
    assert fleet.planned() == {"identify_recording": 2, "collect_fleet": 1}


def test_other_cores_redo_nothing(finished, folder):
    folder.configure(TINY | {"candidates_per_job": "auto"})
    folder.finish("--cores", "3", "results/truth/phases/delay.json")
    planned = folder.planned("--cores", "1")
    assert planned["fit_candidates"] == planned["select_candidate"] == 3
    one, other = (each.results / "truth" / "phases" / "delay.json" for each in (folder, finished))
    assert one.read_bytes() == other.read_bytes()
