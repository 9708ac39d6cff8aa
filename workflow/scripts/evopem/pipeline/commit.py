"""The commit of the workflow, for a report to name."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit_of(workflow: Path) -> str:
    """Name the commit that the workflow was checked out at, ``"unknown"`` outside of Git.

    It is read when the report is written and not in a rule: a new commit alone must not make a
    result out of date.
    """

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(workflow), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=20,
        ).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "scripts/run_stage.py")
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", "../Snakefile")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return f"{commit}, with changes that are not committed" if changed else commit
