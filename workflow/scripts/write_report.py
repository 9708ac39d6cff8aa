"""Set the results and figures of one data set into one HTML file."""

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_text
from evopem.files.job import job
from evopem.report.page import build_report

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(result_files: list[str], workflow: Path, dataset: str, report_file: str) -> None:
    directory = Path(report_file).parent
    # Times are a record beside the results: a report is not out of date when they are gone.
    files = [*map(Path, result_files), *(directory / "benchmarks").rglob("*.tsv")]
    results = {file.relative_to(directory).as_posix(): file for file in files}
    page = build_report(results, workflow / "templates", dataset, commit_of(workflow))
    write_text(report_file, page)


def commit_of(workflow: Path) -> str:
    """Name the commit that the workflow was checked out at, read when the report is written.

    Read here and not in a rule: a new commit alone must not make a result out of date.
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
        git("ls-files", "--error-unmatch", "scripts/write_report.py")
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", "../Snakefile")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return f"{commit}, with changes that are not committed" if changed else commit


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            list(snakemake.input),
            Path(snakemake.scriptdir).parent,
            snakemake.wildcards.dataset,
            snakemake.output.report,
        )
