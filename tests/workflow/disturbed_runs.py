"""Runs in sessions of their own, and small disks that can be filled."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from .conftest import Folder
from .undisturbed import ARGUMENTS


@contextmanager
def process(folder: Folder, limited: bool):
    """Start a run in a session of its own, optionally with a limited size of files."""
    limit: Callable[[], None] | None = None
    if limited:
        limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # noqa: E731
    with tempfile.TemporaryFile("w+") as stream:
        run = subprocess.Popen(
            folder.command(*ARGUMENTS),
            cwd=folder.path,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=limit,
        )

        def output() -> str:
            stream.seek(0)
            return stream.read()

        try:
            yield run, output
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)


def wait_for_jobs(
    run: subprocess.Popen, folder: Folder, started: float, jobs: int, delay: float
) -> bool:
    """Wait until a number of jobs have begun, and a time more; whether the run is still there."""

    def n_begun() -> int:
        logs = [*folder.results.glob("*/logs/**/*.log"), *folder.results.glob("logs/*.log")]
        count = 0
        for log in logs:
            with suppress(FileNotFoundError):
                count += log.stat().st_mtime >= started
        return count

    while run.poll() is None and n_begun() < jobs:
        time.sleep(0.02)
    with suppress(subprocess.TimeoutExpired):
        run.wait(delay)
    return run.poll() is None


def members(session: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for each in psutil.process_iter():
        with suppress(psutil.Error, ProcessLookupError):
            if os.getsid(each.pid) == session and each.status() != psutil.STATUS_ZOMBIE:
                found.append(each.pid)
    return found


def is_mounted(folder: Folder) -> bool:
    return os.path.ismount(folder.path)


def fill(folder: Folder, free: int) -> None:
    """Leave so many bytes of a small disk free."""
    size = max(0, shutil.disk_usage(folder.path).free - free)
    with suppress(OSError), (folder.path / "filler").open("wb") as stream:
        os.posix_fallocate(stream.fileno(), 0, size)


@contextmanager
def small_disk(path: Path):
    """Mount a disk of 64 MB in memory, where the user may do that."""
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(path)]
    tool = shutil.which("mount") if sys.platform == "linux" and os.geteuid() == 0 else None
    mounted = bool(tool) and not subprocess.run(mount, capture_output=True).returncode
    try:
        yield
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", str(path)], check=True)
