"""Real runs of Snakemake in folders of their own, with small configurations."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]

TINY = {
    "candidates_per_job": 2,
    "defaults": {
        "split": {"discard": 20},
        "spectrum": {"nfft": 512},
        "delay": {"orders": [3, 3], "delays": [2, 3]},
        "orders": {"common": [3, 4], "c": [2, 3], "b": [3, 3]},
        "search": {"mu": 3, "lambda": 6, "nu": 2, "evaluations": 50, "burn_in": 20},
    },
    "datasets": {"truth": {"synthesis": "armax", "samples": 700}},
}


@dataclass(frozen=True)
class Folder:
    """A user's folder with a config.yaml, in which the workflow runs."""

    path: Path
    snakefile: Path = ROOT / "Snakefile"
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def results(self):
        return self.path / "results"

    def configure(self, config):
        (self.path / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))

    def command(self, *arguments):
        return [
            *(sys.executable, "-m", "snakemake", "--nocolor"),
            *("--snakefile", str(self.snakefile)),
            *arguments,
        ]

    def start(self, *arguments):
        """Start a run and leave it alone."""
        return subprocess.Popen(
            self.command(*arguments),
            cwd=self.path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def run(self, *arguments):
        """Run to the end; what was printed stands in `stdout`."""
        return subprocess.run(
            self.command(*arguments),
            cwd=self.path,
            env=os.environ | self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )

    def finish(self, *arguments):
        """Run to the end, which must be a good one."""
        run = self.run(*arguments)
        assert run.returncode == 0, run.stdout
        return run.stdout

    def planned(self, *arguments):
        """Jobs that a run would do: how many of each rule."""
        output = self.finish("--quiet", "rules", "--dry-run", *arguments)
        if "Nothing to be done" in output:
            return {}
        table = output.split("Job stats:", 1)[1].split("\n\n", 1)[0]
        rows = (line.split() for line in table.splitlines()[3:])
        return {row[0]: int(row[1]) for row in rows if row and row[0] not in {"all", "total"}}


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A finished run of the tiny configuration; nobody changes it."""
    folder = Folder(tmp_path_factory.mktemp("finished"))
    folder.configure(TINY)
    folder.finish("--cores", "1")
    return folder


@pytest.fixture
def copy(finished, tmp_path):
    """A copy of the finished run, times included, to change at will."""
    path = tmp_path / "copy"
    shutil.copytree(finished.path, path, copy_function=shutil.copy2)
    return Folder(path)


@pytest.fixture
def folder(tmp_path):
    """An empty folder."""
    return Folder(tmp_path)
