"""Damaged results and a full disk: the run says so or makes them again, and gives no wrong result.

`test_fault_injection.py` disturbs runs at random moments.
"""

import os
import resource
import subprocess

from .interruption import differences


def assert_same_results(folder, expected):
    assert differences(folder, expected) == []


def damage(path, content):
    """Change a file as a failing disk does: its time of modification stays the same."""
    times = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def test_a_changed_or_truncated_result_is_refused_and_made_again(copy, finished):
    results = copy.results / "truth"
    changed, truncated = results / "phases" / "nc.json", results / "phases" / "nb.json"
    text = changed.read_text()
    place = text.index('"bic": ') + 9
    digit = "1" if text[place] != "1" else "2"
    damage(changed, (text[:place] + digit + text[place + 1 :]).encode())
    damage(truncated, truncated.read_bytes()[:300])
    for name in ("candidates.csv", "model.json", "report.html"):
        (results / name).unlink()
    run = copy.run("--cores", "1")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    for file in (changed, truncated):
        assert (
            f"{file.relative_to(copy.path)}: was changed or damaged after it was written;"
            " delete it and run snakemake again" in run.stdout
        )
    assert not (results / "model.json").exists()
    assert not (results / "report.html").exists()
    changed.unlink()
    truncated.unlink()
    copy.finish("--cores", "2")
    assert_same_results(copy, finished)


def test_a_deleted_result_is_made_again(copy, finished):
    for name in ("model.json", "modes.csv", "phases/nb.json", "phases/nb/part-1.json"):
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
    assert (
        "cannot be written (File too large); free disk space or change the permissions"
        in run.stdout
    )
    assert not list(figures.glob("**/*"))
    copy.finish("--cores", "1")
    assert_same_results(copy, finished)
