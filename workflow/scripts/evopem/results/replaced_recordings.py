"""Find recorded files that were replaced since they were read, whatever the time they bear.

Snakemake compares modification times, and a file that is moved, unpacked or copied with its time
may bear an older one than the results made from its predecessor. The time of its last change of
status (``ctime``) is set by the file system alone. Nothing here imports numpy or pandas: a
Snakefile uses this module.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from evopem.config.settings import DatasetSettings, RecordedSource
from evopem.config.state_space_settings import MultichannelDataset, MultichannelSource
from evopem.files.checksums import sha256_of_file
from evopem.results.layout import DatasetFiles


def mark_replaced_recordings(
    datasets: Mapping[str, DatasetSettings | MultichannelDataset],
) -> list[str]:
    """Make the outputs of reading a recording older than it, where its content has changed.

    The content is compared, by its SHA-256, only where the size differs or the file's status
    changed after it was read; a touched file of equal content leaves everything as it is.

    Parameters
    ----------
    datasets : mapping of str to DatasetSettings or MultichannelDataset

    Returns
    -------
    list of str
        The recorded files whose results are out of date.
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
    datasets: Mapping[str, DatasetSettings | MultichannelDataset],
) -> Iterator[tuple[str, str, str]]:
    """List each recorded file with the outputs of reading it: samples and origin."""
    for name, dataset in datasets.items():
        source, files = dataset.source, DatasetFiles.of_dataset(name)
        if isinstance(source, RecordedSource | MultichannelSource):
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
