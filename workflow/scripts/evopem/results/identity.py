"""What results were made from, and whether they are whole: finished, and as their jobs wrote them.

Whatever reads results from outside their run asks here: ``read_results``, ``compare``, the lists of
all data sets, a new run. Nothing here imports numpy or pandas: a Snakefile uses this module.
"""

import hashlib
import json
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.files.atomic import member_of
from evopem.files.checksums import again, checksummed, sha256_of_file, sources
from evopem.files.job import unfinished_jobs
from evopem.files.json_form import from_json, to_json
from evopem.results.layout import BATCH_CHECKSUMS, DatasetFiles

MADE_FROM = "made_from.json"  # name of the file in the archive of a recording's results


@dataclass(frozen=True)
class IncompleteDataset:
    """A data set whose results are not complete."""

    # ``unfinished`` where the run ended before its jobs, or a job of it could not start
    status: Literal["failed", "unfinished"]
    problem: str  # what is wrong, in a sentence
    # The log that says more, relative to the data set's folder; empty where there is none
    log: str = ""


def check_results(files: DatasetFiles) -> None:
    """Refuse results that no run has finished, or that were changed afterwards."""
    if not Path(files.config).is_file():
        remedy = "give a folder such as results/arm, as the workflow or `evopem FILE` makes it"
        raise InputError(files.folder, "holds no results of a data set", remedy)
    fault = incompleteness(files)
    if fault is not None:
        problem, _, remedy = fault.problem.removesuffix(".").rpartition("; ")
        raise InputError(files.folder, f"its results are not whole: {problem or remedy}", remedy)


def incompleteness(
    files: DatasetFiles, required: Collection[str] = (), pending: bool = False
) -> IncompleteDataset | None:
    """Why the results of a data set are not whole; None where they are.

    They are whole if no job is left or unfinished, every required file exists, every file is as its
    job wrote it, and was made from the files that are there.

    ``required``: beside model, validation and summary.  ``pending``: whether the run has ended with
    jobs of this data set left.
    """
    needed = (*required, files.model, files.validation, files.summary)
    missing = next((file for file in needed if not Path(file).exists()), None)
    jobs = unfinished_jobs(files.logs, Path(files.summary).name)
    if jobs:
        log = Path(files.log(jobs[0].job))
        shown = log.relative_to(files.folder).as_posix() if log.is_file() else ""
        return IncompleteDataset("failed", jobs[0].sentence, shown)
    if pending or missing:
        what = f"{missing} has not been made" if missing else "not all of its jobs have run"
        return IncompleteDataset("unfinished", f"{what}; {again(files.folder)}.")
    known = checksummed(files.folder)
    for file in filter(os.path.isfile, files.read_again()):
        if Path(file) not in known:
            return _changed(file, "has no checksum, which a finished run has written")
    for path, checksum in known.items():
        if path.is_file() and sha256_of_file(path) != checksum:
            return _changed(path, "was changed or damaged after it was written")
    for made, read, checksum in sources(files.folder):
        # Parts of a result may be older than it where a job takes a recording through all stages.
        if known.get(read, checksum) != checksum and not made.name.startswith("part-"):
            return _changed(made, f"was not made from the present {read.name}")
    return None


def _changed(file: str | Path, problem: str) -> IncompleteDataset:
    return IncompleteDataset("failed", f"{file}: {problem}; delete it and {again(file)}.")


def mark_replaced_recordings(datasets: Mapping[str, DatasetSettings]) -> list[str]:
    """Make the outputs of reading a recording older than it, where its content has changed.

    The content is compared, by its SHA-256, only where the size differs or the file's status
    changed after it was read; a touched file of equal content leaves everything as it is.

    Returns the recorded files whose results are out of date.
    """
    replaced = []
    for path, recording, info in _read_files(datasets):
        origin = origins(info).get(str(Path(path)), {})
        try:
            is_other = _was_touched(path, info) or origin.get("bytes") != Path(path).stat().st_size
            is_replaced = origin and is_other and sha256_of_file(path) != origin.get("sha256")
        except (OSError, ValueError):  # not read yet, or gone: its own job says so
            continue
        if is_replaced:
            _make_older(path, [recording, info])
            replaced.append(path)
    return replaced


def was_read_from(path: str, info: str) -> bool:
    """Whether a recording was read from this path, as its ``recording.json`` tells."""
    return str(Path(path)) in origins(info)


def _read_files(datasets: Mapping[str, DatasetSettings]) -> Iterator[tuple[str, str, str]]:
    """List each recorded file with the outputs of reading it: samples and origin."""
    for name, dataset in datasets.items():
        source, files = dataset.source, DatasetFiles.of_dataset(name)
        for path in getattr(source, "files", ()):
            yield path, files.recording, files.recording_info
        for path in getattr(source, "validation_files", ()):
            yield path, files.validation_recording, files.validation_recording_info


def _was_touched(path: str, info: str) -> bool:
    """Whether a file's status changed after ``info`` was written: the file system alone tells."""
    link, file = Path(path).lstat(), Path(path).stat()
    return max(link.st_ctime_ns, file.st_ctime_ns) > Path(info).stat().st_mtime_ns


def origins(info: str) -> dict[str, Mapping[str, Any]]:
    """What is known of the files that were read, by path; empty where ``info`` is damaged."""
    try:
        content = json.loads(Path(info).read_text(encoding="utf-8"))
        return {origin["path"]: origin for origin in map(dict, content["files"])}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _make_older(path: str, outputs: list[str]) -> None:
    """Give outputs a time before that of a file, which may itself be the oldest there is. Never
    time 0, which Snakemake takes for no time at all."""
    second = 10**9
    modified = Path(path).stat().st_mtime_ns
    time = second if modified > second else modified - 2 * second
    for output in outputs:
        if Path(output).exists():
            os.utime(output, ns=(time, time))


@dataclass(frozen=True)
class MadeFrom:
    """What the results of a batch depend on, as Snakemake knows it of a job."""

    code: str  # digest of the package's code
    settings: str  # SHA-256 of the settings of the data set
    # SHA-256 of each recorded file by its path, empty for one that does not exist
    recordings: dict[str, str]


def made_from(settings: DatasetSettings, code: str) -> MadeFrom:
    """Digest what the results of a data set would be made from now."""
    content = json.dumps(to_json(settings), sort_keys=True)
    recordings = {file: _checksum(file) for file in settings.source.all_files}
    return MadeFrom(code, hashlib.sha256(content.encode()).hexdigest(), recordings)


def is_finished(files: DatasetFiles, settings: DatasetSettings, code: str) -> bool:
    """Whether a recording has the results of a batch, whole and made from what there is now.

    A recorded file that no longer exists is taken for unchanged: nothing made from it is lost.
    """
    if incompleteness(files, (*files.batch_results, files.checksums)):
        return False
    kept, now = _kept(files), made_from(settings, code)
    if kept is None:
        return False
    recordings = {file: sha or kept.recordings.get(file) for file, sha in now.recordings.items()}
    return (kept.code, kept.settings, kept.recordings) == (now.code, now.settings, recordings)


def forget_incomplete_batches(
    batches: Mapping[str, tuple[str, ...]], datasets: Mapping[str, DatasetSettings]
) -> None:
    """Delete what the jobs of batches have written where a recording has to be identified again.

    Snakemake knows the job of a batch and not the results of its recordings: it would not notice
    that one of these is missing, nor that a recorded file was replaced by one of an older time.
    """
    for batch, names in batches.items():
        output = Path(BATCH_CHECKSUMS.format(batch=batch))
        if output.exists() and any(_is_outdated(name, datasets[name]) for name in names):
            output.unlink(missing_ok=True)


def _is_outdated(name: str, settings: DatasetSettings) -> bool:
    """Whether results are missing, or a recorded file has another content than was read."""
    files = DatasetFiles.of_dataset(name)
    if not all(Path(file).exists() for file in (*files.batch_results, files.checksums)):
        return True
    touched = [
        file
        for file in settings.source.all_files
        if Path(file).exists() and _was_touched(file, files.recording_info)
    ]
    kept = _kept(files) if touched else None
    return any(kept is None or kept.recordings.get(file) != _checksum(file) for file in touched)


def _kept(files: DatasetFiles) -> MadeFrom | None:
    """What the archive of a recording keeps; None where it keeps nothing that can be read."""
    try:
        return from_json(MadeFrom, json.loads(member_of(files.details, MADE_FROM) or b""))
    except (InputError, ValueError):
        return None


def _checksum(file: str) -> str:
    try:
        return sha256_of_file(file)
    except (OSError, ValueError):  # not there, or no name of a file: its job says so
        return ""
