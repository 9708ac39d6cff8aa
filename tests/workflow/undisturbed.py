"""Inputs of the runs that faults disturb, and what the workflow makes of them undisturbed."""

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from .conftest import FEW_PHASES, TINY, Folder
from .interruption import listed

ARGUMENTS = ("--cores", "2")


@dataclass(frozen=True)
class State:
    """The inputs of a run: which of two recordings and values, which data sets, which jobs.

    ``one_job_per`` is ``"batch"`` where one job takes both data sets.
    """

    recording: int = 0
    nfft: int = 512
    names: tuple[str, ...] = ("good", "bad")
    one_job_per: str = "stage"

    def write(self, folder: Folder, modified: float | None = None) -> None:
        """Write the configuration and the recordings, optionally with a time of modification."""
        for name in ("good", "bad"):
            write_recording(folder.path / f"{name}.csv", self.recording, name == "bad", modified)
        defaults = FEW_PHASES | {"spectrum": {"nfft": self.nfft}}
        datasets = {name: {"file": f"{name}.csv", "sampling_rate": 100} for name in self.names}
        jobs = {"one_job_per": self.one_job_per}
        if self.one_job_per == "batch":
            jobs = {"one_job_per": "recording", "recordings_per_job": 2}
        folder.configure(
            TINY | {"report": "none"} | jobs | {"defaults": defaults, "datasets": datasets}
        )


def write_recording(path: Path, seed: int, is_bad: bool, modified: float | None) -> None:
    """Write a simulated recording, unless the file has this content."""
    noise = np.random.default_rng(seed).standard_normal((2, 700))
    output = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], noise[0]) + 0.1 * noise[1]
    lines = [f"{u:.9g},{y:.9g}" for u, y in zip(noise[0], output, strict=True)]
    if is_bad:
        lines[50] = "1,oops"
    text = "\n".join(lines) + "\n"
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
        if modified is not None:
            os.utime(path, (modified, modified))


class References:
    """Results of runs that nothing disturbed, one folder for each recording and value."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.of = cache(self._make)

    def folder(self, state: State) -> Folder:
        return self.of(State(state.recording, state.nfft, one_job_per="recording"))

    def _make(self, state: State) -> Folder:
        path = self.root / f"undisturbed-{state.recording}-{state.nfft}"
        path.mkdir()
        folder = Folder(path)
        state.write(folder)
        run = folder.run(*ARGUMENTS)
        assert run.returncode == 1, run.stdout  # one recording is bad
        assert listed(folder)["good"] == ("complete", ""), run.stdout
        return folder
