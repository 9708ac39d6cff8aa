"""Runs that are killed at random moments, and what is left of them.

    python -m tests.workflow.interruption [kills] [seed]

kills runs of a small configuration twenty times at random moments, lets the last one end, and
compares its results with those of an undisturbed run.
"""

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

from .conftest import TINY, Folder

MAX_SECONDS = 12.0  # that a run is given, at most, before it is killed
ARGUMENTS = ("--cores", "2")


def run_with_kills(folder: Folder, expected: Folder, kills: int, seed: int) -> list[str]:
    """Kill runs with all their jobs at random moments, then let one end; describe each kill.

    A run that ends before it can be killed is compared as well, and a new one begins.
    """
    moments = random.Random(seed)
    story = []
    while len(story) < kills:
        run = folder.start(*ARGUMENTS)
        moment = moments.uniform(0.5, MAX_SECONDS)
        deadline = time.monotonic() + moment
        while time.monotonic() < deadline and run.poll() is None:
            time.sleep(0.02)
        if run.poll() is not None:
            assert run.returncode == 0
            assert differences(folder, expected) == []
            shutil.rmtree(folder.results)
            continue
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        story.append(f"killed after {moment:.1f} s, with {len(final_files(folder))} files made")
        folder.finish("--unlock")
    folder.finish(*ARGUMENTS)
    return story


def final_files(folder: Folder) -> dict[str, bytes]:
    """Every result by its name; logs, times and the report that shows these are left out."""
    passing = {"logs", "benchmarks", "report.html", "report.sha256"}
    return {
        path.relative_to(folder.results).as_posix(): path.read_bytes()
        for path in sorted(folder.results.rglob("*"))
        if path.is_file() and not passing & set(path.relative_to(folder.results).parts)
    }


def differences(folder: Folder, other: Folder) -> list[str]:
    """Names of the results that one of two folders lacks, or that differ in a byte."""
    one, two = final_files(folder), final_files(other)
    return sorted(name for name in one | two if one.get(name) != two.get(name))


def main(kills: int = 20, seed: int = 1) -> None:
    with tempfile.TemporaryDirectory() as root:
        folders = []
        for name in ("undisturbed", "killed"):
            path = Path(root) / name
            path.mkdir()
            folders.append(Folder(path))
            folders[-1].configure(TINY)
        undisturbed, killed = folders
        undisturbed.finish(*ARGUMENTS)
        for line in run_with_kills(killed, undisturbed, kills, seed):
            print(line)
        different = differences(killed, undisturbed)
        print(f"{len(final_files(undisturbed))} results, {len(different)} different: {different}")
        sys.exit(bool(different))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
