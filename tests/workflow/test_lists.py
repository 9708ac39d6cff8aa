"""The lists of all data sets after every kind of end of a run."""

import csv
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from evopem.results.layout import OVERVIEW

from .conftest import FEW_PHASES, TINY, Folder

STAGED = TINY | {"report": "none"}
SENTENCE = 'b.csv, line 51, column 2: "oops" is not a finite number; repair or remove that sample.'


def configure(folder, *names, **changes):
    """Name recordings in the configuration."""
    datasets = {name: {"file": f"{name}.csv", "sampling_rate": 100} for name in names}
    keys = {"report": "none", "one_job_per": "recording", "defaults": FEW_PHASES}
    folder.configure(keys | {"datasets": datasets} | changes)


def table(folder):
    """Status, problem and orders of each data set in the table of all of them."""
    with (folder.results / "fleet.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {row["dataset"]: (row["status"], row["problem"], row["na"]) for row in rows}


def damage(path):
    lines = path.read_text().splitlines(keepends=True)
    lines[50] = "1,oops\n"
    path.write_text("".join(lines))


@pytest.fixture(scope="module")
def two(recorded, tmp_path_factory):
    """A finished run with two recordings; nobody changes it."""
    folder = Folder(tmp_path_factory.mktemp("two"))
    for start, name in enumerate("ab"):
        np.savetxt(folder.path / f"{name}.csv", recorded[start:], delimiter=",")
    configure(folder, "a", "b")
    folder.finish("--cores", "2")
    return folder


@pytest.fixture
def copy_of_two(two, tmp_path):
    return two.copied(tmp_path / "copy")


def test_results_that_went_bad_are_not_listed_as_complete(copy_of_two, two):
    """A recording and a summary are damaged, then mended, then one of the data sets is removed."""
    folder, before = copy_of_two, table(two)
    assert {status for status, *_ in before.values()} == {"complete"}
    recording, summary = folder.path / "b.csv", folder.results / "a" / "summary.json"
    damage(recording)
    text = summary.read_text()
    summary.write_text(text[: len(text) // 2])
    run = folder.run("--cores", "2")
    assert run.returncode == 1
    assert "Traceback" not in run.stdout
    listed = table(folder)
    assert listed["b"] == ("failed", SENTENCE, "")
    assert listed["a"][0] == "failed"
    assert listed["a"][1].startswith("results/a/summary.json: was changed or damaged")
    html = (folder.results / "index.html").read_text()
    assert "b.csv, line 51, column 2" in html
    assert "results/a/summary.json: was changed or damaged" in html

    shutil.copy2(two.path / "b.csv", recording)
    summary.unlink()
    folder.finish("--cores", "2")
    assert table(folder) == before
    assert folder.planned() == {}

    configure(folder, "a")
    folder.finish("--cores", "1")
    assert table(folder) == {"a": before["a"]}
    assert ">b</a>" not in (folder.results / "index.html").read_text()


def test_an_edited_result_is_listed_as_changed_until_it_is_made_again(copy_of_two, two):
    """No job reads it, so that its time alone starts none."""
    folder, before = copy_of_two, table(two)
    validation = Path(folder.files_of("a").validation)
    text = validation.read_text()
    validation.write_text(text.replace("e", "f", 1))
    folder.finish("--cores", "1")
    status, problem, _ = table(folder)["a"]
    assert status == "failed"
    assert problem.startswith("results/a/validation.json: was changed or damaged")
    assert table(folder)["b"] == before["b"]
    assert folder.planned() == {}

    validation.unlink()
    folder.finish("--cores", "1")
    assert table(folder) == before
    assert validation.read_text() == text
    assert folder.planned() == {}


@pytest.fixture(scope="module")
def staged(finished, tmp_path_factory):
    """A finished run with a job for each stage, and lists of before: they are made again."""
    folder = finished.copied(tmp_path_factory.mktemp("staged") / "copy")
    folder.configure(STAGED)
    for file in OVERVIEW:
        (folder.path / file).touch()
        os.utime(folder.path / file, (320_000_000, 320_000_000))
    folder.finish("--cores", "1")
    return folder


@pytest.fixture
def copy_of_staged(staged, tmp_path):
    return staged.copied(tmp_path / "copy")


def test_a_result_that_alone_could_not_be_made_is_listed_until_it_is(copy_of_staged, staged):
    """The lists are made again though the summary comes out as it was."""
    folder, before = copy_of_staged, table(staged)
    assert {status for status, *_ in before.values()} == {"complete"}
    files = folder.files_of("truth")
    Path(files.candidates).unlink()
    phase = Path(files.phase("nb"))
    text, times = phase.read_text(), phase.stat()
    phase.write_text(text.replace('"reason": "', '"reason": "x'))
    os.utime(phase, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert folder.run("--cores", "1").returncode == 1
    status, problem, _ = table(folder)["truth"]
    assert status == "failed"
    assert problem.startswith("results/truth/phases/nb.json: was changed or damaged")
    phase.write_text(text)
    os.utime(phase, ns=(times.st_atime_ns, times.st_mtime_ns))
    folder.finish("--cores", "1")
    assert table(folder) == before
    assert folder.planned() == {}


def test_a_first_run_on_one_core_lists_what_each_data_set_said(two, folder):
    """In the sentence of the job that failed, whatever other jobs said before and after it."""
    for name in "ab":
        shutil.copy(two.path / f"{name}.csv", folder.path)
    damage(folder.path / "b.csv")
    good = {"file": "a.csv", "sampling_rate": 100}
    datasets = {
        "b": {"file": "b.csv", "sampling_rate": 100},
        "missing": {"file": "none.csv", "sampling_rate": 100},
        "formula": {"file": "=cmd|' C calc'!A0.csv", "sampling_rate": 100},
        "box_cox": good | {"transforms": {"box_cox": -80}},
        "rate": {"file": "a.csv"},
        "discard": good | {"split": {"discard": 5000}},
    }
    folder.configure(TINY | {"report": "none", "datasets": datasets})
    run = folder.run("--cores", "1")
    assert run.returncode == 1
    assert "Traceback" not in run.stdout
    listed = table(folder)
    assert listed["b"] == ("failed", SENTENCE, "")
    problems = {name: problem for name, (_, problem, _) in listed.items()}
    assert {status for status, *_ in listed.values()} == {"failed"}
    assert problems["missing"].startswith("none.csv: there is no such file")
    assert problems["formula"].startswith("'=cmd|' C calc'!A0.csv: there is no such file")
    assert problems["box_cox"].startswith("datasets.box_cox.transforms.box_cox: the parameter -80")
    assert problems["rate"].startswith("a.csv: the sampling rate is not known")
    assert problems["discard"].startswith("datasets.discard.split.discard: 5000 samples")


def test_a_job_that_is_killed_is_not_quoted(copy_of_two):
    """Not with the last line of its log, which is about progress."""
    folder = copy_of_two
    Path(folder.files_of("b").model).unlink()
    run = psutil.Popen(folder.command("--cores", "1"), cwd=folder.path)
    assert kill_job(run, folder.results / "b" / "logs" / "identification.log") == -signal.SIGKILL
    assert run.wait() == 1
    status, problem, _ = table(folder)["b"]
    assert status == "failed"
    assert problem.startswith("the job identification ended without a message")
    assert table(folder)["a"][0] == "complete"


def test_a_killed_run_does_not_leave_outdated_results_listed_as_complete(copy_of_staged, staged):
    """Of a run that is killed nothing remains to correct the lists."""
    folder = copy_of_staged
    folder.configure(STAGED | {"defaults": TINY["defaults"] | {"spectrum": {"nfft": 1024}}})
    run = psutil.Popen(
        folder.command("--cores", "1", "--until", "estimate_spectrum"), cwd=folder.path
    )
    log = folder.results / "truth" / "logs" / "estimate_spectrum.log"
    assert kill_job(run, log, run) == -signal.SIGKILL
    run.wait()
    assert {status for status, *_ in table(folder).values()} == {"unfinished"}
    folder.finish("--unlock")
    folder.configure(STAGED)
    folder.finish("--cores", "1")
    assert table(folder) == table(staged)


def test_a_result_beside_the_summary_that_is_made_again_is_listed_at_once(copy_of_staged, staged):
    Path(copy_of_staged.files_of("truth").candidates).unlink()
    copy_of_staged.finish("--cores", "1", "results/truth/candidates.csv")
    assert table(copy_of_staged) == table(staged)


def kill_job(run, log, victim=None):
    """Kill the process that has a log file open, or another one then; its return code."""
    while run.poll() is None:
        for process in run.children(recursive=True):
            try:
                if str(log) in [file.path for file in process.open_files()]:
                    (victim or process).kill()
                    return -signal.SIGKILL
            except psutil.Error:
                continue
        time.sleep(0.03)
    return None
