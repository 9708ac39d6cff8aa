"""Read the input and output channels of a recorded file."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.signals.reading import read_recording

from evopem.console import job
from evopem.signals.recording import save_recording
from evopem.writing import write_json

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(file: str, channels: dict[str, Any], recording_file: str, origin_file: str) -> None:
    recording = read_recording(file, **channels)
    save_recording(recording, recording_file)
    with Path(file).open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    origin = {
        "kind": "file",
        "path": file,
        "sha256": digest,
        "bytes": Path(file).stat().st_size,
        "format": Path(file).suffix.lstrip(".").lower(),
        "input_channel": channels["input"],
        "output_channel": channels["output"],
        "samples": recording.samples,
        "sampling_rate": recording.sampling_rate,
        "input_name": recording.input_name,
        "output_name": recording.output_name,
        "input_unit": recording.input_unit,
        "output_unit": recording.output_unit,
    }
    write_json(origin_file, origin)


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.input.file,
            snakemake.params.channels,
            snakemake.output.recording,
            snakemake.output.origin,
        )
