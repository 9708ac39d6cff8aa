"""Read the input and output channels of a recorded file."""

from typing import TYPE_CHECKING, Any

from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.signals.reading import describe_source, read_recording
from evopem.signals.recording import save_recording

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(file: str, channels: dict[str, Any], recording_file: str, origin_file: str) -> None:
    recording = read_recording(file, **channels)
    save_recording(recording, recording_file)
    origin = describe_source(file, recording, channels["input"], channels["output"])
    write_json(origin_file, origin)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.params.file,
            snakemake.params.channels,
            snakemake.output.recording,
            snakemake.output.origin,
        )
