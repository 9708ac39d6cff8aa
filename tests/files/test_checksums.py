"""Checksums of results: sha256sum verifies them, and they tell a changed file."""

import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor

import pytest

from evopem.errors import InputError
from evopem.files.checksums import verify_checksums, write_checksums
from evopem.files.job import job


def make(folder, *names, text="content"):
    """Write files into a folder."""
    paths = [folder / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text} of {path.name}")
    return paths


def sha256sum(folder):
    """Let the system's program verify all checksums of a folder; what it says."""
    files = sorted(folder.glob("checksums/**/*.sha256"))
    return subprocess.run(
        ["sha256sum", "--check", *(file.relative_to(folder) for file in files)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


needs_sha256sum = pytest.mark.skipif(not shutil.which("sha256sum"), reason="no sha256sum here")


@needs_sha256sum
def test_sha256sum_verifies_the_outputs_of_all_jobs(tmp_path):
    results = {
        "recording": ["recording.npz", "recording.json"],
        "phases/delay/part-1": ["phases/delay/part-1.json"],
        "phases/delay": ["phases/delay.json"],
    }
    for name, outputs in results.items():
        with job(tmp_path / "logs" / f"{name}.log", outputs=[tmp_path / each for each in outputs]):
            make(tmp_path, *outputs)
    checked = sha256sum(tmp_path)
    assert checked.returncode == 0
    assert checked.stdout.count(": OK") == 4
    assert (tmp_path / "checksums" / "phases" / "delay" / "part-1.sha256").is_file()
    make(tmp_path, "phases/delay.json", text="other content")
    assert "phases/delay.json: FAILED" in sha256sum(tmp_path).stdout


@pytest.mark.parametrize("name", ["x.json", "phases/x.json"])
def test_a_changed_input_is_refused_by_name(tmp_path, capsys, name):
    write_checksums(make(tmp_path, name, "y.json"), tmp_path, "first")
    inputs = [tmp_path / name, tmp_path / "y.json"]
    with job(tmp_path / "logs" / "second.log", inputs):
        pass
    (tmp_path / name).write_text("changed")
    with pytest.raises(SystemExit), job(tmp_path / "logs" / "second.log", inputs):
        raise AssertionError("not reached")
    assert capsys.readouterr().err.startswith(f"{tmp_path / name}: was changed or damaged")


def test_the_job_of_all_data_sets_verifies_their_summaries(tmp_path):
    results = tmp_path / "results"
    summaries = make(results, "a/summary.json", "b/summary.json")
    for summary in summaries:
        write_checksums([summary], summary.parent, "summary")
    verify_checksums(summaries, results)
    summaries[1].write_text("changed")
    with pytest.raises(InputError, match=r"b/summary\.json"):
        verify_checksums(summaries, results)


def test_what_has_no_checksum_passes(tmp_path):
    """A user's own recording is not verified, even beside a folder of checksums of their own."""
    (recording,) = make(tmp_path, "data/x.csv")
    make(tmp_path, "data/checksums/x.sha256")
    (tmp_path / "data" / "checksums" / "x.sha256").write_text(f"{'0' * 64}  x.csv\n")
    missing = tmp_path / "results" / "a" / "missing.json"
    verify_checksums([recording, missing], tmp_path / "results" / "a")
    with pytest.raises(InputError):
        verify_checksums([recording], tmp_path)


@needs_sha256sum
def test_another_division_into_jobs_leaves_no_outdated_checksum(tmp_path):
    names = ["recording.npz", "model.json", "summary.json"]
    write_checksums(make(tmp_path, *names), tmp_path, "identification")
    for name in names:
        write_checksums(make(tmp_path, name, text="new"), tmp_path, name.split(".")[0])
        assert sha256sum(tmp_path).returncode == 0
    assert not (tmp_path / "checksums" / "identification.sha256").exists()
    write_checksums(make(tmp_path, *names, text="newer"), tmp_path, "identification")
    checked = sha256sum(tmp_path)
    assert checked.returncode == 0
    assert checked.stdout.count(": OK") == 3
    left = [path.name for path in (tmp_path / "checksums").iterdir()]
    assert left == ["identification.sha256"]


@needs_sha256sum
def test_jobs_side_by_side_leave_no_outdated_checksum(tmp_path):
    """Each removes its own lines from the file of a job that made all of them before."""
    names = [f"{number}.json" for number in range(40)]
    write_checksums(make(tmp_path, *names), tmp_path, "identification")
    for name in names:
        os.unlink(tmp_path / name)  # noqa: PTH108  as Snakemake does before it starts a job

    def remake(name):
        write_checksums(make(tmp_path, name, text="new"), tmp_path, name)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(remake, names))
    checked = sha256sum(tmp_path)
    assert checked.returncode == 0
    assert checked.stdout.count(": OK") == len(names)


def test_equal_outputs_give_equal_checksum_files(tmp_path):
    for name in ("one", "two"):
        write_checksums(make(tmp_path / name, "x.json", "y.json"), tmp_path / name, "job")
    one, two = ((tmp_path / name / "checksums/job.sha256").read_bytes() for name in ("one", "two"))
    assert one == two
