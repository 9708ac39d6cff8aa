"""Simulate a system whose truth is known."""

from typing import TYPE_CHECKING, Any

from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.signals.recording import describe_recording, save_recording
from evopem.synthesis import synthesize

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    kind: str, settings: dict[str, Any], recording_file: str, origin_file: str, truth_file: str
) -> None:
    recording, truth = synthesize(kind, **settings)
    save_recording(recording, recording_file)
    write_json(origin_file, {"kind": "synthesis", **describe_recording(recording)})
    write_json(truth_file, truth)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            snakemake.params.kind,
            snakemake.params.settings,
            snakemake.output.recording,
            snakemake.output.origin,
            snakemake.output.truth,
        )
