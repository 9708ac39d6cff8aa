"""What the results of a recording were made from: whether it has to be identified again.

The job of a batch asks this of each of its recordings, where Snakemake asks it of the whole job.
Nothing here imports numpy or pandas: a Snakefile uses this module.
"""

from __future__ import annotations
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from evopem.config.settings import DatasetSettings
from evopem.config.channels import RecordedSource
from evopem.config.settings import DatasetSettings
from evopem.config.channels import RecordedSource
from evopem.errors import InputError
from evopem.files.archive import member_of
from evopem.files.checksums import sha256_of_file, verify_checksums
from evopem.files.json_form import from_json, to_json
from evopem.files.unfinished import unfinished_record
from evopem.results.layout import BATCH_CHECKSUMS, IDENTIFICATION, DatasetFiles
import os
from collections.abc import Iterator, Mapping
from evopem.files.checksums import sha256_of_file
from evopem.results.layout import DatasetFiles



def mark_replaced_recordings(
    datasets: Mapping[str, DatasetSettings],
) -> list[str]:
    """Make the outputs of reading a recording older than it, where its content has changed.

    The content is compared, by its SHA-256, only where the size differs or the file's status
    changed after it was read; a touched file of equal content leaves everything as it is.

    Returns the recorded files whose results are out of date.
    """
    replaced = []
    for path, recording, info in _read_files(datasets):
        if _is_replaced(path, info):
            _make_older(path, [recording, info])
            replaced.append(path)
    return replaced


def was_read_from(path: str, info: str) -> bool:
    """Whether a recording was read from this path, as its ``recording.json`` tells."""
    return bool(_origin(path, info))


def _read_files(
    datasets: Mapping[str, DatasetSettings],
) -> Iterator[tuple[str, str, str]]:
    """List each recorded file with the outputs of reading it: samples and origin."""
    for name, dataset in datasets.items():
        source, files = dataset.source, DatasetFiles.of_dataset(name)
        if isinstance(source, RecordedSource):
            for path in source.files:
                yield path, files.recording, files.recording_info
            for path in source.validation_files:
                yield path, files.validation_recording, files.validation_recording_info


def _is_replaced(path: str, info: str) -> bool:
    try:
        read_at = Path(info).stat().st_mtime_ns
        link, file = Path(path).lstat(), Path(path).stat()
        origin = _origin(path, info)
        unchanged = max(link.st_ctime_ns, file.st_ctime_ns) <= read_at
        if not origin or (unchanged and file.st_size == origin.get("bytes")):
            return False
        return sha256_of_file(path) != origin.get("sha256")
    except (OSError, ValueError):  # not read yet, or no longer there: its own job says so
        return False


def _origin(path: str, info: str) -> Mapping[str, object]:
    """What is known of a file that was read; empty where it was not, or ``info`` is damaged."""
    try:
        content = json.loads(Path(info).read_text(encoding="utf-8"))
        origins = map(dict, content["files"])
        return next((each for each in origins if each.get("path") == str(Path(path))), {})
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _make_older(path: str, outputs: list[str]) -> None:
    """Give outputs a time before that of a file, which may itself be the oldest there is.

    Never time 0, which Snakemake takes for no time at all.
    """
    second = 10**9
    modified = Path(path).stat().st_mtime_ns
    time = second if modified > second else modified - 2 * second
    for output in outputs:
        if Path(output).exists():
            os.utime(output, ns=(time, time))


MADE_FROM = "made_from.json"
"""Name of the file in the archive of a recording's results."""


@dataclass(frozen=True)
class MadeFrom:
    """What results depend on."""

    code: str  # digest of the package's code
    settings: str  # SHA-256 of the settings of the data set
    # SHA-256 of each recorded file by its path, empty for one that does not exist
    recordings: dict[str, str]

    @property
    def text(self) -> str:
        """What the archive keeps."""
        return json.dumps(asdict(self), indent=2) + "\n"


def made_from(settings: DatasetSettings, code: str) -> MadeFrom:
    """Digest what the results of a data set would be made from now."""
    content = json.dumps(to_json(settings), sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()
    return MadeFrom(code, digest, _recordings(settings))


def is_finished(
    files: DatasetFiles, settings: DatasetSettings, code: str
) -> bool:
    """Whether a recording has the results of a batch, undamaged and made from what there is now.

    A recorded file that no longer exists is taken for unchanged, so that nothing made from it is
    lost.
    """
    if not all(map(_exists, (*files.batch_results, files.checksums))):
        return False
    if unfinished_record(IDENTIFICATION, files.logs):
        return False
    try:
        verify_checksums(files.batch_results, files.folder)
    except InputError:
        return False
    kept, now = _kept(files), made_from(settings, code)
    if kept is None:
        return False
    recordings = {file: own or kept.recordings.get(file) for file, own in now.recordings.items()}
    return (kept.code, kept.settings, kept.recordings) == (now.code, now.settings, recordings)


def forget_incomplete_batches(
    batches: Mapping[str, tuple[str, ...]],
    datasets: Mapping[str, DatasetSettings],
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
    if not all(map(_exists, (*files.batch_results, files.checksums))):
        return True
    read_at = Path(files.recording_info).stat().st_mtime_ns
    if not any(_changed_since(read_at, file) for file in _recorded_files(settings)):
        return False
    kept = _kept(files)
    return kept is None or any(
        own and own != kept.recordings.get(file)
        for file, own in _recordings(settings).items()
    )


def _changed_since(time: int, file: str) -> bool:
    """Whether a file's status changed after a time (ns), which the file system alone records."""
    try:
        return max(Path(file).lstat().st_ctime_ns, Path(file).stat().st_ctime_ns) > time
    except (OSError, ValueError):  # no longer there
        return False


def _kept(files: DatasetFiles) -> MadeFrom | None:
    """What the archive of a recording keeps; None where it keeps nothing that can be read."""
    try:
        return from_json(MadeFrom, json.loads(member_of(files.details, MADE_FROM) or b""))
    except (InputError, ValueError):
        return None


def _recorded_files(settings: DatasetSettings) -> list[str]:
    return list(dict.fromkeys(settings.source.all_files))


def _recordings(settings: DatasetSettings) -> dict[str, str]:
    return {file: _checksum(file) for file in _recorded_files(settings)}


def _exists(file: str) -> bool:
    return Path(file).exists()


def _checksum(file: str) -> str:
    try:
        return sha256_of_file(file)
    except (OSError, ValueError):  # not there, or no name of a file: its job says so
        return ""
