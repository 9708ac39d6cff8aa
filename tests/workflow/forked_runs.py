"""Runs of Snakemake and their jobs, forked from one process that has loaded what they import.

Loading takes half of a plan and most of a small job. `python forked_runs.py` reads a run a line
from its standard input, as JSON, and answers with the run's exit code. It loads nothing of evopem,
since a run takes the package of its own checkout, unless `python forked_runs.py FOLDER` names the
folder from which all runs take it.
"""

import json
import os
import resource
import runpy
import shlex
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import SimpleNamespace
from typing import Any, NoReturn

LOADED = ("snakemake.cli", "numba", "pandas", "scipy.io", "scipy.signal", "scipy.stats", "jinja2")
LOADED += ("matplotlib.figure", "matplotlib.backends.backend_svg", "docutils.parsers.rst", "yte")
LOADED += ("snakemake.report.html_reporter", "nbformat", "jsonschema", "requests", "smart_open")


def main() -> None:
    for module in LOADED:
        import_module(module)
    if folders := sys.argv[1:]:
        sys.path[:0] = folders
        load_package()
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            run(**json.loads(line))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def load_package() -> None:
    """Load the stages and, by a small estimate, the compiled kernels."""
    import numpy as np

    from evopem import pipeline
    from evopem.notebook.estimate import estimate

    for module in walk_packages(pipeline.__path__, f"{pipeline.__name__}."):
        import_module(module.name)
    u, e = np.random.default_rng(1).standard_normal((2, 100))
    estimate(u, np.roll(u, 1) + e, (1, 1, 1, 1))


def run(
    arguments: list[str],
    folder: str,
    printed: str,
    largest_file: int,
    drawn: bool,
    missing: list[str],
    environment: dict[str, str],
) -> NoReturn:
    """Be `snakemake` with its arguments in a folder, what it prints in a file.

    No file may have more bytes than the largest one. Figures that are not drawn are empty. Missing
    modules cannot be imported; the variables of the environment come after the imports.
    """
    sys.modules.update(dict.fromkeys(missing))
    os.environ.update(environment)
    sys.path[1:1] = filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))
    from snakemake.cli import main as snakemake

    if not drawn:
        leave_out_drawings()

    import_module("snakemake.shell").sp = SimpleNamespace(**vars(subprocess) | {"Popen": start})
    os.chdir(folder)
    written = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (written, 1), (written, 2)):
        os.dup2(source, target)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
    sys.argv = ["snakemake", *arguments]
    end_with(lambda: snakemake(arguments))


def leave_out_drawings() -> None:
    from evopem.pipeline import report
    from evopem.results.layout import FIGURES

    report.svg_texts = lambda _: dict.fromkeys(FIGURES, "<svg/>")


@dataclass(frozen=True)
class Job:
    """A job's process, as far as Snakemake asks it."""

    pid: int

    def wait(self) -> int:
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def start(command: str, **keys: Any) -> Job | subprocess.Popen[str]:
    """Start a command of Snakemake; one that would start an interpreter for a script is forked."""
    *_, program, file = shlex.split(command)
    if program != sys.executable:
        return subprocess.Popen(command, **keys)
    sys.stdout.flush()
    job = os.fork()
    if job == 0:
        for name in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(name, signal.SIG_DFL)
        sys.argv = [file]
        end_with(lambda: runpy.run_path(file, run_name="__main__"))
    return Job(job)


def end_with(call: Callable[[], object]) -> NoReturn:
    """End this process after a call as an interpreter ends after a script."""
    code = 1
    try:
        call()
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        if isinstance(ended.code, str):
            print(ended.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


class ForkedRuns:
    """The process that runs are forked from, started at the first of them.

    With a folder, all of them take the package from there.
    """

    def __init__(self, *folder: str) -> None:
        self.folder = folder
        self.process: subprocess.Popen[str] | None = None

    def run(
        self,
        arguments: Sequence[str],
        folder: Path,
        largest_file: int = resource.RLIM_INFINITY,
        drawn: bool = True,
        missing: Sequence[str] = (),
        **environment: str,
    ) -> subprocess.CompletedProcess[str]:
        """Run `snakemake` to its end in a folder; `stdout` holds what was printed."""
        from evopem.config.configuration import job_environment

        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, __file__, *self.folder],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=os.environ | job_environment(os.environ, folder),  # before numpy is loaded
            )
        with tempfile.NamedTemporaryFile("r", encoding="utf-8", errors="replace") as printed:
            asked = {"arguments": arguments, "folder": str(folder), "printed": printed.name}
            asked |= {"largest_file": largest_file, "drawn": drawn}
            asked |= {"missing": missing, "environment": environment}
            self.process.stdin.write(json.dumps(asked) + "\n")
            self.process.stdin.flush()
            code = int(self.process.stdout.readline())
            return subprocess.CompletedProcess(arguments, code, stdout=printed.read())


OF_ANY_CHECKOUT = ForkedRuns()
FORKED = ForkedRuns(str(Path(__file__).parents[2] / "workflow" / "scripts"))

if __name__ == "__main__":
    main()
