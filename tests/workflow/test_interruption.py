"""Runs that are stopped and files that are spoilt: it goes on or says so; never a wrong result."""

import os
import resource
import subprocess

from .conftest import TINY
from .interruption import differences, run_with_kills


def test_killed_at_any_moment_the_results_are_those_of_an_undisturbed_run(folder, finished):
    """`python -m tests.workflow.interruption` does the same with twenty kills."""
    folder.configure(TINY)
    assert len(run_with_kills(folder, finished, 4, 1)) == 4
    assert_same_results(folder, finished)


def assert_same_results(folder, expected):
    assert differences(folder, expected) == []


def spoil(path, content):
    """Change a file as a failing disk does: its time stays as it was."""
    times = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def test_a_changed_or_truncated_result_is_refused_and_made_again(copy, finished):
    results = copy.results / "truth"
    changed, truncated = results / "phases" / "c.json", results / "phases" / "b.json"
    text = changed.read_text()
    place = text.index('"bic": ') + 9
    digit = "1" if text[place] != "1" else "2"
    spoil(changed, (text[:place] + digit + text[place + 1 :]).encode())
    spoil(truncated, truncated.read_bytes()[:300])
    for name in ("candidates.csv", "model.json", "report.html"):
        (results / name).unlink()
    run = copy.run("--cores", "1")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    for file in (changed, truncated):
        assert (
            f"{file.relative_to(copy.path)}: it was changed or damaged after it was written;"
            " delete it and run snakemake again" in run.stdout
        )
    assert not (results / "model.json").exists()
    assert not (results / "report.html").exists()
    changed.unlink()
    truncated.unlink()
    copy.finish("--cores", "2")
    assert_same_results(copy, finished)


def test_a_deleted_result_is_made_again(copy, finished):
    for name in ("model.json", "modes.csv", "phases/b.json", "phases/b/part-1.json"):
        (copy.results / "truth" / name).unlink()
    copy.finish("--cores", "2")
    assert_same_results(copy, finished)


def test_a_full_disk_is_said_and_leaves_nothing_half_written(copy, finished):
    """No file may grow beyond 40 kB, as on a full disk: the drawing of figures fails."""
    figures = copy.results / "truth" / "figures"
    for figure in figures.iterdir():
        figure.unlink()
    (copy.results / "truth" / "report.html").unlink()
    limit = 40_000
    run = subprocess.run(
        copy.command("--cores", "1"),
        cwd=copy.path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert "cannot be written (File too large); make room or give permission" in run.stdout
    assert not list(figures.glob("**/*"))
    copy.finish("--cores", "1")
    assert_same_results(copy, finished)
