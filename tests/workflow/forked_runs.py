"""Runs of Snakemake, each forked from one process that has loaded it: that takes half of a plan.

`python -m tests.workflow.forked_runs` reads a run a line from its standard input, as JSON, and
answers with the run's exit code.
"""

import json
import os
import subprocess
import sys
import traceback
from pathlib import Path


def main() -> None:
    import snakemake.cli  # noqa: F401

    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            run(**json.loads(line))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def run(arguments: list[str], folder: str, printed: str) -> None:
    """Be `snakemake` with its arguments in a folder, what it prints in a file; does not return."""
    from snakemake.cli import main as snakemake

    os.chdir(folder)
    written = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (written, 1), (written, 2)):
        os.dup2(source, target)
    code, sys.argv = 1, ["snakemake", *arguments]
    try:
        snakemake(arguments)
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
    """The process that runs are forked from, started at the first of them."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None

    def run(self, arguments: list[str], folder: Path, printed: Path) -> int:
        """Run to the end; the exit code."""
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
        asked = {"arguments": arguments, "folder": str(folder), "printed": str(printed)}
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline())


FORKED = ForkedRuns()

if __name__ == "__main__":
    main()
