"""What is left of an interrupted run: result files, checksums, and rows of the lists.

Nothing here starts a run. `tests.workflow.fault_injection` disturbs runs, and both it and
`test_interruption.py` compare what is left with the results of a run that was not disturbed.
"""

import csv
import io
import zipfile
import zlib
from pathlib import Path

from evopem.files.checksums import sha256_of_file

from .conftest import Folder


def final_files(folder: Folder) -> dict[str, bytes]:
    """Every result by its name, without logs, times and the report, which shows them."""
    left_out = {"logs", "benchmarks", "report.html", "report.sha256"}
    return {
        path.relative_to(folder.results).as_posix(): path.read_bytes()
        for path in sorted(folder.results.rglob("*"))
        if path.is_file() and not left_out & set(path.relative_to(folder.results).parts)
    }


def differences(folder: Folder, other: Folder) -> list[str]:
    """Names of the results that one of two folders lacks, or that differ in a byte."""
    one, two = final_files(folder), final_files(other)
    return sorted(name for name in one | two if one.get(name) != two.get(name))


def results_of(folder: Folder, dataset: str) -> dict[str, bytes]:
    """The results of a data set that do not depend on how its stages are divided into jobs.

    Candidates of one part of a phase and checksums, which lie in a file for each job, do depend.
    Those of a job of several recordings are unpacked, without the record of their making.
    """
    found = {
        name: content
        for name, content in final_files(folder).items()
        if name.startswith(f"{dataset}/") and "/part-" not in name and "/checksums/" not in name
    }
    return found | unpacked(found.pop(f"{dataset}/details.zip", b""), dataset)


def unpacked(details: bytes, dataset: str) -> dict[str, bytes]:
    """Results that a job of several recordings has packed; none of a damaged archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(details)) as archive:
            packed = {f"{dataset}/{name}": archive.read(name) for name in archive.namelist()}
    except (zipfile.BadZipFile, zlib.error, OSError, ValueError):
        return {}
    return {name: content for name, content in packed.items() if "made_from" not in name}


def wrong_checksums(folder: Folder) -> list[Path]:
    """Result files that exist and differ from one of the checksums about them."""
    wrong = set()
    for checksums in folder.results.glob("**/checksums/**/*.sha256"):
        root = next(up.parent for up in checksums.parents if up.name == "checksums")
        for line in checksums.read_text(errors="replace").splitlines():
            if line.startswith("#"):  # of a result that the job has read
                continue
            checksum, _, name = line.partition("  ")
            file = root / name
            if name and file.is_file() and sha256_of_file(file) != checksum:
                wrong.add(file)
    return sorted(wrong)


def listed(folder: Folder) -> dict[str, tuple[str, str]] | None:
    """Status and problem of each data set in the table of all; None where there is no table."""
    try:
        with (folder.results / "fleet.csv").open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except FileNotFoundError:
        return None
    return {row["dataset"]: (row["status"], row["problem"]) for row in rows}
