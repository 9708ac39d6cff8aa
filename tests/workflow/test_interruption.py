"""Damaged results and a full disk: the run says so or makes them again.

`test_fault_injection.py` disturbs runs at random moments.
"""

import os
from pathlib import Path

from .conftest import TINY
from .interruption import differences


def assert_same_results(folder, expected):
    assert differences(folder, expected) == []


def damage(path, content):
    """Change a file as a failing disk does: its time of modification stays the same."""
    times = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def test_a_truncated_or_deleted_result_is_refused_or_made_again(copy, finished):
    """A truncated file is refused in a sentence; a deleted one is made again.

    A changed one is refused in `test_lists.py`.
    """
    copy.configure(TINY | {"report": "none"})
    files = copy.files_of("truth")
    truncated = Path(files.phase("nb"))
    damage(truncated, truncated.read_bytes()[:300])
    for path in (files.candidates, files.model):
        Path(path).unlink()
    run = copy.run("--cores", "1")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert (
        f"{truncated.relative_to(copy.path)}: was changed or damaged after it was written;"
        " delete it and run snakemake again" in run.stdout
    )
    assert not Path(files.model).exists()
    assert not Path(files.candidates).exists()
    for path in (files.phase("nc"), truncated, files.spectrum, files.part("nb", 1)):
        Path(path).unlink()
    copy.finish("--cores", "2")
    assert_same_results(copy, finished)


def test_a_deleted_file_that_only_finished_jobs_have_read_is_made_again(copy):
    files = copy.files_of("truth")
    for path in (files.prepared, files.phase("delay")):
        Path(path).unlink()
    assert {"prepare", "select_candidate"} <= copy.planned().keys()


def test_a_full_disk_is_reported_and_leaves_nothing_half_written(copy, finished):
    """No file may grow beyond 40 kB, as on a full disk: the table of the response fails."""
    copy.configure(TINY | {"report": "none"})
    files = copy.files_of("truth")
    made = (files.model, files.model_mat, files.frequency_response, files.time_response)
    for path in made:
        Path(path).unlink()
    run = copy.run("--cores", "1", largest_file=40_000)
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert "cannot be written (File too large); free disk space or" in run.stdout
    assert not [path for path in made if Path(path).exists()]
    assert not list((copy.results / "truth").rglob(".writing-*"))
    copy.finish("--cores", "1")
    assert_same_results(copy, finished)
