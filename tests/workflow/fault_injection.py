"""Disturb runs of the workflow at random moments, and check what each one leaves.

    python -m tests.workflow.fault_injection --seconds 600 --seed 1

Each sequence has a seed of its own, which draws its faults and their moments: the first has the
given one, each following one the next number. A sequence changes files between runs, and disturbs
one or two runs: it kills a job or all of them, interrupts Snakemake, fills the disk, changes an
input, or starts a second run. After each run the lists must be true. After the last one, an
undisturbed run must give the results of a run that was never disturbed, byte for byte.
"""

import argparse
import html
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import psutil

from .conftest import Folder
from .disturbed_runs import fill, is_mounted, members, process, small_disk, wait_for_jobs
from .interruption import listed, results_of, wrong_checksums
from .undisturbed import ARGUMENTS, References, State

LONGEST_RUN = 300.0  # seconds
SENTENCE = 'bad.csv, line 51, column 2: "oops" is not a finite number; repair or remove that sample'
DAMAGED = re.compile(r"(results/\S+): was changed or damaged after it was written; delete it")

JOBS = ("stage", "recording", "batch")
FAULTS = (
    "kill one job",
    "kill all processes",
    "SIGTERM",
    "SIGHUP",
    "SIGINT",
    "fill the disk",
    "replace the recording",
    "change a value",
    "start a second run",
)
CHANGES = (
    "replace the recording",
    "replace the recording by an older file",
    "change a value",
    "remove or add a data set",
    "divide the stages differently",
    "edit a result",
    "truncate a result",
    "delete a result",
    "edit a checksum file",
    "truncate a checksum file",
    "delete a checksum file",
)


@dataclass
class Sequence:
    """One sequence of faults: what was done, and what was wrong."""

    seed: int
    folder: Folder
    references: References
    state: State = field(init=False)
    story: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    unread: int = 0

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.state = State(one_job_per=self.random.choice(JOBS))
        self.spoiled: set[Path] = set()

    def run(self) -> None:
        """Disturb one or two runs; then let one end and compare its results."""
        if self.random.random() < 0.75:
            reference = self.references.folder(self.state).path
            shutil.copytree(reference, self.folder.path, dirs_exist_ok=True, symlinks=True)
            self.story.append("begin with the results of a run")
        self.state.write(self.folder)
        for _ in range(self.random.randint(1, 2)):
            for change in self.random.sample(CHANGES, self.random.randint(0, 2)):
                self.change(change)
            self.disturb(self.random.choice(FAULTS))
        if self.random.random() < 0.6:
            self.story.append("restore the inputs")
            self.state = State(one_job_per=self.state.one_job_per)
            self.state.write(self.folder)
        self.settle()

    # Changes between runs

    def change(self, name: str) -> None:
        """Change inputs or results while nothing runs."""
        match name:
            case "replace the recording":
                self.turn(recording=1 - self.state.recording)
            case "replace the recording by an older file":
                self.turn(10.0**9, recording=1 - self.state.recording)
            case "change a value":
                self.turn(nfft=1536 - self.state.nfft)
            case "remove or add a data set":
                choices = {("good", "bad"), ("good",), ("bad",)} - {self.state.names}
                self.turn(names=self.random.choice(sorted(choices)))
            case "divide the stages differently":
                others = [each for each in JOBS if each != self.state.one_job_per]
                self.turn(one_job_per=self.random.choice(others))
            case _:
                name = f"{name}: {self.spoil(name)}"
        self.story.append(name)

    def turn(self, modified: float | None = None, **changes: object) -> None:
        self.state = replace(self.state, **changes)
        self.state.write(self.folder, modified)

    def spoil(self, how: str) -> str:
        """Edit, truncate or delete a result or a file of checksums of the good data set."""
        files = [
            path
            for path in sorted((self.folder.results / "good").rglob("*"))
            if path.is_file()
            and path.parent.name not in ("logs", "benchmarks")
            and not {"logs", "benchmarks"} & set(path.parts)
            and ("checksums" in path.parts) == ("checksum" in how)
            and path.stat().st_size > 2
        ]
        if not files:
            return "there is none"
        file = self.random.choice(files)
        content, place = file.read_bytes(), self.random.random()
        times = file.stat().st_atime_ns, file.stat().st_mtime_ns
        at = int(place * (len(content) - 1))
        match how.split()[0]:
            case "edit":
                changed = b"1" if content[at : at + 1] != b"1" else b"2"
                file.write_bytes(content[:at] + changed + content[at + 1 :])
            case "truncate":
                file.write_bytes(content[:at])
            case _:
                file.unlink()
        if file.exists() and self.random.random() < 0.5:  # as a failing disk does
            os.utime(file, ns=times)
        if "checksum" not in how and file.exists():
            self.spoiled.add(file)
        return str(file.relative_to(self.folder.path))

    # Faults during runs

    def disturb(self, fault: str) -> None:
        """Start a run, disturb it at a random moment, and check what it leaves."""
        most = 12 if self.state.one_job_per == "stage" else 2
        jobs, delay = self.random.randint(0, most), self.random.uniform(0.0, 5.0)
        before, started = self.state, time.time()
        previous = self.contents()
        limited = fault == "fill the disk" and not is_mounted(self.folder)
        with process(self.folder, limited) as (run, output):
            if not wait_for_jobs(run, self.folder, started, jobs, delay):
                fault = f"none ({fault} came too late)"
            self.inject(fault, run)
            self.story.append(f"{fault}, after {jobs} jobs and {delay:.1f} s")
            self.end(run)
            text = output()
        self.check(text, run.returncode, fault, [before, self.state], previous)
        self.unlock()

    def inject(self, fault: str, run: subprocess.Popen) -> None:
        signals = {"SIGTERM": signal.SIGTERM, "SIGHUP": signal.SIGHUP, "SIGINT": signal.SIGINT}
        match fault:
            case "kill one job":
                jobs = psutil.Process(run.pid).children(recursive=True)
                if jobs:
                    with suppress(psutil.NoSuchProcess):
                        self.random.choice(sorted(jobs, key=lambda job: job.pid)).kill()
            case "kill all processes":
                os.killpg(run.pid, signal.SIGKILL)
            case "SIGTERM" | "SIGHUP" | "SIGINT":
                run.send_signal(signals[fault])
            case "fill the disk" if is_mounted(self.folder):
                fill(self.folder, self.random.randint(0, 200_000))
            case "replace the recording":
                self.turn(recording=1 - self.state.recording)
            case "change a value":
                self.turn(nfft=1536 - self.state.nfft)
            case "start a second run":
                second = self.folder.run(*ARGUMENTS)
                if second.returncode and "Traceback" in second.stdout:
                    self.wrong.append(f"the second run printed a traceback:\n{second.stdout}")

    def end(self, run: subprocess.Popen) -> None:
        """Wait until a run and its jobs have ended."""
        try:
            run.wait(LONGEST_RUN)
        except subprocess.TimeoutExpired:
            self.wrong.append(f"the run did not end within {LONGEST_RUN:.0f} s")
        deadline = time.monotonic() + 10.0
        while members(run.pid) and time.monotonic() < deadline:
            time.sleep(0.1)
        if members(run.pid):
            self.wrong.append(f"jobs go on after their run: {members(run.pid)}")
            with suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
        (self.folder.path / "filler").unlink(missing_ok=True)

    def unlock(self) -> None:
        locks = self.folder.path / ".snakemake" / "locks"
        if locks.is_dir() and any(locks.iterdir()):
            self.folder.finish("--unlock")

    def contents(self) -> dict[str, bytes]:
        return results_of(self.folder, "good") | results_of(self.folder, "bad")

    # What must be true

    def check(
        self,
        output: str,
        code: int,
        fault: str,
        states: list[State],
        previous: dict[str, bytes],
    ) -> None:
        """Check the lists after a run, which may describe one of several states of the inputs."""
        if "scripts/evopem" in output and "Traceback" in output:
            begin = max(0, output.index("Traceback") - 500)
            self.wrong.append(f"traceback after {fault}:\n{output[begin : begin + 3000]}")
        rows = listed(self.folder)
        if rows is None:
            return
        unchanged = previous == self.contents()
        if code == -signal.SIGKILL and unchanged:
            return  # it may not have come to its first job
        for name, (status, problem) in rows.items():
            if status == "complete" and name == "bad":
                self.wrong.append(f"bad is listed as complete after {fault}")
            elif status == "complete":
                self.check_complete(fault, states)
            elif not problem.endswith("."):
                self.wrong.append(f"{name} has no sentence after {fault}: {problem!r}")
        if code != -signal.SIGKILL:
            self.check_index(rows, fault)

    def check_complete(self, fault: str, states: list[State]) -> None:
        """Compare a complete data set with undisturbed runs in each of the states."""
        found = results_of(self.folder, "good")
        differing = []
        for state in dict.fromkeys(states):
            expected = results_of(self.references.folder(state), "good")
            names = {
                name
                for name in expected
                if self.folder.results / name not in self.spoiled
                and found.get(name) != expected[name]
            }
            if not names:
                return
            differing.append(sorted(names))
        self.wrong.append(f"good is listed as complete after {fault}; not so: {differing}")

    def check_index(self, rows: dict[str, tuple[str, str]], fault: str) -> None:
        """Check that the page says of each data set what the table says."""
        try:
            page = html.unescape((self.folder.results / "index.html").read_text())
        except FileNotFoundError:
            self.wrong.append(f"index.html is missing beside fleet.csv after {fault}")
            return
        for name, (_, problem) in rows.items():
            if problem.removeprefix("'") not in page or name not in page:
                self.wrong.append(f"index.html lacks the problem of {name} after {fault}")

    def settle(self) -> None:
        """Run undisturbed, delete what is reported as damaged as the messages ask, and compare."""
        self.unlock()
        for _ in range(8):
            run = self.folder.run(*ARGUMENTS)
            if "Traceback" in run.stdout:
                self.wrong.append(f"traceback in the last run:\n{run.stdout[-3000:]}")
            damaged = {self.folder.path / name for name in DAMAGED.findall(run.stdout)}
            if not damaged:
                damaged = set(wrong_checksums(self.folder))
                self.unread += len(damaged)
            if not damaged:
                break
            for file in damaged:
                file.unlink(missing_ok=True)
        self.spoiled.clear()
        self.compare(run)

    def compare(self, run: subprocess.CompletedProcess) -> None:
        """Compare the results and lists of the last run with those of an undisturbed one."""
        reference, names = self.references.folder(self.state), self.state.names
        if run.returncode != int("bad" in names):
            self.wrong.append(f"the last run ended with {run.returncode}:\n{run.stdout[-3000:]}")
        found, expected = results_of(self.folder, "good"), results_of(reference, "good")
        different = [n for n in found | expected if found.get(n) != expected.get(n)]
        if "good" in names and different:
            self.wrong.append(f"results differ after the last run: {sorted(different)}")
        rows = listed(self.folder) or {}
        expected_rows = {"good": ("complete", ""), "bad": ("failed", f"{SENTENCE}.")}
        if rows != {name: expected_rows[name] for name in names} and (rows or len(names) > 1):
            self.wrong.append(f"the table is wrong after the last run: {rows}")
        if names == ("good", "bad"):
            for name in ("index.html", "fleet.csv"):
                file = self.folder.results / name
                if not file.exists() or compared(file) != compared(reference.results / name):
                    self.wrong.append(f"{name} differs after the last run")
        if unfinished := list(self.folder.results.rglob(".writing-*/*")):
            self.wrong.append(f"unfinished files are left: {unfinished}")


def compared(file: Path) -> str:
    """A list without the name of the log that it links to: the job that fails depends on the mode.

    The undisturbed runs have one job a recording.
    """
    return re.sub(r"/logs/[a-z_]+\.log", "/logs/JOB.log", file.read_text(encoding="utf-8"))


def inject_faults(root: Path, seconds: float, seed: int) -> list[Sequence]:
    """Run sequences of faults one after the other, as many as begin within a time.

    Parameters
    ----------
    root : Path
        An empty folder.
    seconds : float
        No sequence begins later; there is at least one.
    seed : int
        Of the first sequence; each following one has the next number.
    """
    references, sequences = References(root), []
    end = time.monotonic() + seconds
    while not sequences or time.monotonic() < end:
        path = root / f"sequence-{seed}"
        with small_disk(path):
            sequence = Sequence(seed, Folder(path), references)
            sequence.run()
        sequences.append(sequence)
        print(report(sequence), flush=True)
        seed += 1
    return sequences


def report(sequence: Sequence) -> str:
    """What was done in a sequence, and what was wrong."""
    lines = [f"seed {sequence.seed}: " + "; ".join(sequence.story)]
    if sequence.unread:
        lines.append(f"  {sequence.unread} damaged files that no job reads")
    return "\n".join([*lines, *(f"  WRONG: {each}" for each in sequence.wrong)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        sequences = inject_faults(Path(root), arguments.seconds, arguments.seed)
    wrong = sum(bool(sequence.wrong) for sequence in sequences)
    print(f"{len(sequences)} sequences, {wrong} with something wrong")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
