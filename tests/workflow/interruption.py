"""Runs killed again and again, as a power cut would, and what is left of them.

    python -m tests.workflow.interruption [kills] [seed]

kills 20 runs of a small configuration at random moments, lets the 21st end, and compares its
results with those of a run that nobody disturbed.
"""

import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from .conftest import TINY, Folder

LONGEST = 12.0  # seconds that a run is left alone, at most


def run_with_kills(folder: Folder, kills: int, seed: int, *arguments: str) -> list[str]:
    """Kill so many runs with all their jobs at random moments, then let one end; say what lived."""
    moments = random.Random(seed)
    story = []
    for _ in range(kills):
        run = folder.start(*arguments)
        moment = moments.uniform(0.5, LONGEST)
        deadline = time.monotonic() + moment
        while time.monotonic() < deadline and run.poll() is None:
            time.sleep(0.02)
        if run.poll() is not None:
            assert run.returncode == 0
            break
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        story.append(f"killed after {moment:.1f} s, with {len(final_files(folder))} files made")
        folder.finish("--unlock")
    folder.finish(*arguments)
    return story


def final_files(folder: Folder) -> dict[str, bytes]:
    """Every result by its name; logs, times and the report that shows these are left out."""
    passing = {"logs", "benchmarks", "report.html", "report.html.sha256"}
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
        folders[0].finish("--cores", "2")
        for line in run_with_kills(folders[1], kills, seed, "--cores", "2"):
            print(line, flush=True)
        different = differences(*folders)
        print(f"{len(final_files(folders[0]))} results, {len(different)} different: {different}")
        sys.exit(bool(different))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
