"""Where a recording came from, for anyone to check that it is the same one."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from evopem.signals.recording import Recording


def origin_of(
    recording: Recording,
    path: str | Path,
    kind: str,
    channels: tuple[str | int, str | int] = ("input", "output"),
) -> dict[str, Any]:
    """Describe a recording and the file that holds it, as in ``recording.json``.

    Parameters
    ----------
    recording : Recording
    path : path
        The file, whose content is digested (SHA-256).
    kind : {"file", "synthesis"}
    channels : (input, output)
        What the two channels are called in the file.
    """
    path = Path(path)
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {
        "kind": kind,
        "path": str(path),
        "sha256": digest,
        "bytes": path.stat().st_size,
        "format": path.suffix.lstrip(".").lower(),
        "input_channel": channels[0],
        "output_channel": channels[1],
        "samples": len(recording.output),
        "sampling_rate": recording.sampling_rate,
        "input_name": recording.input_name,
        "output_name": recording.output_name,
        "input_unit": recording.input_unit,
        "output_unit": recording.output_unit,
    }
