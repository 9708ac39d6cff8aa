"""Real runs of Snakemake in folders of their own, with small configurations."""

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml

from evopem.results.layout import DatasetFiles
from evopem.signals.recording import load_recording

from .forked_runs import FORKED, OF_ANY_CHECKOUT

ROOT = Path(__file__).parents[2]

TINY = {
    "candidates_per_job": 2,
    "defaults": {
        "recipe": "chapter",
        "split": {"discard": 20},
        "spectrum": {"nfft": 512},
        "delay": {"orders": [3, 3], "nk": [1, 3]},
        "orders": {"plant": [3, 4], "nc": [2, 3], "nb": [3, 3]},
        "search": {"mu": 3, "lambda": 6, "nu": 2, "evaluations": 50, "n_initial_discard": 20},
    },
    "datasets": {"truth": {"synthesis": "armax", "samples": 700}},
}

# Of a structure with few phases, where the search is not the point.
FEW_PHASES = TINY["defaults"] | {
    "structure": "arx",
    "delay": {"orders": [3, 3], "nk": [2, 3]},
    "orders": {"plant": [3, 3], "nb": [3, 3]},
}


@dataclass(frozen=True)
class Folder:
    """A folder with a config.yaml, in which the workflow runs."""

    path: Path
    snakefile: Path = ROOT / "Snakefile"
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def results(self):
        return self.path / "results"

    def copied(self, path):
        """A copy at another path, with the times of its files."""
        shutil.copytree(self.path, path, copy_function=shutil.copy2)
        return Folder(path)

    def configure(self, config):
        (self.path / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))

    def command(self, *arguments):
        return [
            *(sys.executable, "-m", "snakemake", "--nocolor"),
            *("--snakefile", str(self.snakefile)),
            *arguments,
        ]

    def start(self, *arguments):
        """Start a run in the background."""
        return subprocess.Popen(
            self.command(*arguments),
            cwd=self.path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def run(self, *arguments, **options):
        """Run to the end; `stdout` holds what was printed."""
        if not self.environment:
            forked = FORKED if self.snakefile.parent == ROOT else OF_ANY_CHECKOUT
            return forked.run(self.command(*arguments)[3:], self.path, **options)
        return subprocess.run(
            self.command(*arguments),
            cwd=self.path,
            env=os.environ | self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )

    def finish(self, *arguments, **options):
        """Run to the end, which has to be a success; return what was printed."""
        run = self.run(*arguments, **options)
        assert run.returncode == 0, run.stdout
        return run.stdout

    def planned(self, *arguments):
        """Count the jobs of each rule that a run would do."""
        return jobs_of_each_rule(self.finish("--quiet", "rules", "--dry-run", *arguments))

    def files_of(self, dataset):
        """Where the files of a data set lie."""
        return DatasetFiles(str(self.results / dataset))


def jobs_of_each_rule(output):
    """Read the table of jobs that Snakemake prints before a run."""
    if "Nothing to be done" in output:
        return {}
    table = output.split("Job stats:", 1)[1].split("\n\n", 1)[0]
    rows = (line.split() for line in table.splitlines()[3:])
    return {row[0]: int(row[1]) for row in rows if row and row[0] not in {"all", "total"}}


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished run of the tiny configuration, one for all workers; no test changes it."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = Folder(shared / "finished")
    with (shared / "finished.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released when it is closed
        if not folder.path.exists():
            started = Folder(Path(tempfile.mkdtemp(dir=shared)))
            started.configure(TINY)
            started.finish("--cores", "2")
            started.path.rename(folder.path)
    return folder


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of the finished run, times included, for a test to change."""
    return finished.copied(tmp_path / "copy")


@pytest.fixture
def folder(tmp_path):
    """An empty folder."""
    return Folder(tmp_path)


@pytest.fixture(scope="session")
def recorded(finished):
    """The samples of the finished run: a column for the input, one for the output."""
    recording = load_recording(finished.files_of("truth").recording)
    return np.column_stack([recording.input, recording.output])


def checkout_at(path):
    """Copy what a fresh clone holds and a run needs; times are those of the copying."""
    unneeded = shutil.ignore_patterns(".*", "__pycache__", "tests", "docs")
    beside = {"results"}  # of runs in the checkout itself, and not the package's module

    def ignored(folder, names):
        return unneeded(folder, names) | (beside if Path(folder) == ROOT else set())

    shutil.copytree(ROOT, path, ignore=ignored, copy_function=shutil.copy)
    return path
